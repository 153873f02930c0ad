"""Rules on whether a run can calibrate an inertial unit: the attitudes and the rates of each of its axes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping

from bench.config.models import BenchFile
from bench.metrology.attitude_names import ATTITUDES
from bench.sequence.checks.remarks import Found, Rule
from bench.sequence.checks.swings import acquired_inside
from bench.sequence.plan.plan import Plan
from bench.sequence.steps.orienting import AXES, Attitude, Orient
from bench.sequence.steps.stimulus import Rotate

METHOD = "imu_calibration"
LEAST_RATES = 6  # of an axis, of both directions
BY_LETTERS = {letters: name for name, letters in ATTITUDES.items()}
VERTICAL = "UD"


def missing_attitudes(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """Axes that do not have their eight attitudes: they are left out of the calibration."""
    for index, label in _calibrations(plan):
        if (measured := _measured(plan, label)) is None:
            continue
        missing = [name for name in ATTITUDES if name not in measured[0]]
        if missing:
            axes = " and ".join(dict.fromkeys(name[1] for name in missing))
            yield (
                ("results", index, "data"),
                f"'{label}' has {len(ATTITUDES) - len(missing)} of the {len(ATTITUDES)} attitudes, and lacks "
                f"{', '.join(missing)}: axis {axes} cannot be calibrated",
                "Acquire in every attitude in which an axis is vertical",
            )


def missing_rates(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """Axes that are turned about at fewer rates than their scale factors need."""
    for index, label in _calibrations(plan):
        if (measured := _measured(plan, label)) is None:
            continue
        few = {axis: len(measured[1][axis]) for axis in AXES if len(measured[1][axis]) < LEAST_RATES}
        if few:
            counts = ", ".join(f"{count} about {axis}" for axis, count in few.items())
            yield (
                ("results", index, "data"),
                f"'{label}' has {counts} of {LEAST_RATES} rates: these axes cannot be calibrated",
                "Rotate at three rates in each direction with the axis up, and acquire meanwhile",
            )


def _calibrations(plan: Plan) -> Iterator[tuple[int, str]]:
    for index, entry in enumerate(plan.sequence.results):
        if entry.method == METHOD:
            yield index, entry.data


def _measured(plan: Plan, label: str) -> tuple[set[str], Mapping[str, set[float]]] | None:
    """Attitudes at rest by name, and rates by the axis turned about; None where they follow from a measurement."""
    motions = {planned.id: motion for planned, motion in acquired_inside(plan, label)}
    attitude, resting, rates_dps = Attitude(None), set[str](), defaultdict[str, set[float]](set)
    for planned in plan:
        if isinstance(planned.step, Orient):
            attitude = planned.step.attitude
        elif planned.id in motions:
            if attitude.rows is None:
                return None
            motion = motions[planned.id]
            if motion is None:
                resting.add(BY_LETTERS.get(str(attitude), ""))
            elif isinstance(motion, Rotate):
                upright = next(axis for axis, letter in zip(AXES, str(attitude), strict=True) if letter in VERTICAL)
                rates_dps[upright].add(motion.rate_dps)
    return resting, rates_dps


RULES = (
    Rule("missing-attitudes", "error", "every axis of an inertial unit has its eight attitudes", missing_attitudes),
    Rule("missing-rates", "error", "every axis of an inertial unit has six rates", missing_rates),
)
