"""Released calibrations of units, against which a run verifies them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from bench.config.document import Place, Problem
from bench.config.models import BenchFile
from bench.errors import InputError
from bench.sequence.checks.acquired import ramps_during
from bench.sequence.checks.remarks import Remark
from bench.sequence.method import known_methods
from bench.sequence.plan.plan import Plan
from bench.sequence.steps.measuring import Acquire
from bench.sequence.steps.stimulus import Ramp
from drivers.schema.suggest import did_you_mean

if TYPE_CHECKING:  # sequences without a calibration load no arithmetic
    from bench.offline.calibration_file import CalibrationFile

OPTION = "--calibration"
AT_A_KNOT_C = 1.0
AIR_MIN = 1.0  # by which the air in a chamber is behind its set point
ARRIVED_C = 1.0  # by which a warm unit may be beyond its calibration: certificates of two thermometers


class Released(NamedTuple):
    """Calibration file: path and content."""

    path: Path
    text: str
    content: CalibrationFile

    def to_json(self) -> dict[str, Any]:
        """Return the entry for the manifest; the run also has a copy and its hash."""
        low_c, high_c = self.content.valid_c
        return {
            "file": self.path.name,
            "uut": self.content.uut,
            "run": self.content.run,
            "verdict": self.content.verdict,
            "valid_c": [low_c, high_c],
        }


def read_released(given: Sequence[str], plan: Plan, bench: BenchFile) -> dict[str, Released]:
    """Read calibrations, `PLACE=FILE` or `FILE` with a single place, by place. Raises InputError with every problem."""
    if given and not _entries(plan):
        raise InputError(f"{OPTION}: no method of {plan.document.path.name} uses a calibration")
    found: dict[str, Released] = {}
    for each in given:
        place, name = in_place(OPTION, each, "FILE", bench)
        if place in found:
            raise InputError(
                f"{OPTION} {each}: place '{place}' has {found[place].path} already; a unit has only one calibration"
            )
        found[place] = _read(Path(name))
    problems = [problem for place, released in found.items() for problem in _channels(place, released, bench)]
    problems += plan.document.located(_beyond(found, plan, bench))
    if problems:
        raise InputError(*problems)
    return found


def in_place(option: str, given: str, what: str, bench: BenchFile) -> tuple[str, str]:
    """Return the place and the value of an option, `PLACE=VALUE`, or `VALUE` with a single place. Raises InputError."""
    place, equals, value = given.partition("=")
    if not equals:
        if len(bench.places) > 1:
            places = ", ".join(bench.places)
            raise InputError(f"{option} {given}: the bench has places {places}; write {option} PLACE={what}")
        place, value = next(iter(bench.places)), given
    if place not in bench.places:
        raise InputError(f"{option} {given}: the bench has no place '{place}'{did_you_mean(place, bench.places)}")
    return place, value


def _read(path: Path) -> Released:
    from bench.offline.calibration_file import read_calibration

    content = read_calibration(path)
    return Released(path, path.read_text("utf-8"), content)


def _channels(place: str, released: Released, bench: BenchFile) -> Iterator[str]:
    """Yield channels of a unit that its calibration lacks, or has for another output."""
    channels, known = dict(bench.places[place].channels or {}), released.content.compensations()
    if lacking := [name for name in channels if name not in known]:
        yield f"{released.path}: has no channel {', '.join(lacking)}, which the unit in place '{place}' has"
        return
    if not channels and all(each.output_unit != (unit := bench.output_unit(place)) for each in known.values()):
        name, only = next(iter(known.items()))
        yield f"{released.path}: {name} is for an output in {only.output_unit}, on the bench it is in {unit}"
    sent = bench.sent_units(bench.places[place])
    for name in channels:
        if known[name].output_unit != (unit := sent.get(name, "pulse/s")):
            yield f"{released.path}: {name} is for an output in {known[name].output_unit}, on the bench it is in {unit}"


def _entries(plan: Plan) -> dict[str, int]:
    """Return the labels of methods that need a calibration, with the indices of their results."""
    methods = known_methods()
    return {
        entry.data: number
        for number, entry in enumerate(plan.sequence.results)
        if (method := methods.get(entry.method)) is not None and method.needs_calibration
    }


def _measured_at(plan: Plan) -> dict[float, Place]:
    """Return the set points at which soaked units are measured for these methods, with the place of each ramp."""
    labels, found = _entries(plan), dict[float, Place]()
    last: tuple[float, Place] | None = None
    during = [planned.id for label in labels for planned, _, _ in ramps_during(plan, label)]
    for planned in plan:
        if isinstance(planned.step, Ramp):
            last = planned.step.temperature_c, (*planned.place, "to")
        elif isinstance(planned.step, Acquire) and planned.step.label in labels and last is not None:
            is_leg = any(ramp.startswith(f"{planned.id}/") for ramp in during)
            if not is_leg:
                found.setdefault(*last)
    return found


def _warms_by_c(place: str, bench: BenchFile) -> float:
    nominal = bench.places[place].nominal
    return nominal.self_heating if nominal is not None else 0.0


def _starts_cold(plan: Plan) -> bool:
    """True if a unit is measured from power-on, before it is as warm as it becomes."""
    used = {plan.sequence.results[number].method for number in _entries(plan).values()}
    return any(known_methods()[name].counts_at == "windows" for name in used)


def _beyond(found: Mapping[str, Released], plan: Plan, bench: BenchFile) -> Iterator[Problem]:
    """Yield set points at which a unit is outside the temperature range of its calibration."""
    measured_at, starts_cold = _measured_at(plan), _starts_cold(plan)
    for place, released in found.items():
        warms_c = _warms_by_c(place, bench)
        for set_c, where in measured_at.items():
            name, warm_c = f"at {set_c:g} °C", set_c + warms_c
            if starts_cold:
                yield from _outside(released, place, where, name, (set_c, warm_c))
            else:
                yield from _outside(released, place, where, name, (warm_c + ARRIVED_C, warm_c - ARRIVED_C))
        for where, ends_c, least_c in _legs(plan, place, bench):
            name = f"on the ramp from {ends_c[0]:g} °C to {ends_c[1]:g} °C"
            yield from _outside(released, place, where, name, least_c)


def _outside(released: Released, place: str, where: Place, name: str, goes_c: tuple[float, float]) -> Iterator[Problem]:
    """Yield the problem of a unit whose lowest or highest temperature is outside its calibration."""
    low_c, high_c = released.content.valid_c
    if low_c <= goes_c[0] and goes_c[1] <= high_c:
        return
    valid = (
        f"{released.path.name} is valid from {low_c:.4g} °C to {high_c:.4g} °C. Choose temperatures in this range, or "
        "calibrate the unit over a wider one"
    )
    unit = f"the unit in place '{place}' is at about {sum(goes_c) / 2.0:g} °C, but its calibration {valid}"
    if goes_c[0] < goes_c[1]:
        unit = (
            f"the unit in place '{place}' goes from {goes_c[0]:g} °C to about {goes_c[1]:g} °C, but its calibration "
            f"{valid}"
        )
    yield where, f"{name} {unit}"


def _legs(plan: Plan, place: str, bench: BenchFile) -> Iterator[tuple[Place, tuple[float, float], tuple[float, float]]]:
    """Yield the place of each leg of a ramp, its set points from low to high, and what the unit reaches at least.

    A powered unit is warmer than the air by its self-heating, and behind a ramp by its time constants and `AIR_MIN` of
    the air: it turns so much before the ends. A calibration holds it within `ARRIVED_C`.
    """
    nominal = bench.places[place].nominal
    behind_min = AIR_MIN + sum(nominal.time_constants) / 60.0 if nominal is not None else 0.0
    warms_c, seen = _warms_by_c(place, bench), set[tuple[float, float]]()
    for label in _entries(plan):
        for planned, ramp, from_c in ramps_during(plan, label):
            ends_c = min(from_c, ramp.temperature_c), max(from_c, ramp.temperature_c)
            if math.isnan(from_c) or ends_c in seen:
                continue
            seen.add(ends_c)
            behind_c = behind_min * ramp.rate_c_per_min + ARRIVED_C
            yield (*planned.place, "to"), ends_c, (ends_c[0] + warms_c + behind_c, ends_c[1] + warms_c - behind_c)


def remarks(found: Mapping[str, Released], plan: Plan, bench: BenchFile) -> Iterator[Remark]:
    """Yield warnings: doubtful calibrations, and temperatures that do not test the interpolation."""
    for number in _entries(plan).values():
        where: Place = ("results", number, "method")
        for released in found.values():
            as_expected = released.content.simulated and bench.is_simulated  # the first warning reports it
            for warning in released.content.warnings[as_expected:]:
                advice = "Make sure that this calibration was released"
                yield Remark("warning", "calibration-doubtful", where, f"{released.path.name}: {warning}", advice)
    for place, released in found.items():
        for set_c, at in _measured_at(plan).items():
            warm_c = set_c + _warms_by_c(place, bench)
            if any(abs(warm_c - knot_c) < AT_A_KNOT_C for knot_c in _knots_c(released)):
                yield Remark(
                    "warning",
                    "at-a-knot",
                    at,
                    f"at {set_c:g} °C the unit in place '{place}' reaches a temperature at which it was calibrated",
                    "Choose temperatures between those of its calibration, to test the interpolation",
                )


def _knots_c(released: Released) -> set[float]:
    from bench.metrology.results.curves import KnotModel

    curves = (curve for each in released.content.over_temperature().values() for curve in (each.scale, each.offset))
    return {knot_c for curve in curves if isinstance(curve, KnotModel) for knot_c in curve.knots_c}


def of_units(found: Mapping[str, Released], plan: Plan, serials: Mapping[str, str]) -> None:
    """Raise InputError if a unit in the run lacks a required calibration, or has that of another unit."""
    if not _entries(plan):
        return
    problems = []
    for place, serial in serials.items():
        if place not in found:
            problems.append(
                f"{plan.document.path}: unit {serial} in place '{place}' is checked against its released "
                f"calibration; give it with {OPTION} {place}=FILE"
            )
        elif found[place].content.uut != serial:
            problems.append(
                f"{found[place].path}: is the calibration of unit {found[place].content.uut}, but the unit in "
                f"place '{place}' is {serial}. Give the file of this unit, or its serial number with --uut "
                f"{place}=SERIAL"
            )
    if problems:
        raise InputError(*problems)
