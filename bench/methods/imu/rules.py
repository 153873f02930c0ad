"""Rules on the attitudes and rates that the calibration of an inertial unit needs for each axis."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from bench.config.models import BenchFile
from bench.metrology.attitude_names import ATTITUDES
from bench.sequence.checks.acquired import acquired_under, results_by
from bench.sequence.checks.remarks import Found, Rule
from bench.sequence.checks.swings import acquired_inside
from bench.sequence.plan.plan import Plan
from bench.sequence.steps.measuring import Acquire
from bench.sequence.steps.orienting import AXES, Attitude, Orient
from bench.sequence.steps.stimulus import Rotate, SetOutput

METHOD, START_UP = "imu_calibration", "imu_start_up"
LEAST_RATES = 6  # of an axis, in both directions
BY_LETTERS = {letters: name for name, letters in ATTITUDES.items()}
SIDES = {"U": "up", "D": "down"}  # by the letters of an attitude


def missing_attitudes(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """Axes without their eight attitudes: they are left out of the calibration."""
    for place, entry in results_by(plan, METHOD):
        if (measured := _measured(plan, entry.data)) is None:
            continue
        resting = {BY_LETTERS.get(attitude) for attitude in measured.resting}
        missing = [name for name in ATTITUDES if name not in resting]
        if missing:
            axes = " and ".join(dict.fromkeys(name[1] for name in missing))
            yield (
                (*place, "data"),
                f"'{entry.data}' has {len(ATTITUDES) - len(missing)} of the {len(ATTITUDES)} attitudes, and lacks "
                f"{', '.join(missing)}: axis {axes} cannot be calibrated",
                "Acquire in every attitude in which an axis is vertical",
            )


def missing_rates(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """Axes with fewer rates than their scale factors need."""
    for place, entry in results_by(plan, METHOD):
        if (measured := _measured(plan, entry.data)) is None:
            continue
        rates = {axis: len(measured.rates_dps[axis]) for axis in AXES}
        few = {axis: count for axis, count in rates.items() if count < LEAST_RATES}
        if few:
            counts = ", ".join(f"{count} about {axis}" for axis, count in few.items())
            yield (
                (*place, "data"),
                f"'{entry.data}' has {counts} of {LEAST_RATES} rates: these axes cannot be calibrated",
                "Rotate at three rates in each direction with the axis up, and acquire meanwhile",
            )


def one_side(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """Axes without start-up readings both up and down at rest: zero and scale factor are not separated."""
    for place, entry in results_by(plan, START_UP):
        if (measured := _measured(plan, entry.data)) is None:
            continue
        sides = {(axis, letter) for attitude in measured.resting for axis, letter in zip(AXES, attitude, strict=True)}
        missing = [f"{axis} {word}" for axis in AXES for letter, word in SIDES.items() if (axis, letter) not in sides]
        if missing:
            yield (
                (*place, "data"),
                f"'{entry.data}' has no reading at rest with {', '.join(missing)}: zero and scale factor of these axes "
                "cannot be separated",
                "Acquire with each axis up and down, again and again after the power-on",
            )


def no_power_on(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """A start-up whose supply is not switched on before its readings: the time of power-on is not defined."""
    for _, entry in results_by(plan, START_UP):
        for planned in plan:
            if isinstance(planned.step, SetOutput) and planned.step.output == "on":
                break
            if isinstance(planned.step, Acquire) and planned.step.label == entry.data:
                yield (
                    (*planned.place, "label"),
                    f"'{entry.data}' is acquired before any step switches the supply on, and time counts from power-on",
                    "Soak without power, then set: supply, output: on, and acquire from there on",
                )
                break


def one_closure(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """Readings for the stability check that are taken only once: there is nothing to compare them with."""
    for place, entry in results_by(plan, METHOD):
        if entry.closure is None:
            continue
        groups = {step_id.rpartition("/")[0].rpartition("/")[0] for step_id in acquired_under(plan, entry.closure)}
        if len(groups) == 1:
            yield (
                (*place, "closure"),
                f"'{entry.closure}' is acquired in {groups.pop()} only, so that a change over the run is not seen",
                "Acquire it in one group before the calibration and in another after it",
            )


class _Measured(NamedTuple):
    """Attitudes at rest by their letters, and rates by axis."""

    resting: set[str]
    rates_dps: Mapping[str, set[float]]


def _measured(plan: Plan, label: str) -> _Measured | None:
    """Attitudes and rates that a plan acquires under a label; None if that depends on a measurement."""
    motions = {planned.id: motion for planned, motion in acquired_inside(plan, label)}
    attitude, resting, rates_dps = Attitude(None), set[Attitude](), defaultdict[str, set[float]](set)
    for planned in plan:
        if isinstance(planned.step, Orient):
            attitude = planned.step.attitude
        elif planned.id in motions:
            if attitude.rows is None:
                return None
            motion = motions[planned.id]
            if motion is None:
                resting.add(attitude)
            elif isinstance(motion, Rotate):
                upright = next(axis for axis, letter in zip(AXES, str(attitude), strict=True) if letter in SIDES)
                rates_dps[upright].add(motion.rate_dps)
    return _Measured(set(map(str, resting)), rates_dps)


RULES = (
    Rule("missing-attitudes", "error", "every axis of an inertial unit has its eight attitudes", missing_attitudes),
    Rule("missing-rates", "error", "every axis of an inertial unit has six rates", missing_rates),
    Rule("one-closure", "warning", "a closure is acquired at the beginning and at the end", one_closure),
    Rule("one-side", "error", "a start-up is watched with every axis up and down", one_side),
    Rule("no-power-on", "error", "a start-up begins with a power-on", no_power_on),
)
