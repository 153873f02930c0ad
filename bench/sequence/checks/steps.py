"""Check of a step against its bench: the device it acts on, and values beyond the limits of the bench file.

The same check is made before the run and, for steps with measured values, during it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, assert_never

from pydantic import ValidationError

from bench.config.devices import DeviceEntry
from bench.config.models import BenchFile
from bench.sequence.checks.acquired import steady_problems, without_nominal
from bench.sequence.checks.motion import resolution_problems
from bench.sequence.language.readings import (
    is_pulse_rate,
    measured_place,
    problem_with,
    problem_with_output,
    unit_of,
    units_at,
)
from bench.sequence.steps.custom import Custom, known_steps
from bench.sequence.steps.fields import is_known
from bench.sequence.steps.limits import unit_problems
from bench.sequence.steps.measuring import Acquire, Measure, Tare
from bench.sequence.steps.orienting import Orient
from bench.sequence.steps.stimulus import Move, Oscillate, Ramp, Rotate, SetOutput
from bench.sequence.steps.talk import Alarm, Note, Prompt
from bench.sequence.steps.verbs import NEEDS, Step, verb_of
from bench.sequence.steps.waits import Soak, Wait, WaitUntil
from drivers.capabilities import OUTPUT
from drivers.quantity.units import QuantityError, quoted
from drivers.schema.suggest import did_you_mean
from drivers.schema.wording import error_text

COUNTS_OF_A_SINE = 20  # of the encoder; the peak angle must be at least this
Found = Iterator[tuple[str, str]]  # (key with the problem, problem)


def role_problems(step: Step, needs: Mapping[str, str], bench: BenchFile | None) -> Found:
    """Problems of a role or reading: not among the needs, or not capable of the step."""
    match step:
        case Wait() | Note() | Alarm() | Prompt():
            return
        case Orient():
            yield from _without_axes(bench)
        case WaitUntil() if step.steady is not None:
            if problem := problem_with_output(step.reading, needs, bench):
                yield "wait_until", problem
        case WaitUntil() | Measure() | Tare():
            if problem := problem_with(step.reading, needs, bench):
                yield verb_of(step), problem
        case Custom():
            yield from _custom(step, needs)
        case _:
            yield from _role(step.role, verb_of(step), NEEDS[verb_of(step)], needs)
            if isinstance(step, SetOutput):
                yield from _kind_of_level(step, needs.get(step.role))
            if isinstance(step, Acquire) and step.of is not None:
                yield from _role(step.of, "of", ("rate_table",), needs)


def _role(role: str, key: str, kinds: tuple[str, ...], needs: Mapping[str, str]) -> Found:
    kind = needs.get(role)
    if kind is None:
        yield key, f"'{role}' is not among the needs of the sequence{did_you_mean(role, needs)}"
    elif kind not in kinds:
        yield key, f"'{key}' needs a {' or '.join(kinds)}, '{role}' is a {kind}"


def _without_axes(bench: BenchFile | None) -> Found:
    """Reason why a bench cannot orient units; "" if it can."""
    if bench is None:
        return
    if not bench.axes:
        yield "orient", "the bench has no axes: its fixture names none, and there is no head"
    for role in bench.axes:
        if "positioner" not in bench.devices[role].description.capabilities:
            yield "orient", f"'{role}' turns only at rates; it cannot be moved to an angle"


def _kind_of_level(step: SetOutput, kind: str | None) -> Found:
    if kind == "power_supply":
        for key, value in (("current", step.current_a), ("acceleration", step.acceleration_g)):
            if value is not None:
                yield key, f"'{step.role}' is a power_supply, which takes voltage and current_limit"
    if kind == "current_source" and step.voltage_v is not None:
        yield "voltage", f"'{step.role}' is a current_source, which takes current and compliance"


def _custom(step: Custom, needs: Mapping[str, str]) -> Found:
    description = known_steps().get(step.name)
    if description is None:
        yield "custom", f"there is no plug-in with a step {quoted(step.name)}{did_you_mean(step.name, known_steps())}"
        return
    if step.value_name is not None and description.example is None:
        yield "as", f"'{step.name}' returns no value that 'as' could name"
    if description.capability and step.role is None:
        yield "custom", f"'{step.name}' acts on a {description.capability}; name one with role"
    elif step.role is not None:
        yield from _role(step.role, "role", (description.capability,), needs)
    try:
        description.settings.model_validate(dict(step.settings))
    except ValidationError as error:
        for item in error.errors(include_url=False):
            yield "with", f"{'.'.join(map(str, ('with', *item['loc'])))}: {error_text(item)}"


def is_there(step: Step, needs: Mapping[str, str], bench: BenchFile) -> bool:
    """True if the bench has the device of the step; a missing one is reported with the needs."""
    if isinstance(step, WaitUntil) and step.steady is not None:
        return bool(units_at(step.reading, bench))
    if isinstance(step, (WaitUntil, Measure, Tare)):
        return unit_of(step.reading, bench) is not None
    if isinstance(step, (Wait, Note, Alarm, Prompt, Soak, Custom, Orient)) or needs[step.role] == OUTPUT:
        return True
    device = bench.devices.get(bench.members(step.role)[0])
    return device is not None and needs[step.role] in device.description.capabilities


def limit_problems(  # noqa: C901  one case for each kind of step
    step: Step, bench: BenchFile, from_deg: float = 0.0
) -> Found:
    """Values beyond the limits of the bench file; a move begins at the target of the last one, `from_deg`."""
    match step:
        case Move():
            yield from _move(step, bench.devices[step.role], step.target_deg(from_deg))
        case Rotate():
            yield from _rotate(step, bench.devices[step.role], from_deg)
        case Oscillate():
            yield from _oscillate(step, bench.devices[step.role])
        case Ramp():
            chamber = bench.devices[step.role]
            yield from _beyond(chamber, step.role, "to", "temperature", step.temperature_c, "°C")
            yield from _beyond(chamber, step.role, "at", "ramp_rate", step.rate_c_per_min, "°C/min")
        case SetOutput():
            for role in bench.members(step.role):
                yield from _output(step, role, bench)
        case Soak():
            if step.give_up_after_s is not None and step.give_up_after_s < step.least_s:
                yield "give_up_after", "is shorter than the soak itself"
        case WaitUntil() if step.steady is not None:
            yield from steady_problems(step.steady, units_at(step.reading, bench), bench)
        case WaitUntil():
            if measured_place(step.reading, bench) is not None:
                yield "wait_until", f"{step.reading} has no continuous reading; use a measure step"
            for key, bound in (("above", step.above), ("below", step.below)):
                if bound is not None and is_known(bound):
                    yield from _in_unit(key, bound, unit_of(step.reading, bench))
        case Measure():
            yield from _measure(step, bench)
        case Acquire():
            yield from resolution_problems(step)
            if step.until_stable is not None:
                yield from without_nominal("until_stable", bench.places, bench)
        case Tare():
            yield from _one(step.reading, "tare", bench)
        case Custom():
            yield from _one(step.role or "", "custom", bench)
        case Wait() | Note() | Alarm() | Orient():
            pass
        case Prompt():
            yield from _prompt(step, bench)
        case _:
            assert_never(step)


def _move(step: Move, head: DeviceEntry, target_deg: float) -> Found:
    if "positioner" not in head.description.capabilities:
        yield "move", f"'{step.role}' turns only at rates; it cannot be moved to an angle"
    key = "by" if step.by_deg is not None else "to"
    target = list(_beyond(head, step.role, key, "angle", target_deg, "°"))
    yield from target
    if not getattr(head.options, "is_index_position", lambda _deg: True)(target_deg):
        tooth_deg = head.options.index_step
        yield key, f"{target_deg:.12g} ° is between two teeth of '{step.role}', which are {tooth_deg:.9g} ° apart"
    if not target and step.approach != "direct":
        distance_deg = getattr(head.options, "approach_distance", 0.0)
        start_deg = target_deg + (distance_deg if step.approach == "from_above" else -distance_deg)
        for _, problem in _beyond(head, step.role, "approach", "angle", start_deg, "°"):
            yield "approach", f"begins where {problem}"


def _rotate(step: Rotate, table: DeviceEntry, from_deg: float) -> Found:
    yield from _beyond(table, step.role, "at", "rate", abs(step.rate_dps), "°/s")
    if step.acceleration_dps2 is not None:
        yield from _beyond(table, step.role, "acceleration", "acceleration", step.acceleration_dps2, "°/s²")
    if step.during is None:
        end_deg = from_deg + math.copysign(step.least_s * abs(step.rate_dps), step.rate_dps)
        for _, problem in _beyond(table, step.role, "at", "angle", end_deg, "°"):
            yield ("turns" if step.turns is not None else "for"), f"ends where {problem}"


def _oscillate(step: Oscillate, table: DeviceEntry) -> Found:
    """Limits of a sine: it needs a rate of amplitude × ω and an acceleration of amplitude × ω² (equations 5.1).

    The acceleration needs torque, and the amplitude must be at least 20 counts of the encoder.
    """
    omega = 2 * math.pi * step.highest_hz
    yield from _beyond(table, step.role, "sweep" if step.sweep else "frequency", "frequency", step.highest_hz, "Hz")
    for limit, value, unit in (
        ("rate", step.amplitude_deg * omega, "°/s"), ("acceleration", step.amplitude_deg * omega**2, "°/s²"),
    ):  # fmt: skip
        for key, problem in _beyond(table, step.role, "amplitude", limit, value, unit):
            allowed = getattr(getattr(table.limits, limit, None), "max", math.nan)
            most_deg = step.amplitude_deg * allowed / value
            yield (
                key,
                f"at {step.highest_hz:.6g} Hz, {problem}; the largest possible amplitude is {most_deg:.3g}° goes there",
            )
    inertia: float | None = getattr(table.options, "inertia", None)
    if inertia is not None:
        torque_nm = inertia * math.radians(step.amplitude_deg) * omega**2
        yield from _beyond(table, step.role, "amplitude", "torque", torque_nm, "N·m")
    resolution_arcsec: float | None = getattr(table.options, "encoder_resolution", None)
    if resolution_arcsec is not None and step.amplitude_deg * 3600 < COUNTS_OF_A_SINE * resolution_arcsec:
        least_deg = COUNTS_OF_A_SINE * resolution_arcsec / 3600
        yield "amplitude", f"is less than {COUNTS_OF_A_SINE} counts of the encoder; expected at least {least_deg:.3g}°"


def _output(step: SetOutput, role: str, bench: BenchFile) -> Found:
    source = bench.devices[role]
    current_a, key = step.current_a, "current"
    if step.acceleration_g is not None and step.place is not None:
        place, key = bench.places.get(step.place), "acceleration"
        if place is None:
            yield "place", f"the bench has no unit in place '{step.place}'{did_you_mean(step.place, bench.places)}"
            return
        if place.nominal is None or place.nominal.K1 is None:
            yield "place", f"places.{step.place} of the bench file has no nominal K1, which makes g a current"
            return
        current_a = step.acceleration_g * place.nominal.amperes_per_g
    for name, limit, value, unit in (
        ("voltage", "voltage", step.voltage_v, "V"),
        ("current_limit", "current", step.current_limit_a, "A"),
        (key, "current", current_a, "A"),
    ):
        if value is not None:
            yield from _beyond(source, role, name, limit, value, unit)
    for name, unit_place in bench.places.items():
        most_a = unit_place.nominal.max_current if unit_place.nominal else None
        fed = step.place in (None, name) and unit_place.source == role
        if fed and current_a is not None and most_a is not None and abs(current_a) > most_a:
            yield key, f"{current_a:.6g} A is more than the {most_a:.6g} A that the unit in place '{name}' takes"
        load_ohm = unit_place.nominal.load if unit_place.nominal else None
        if fed and None not in (current_a, load_ohm, step.compliance_v):
            in_all_ohm = (load_ohm or 0.0) + bench.burden_ohm(role)
            yield from _too_little_compliance(step, key, name, abs(current_a or 0.0) * in_all_ohm)
    most_v = getattr(source.options, "compliance", None)
    if step.compliance_v is not None and most_v is not None and step.compliance_v > most_v:
        yield "compliance", _outside(step.compliance_v, "above", most_v, "V", role)


def _too_little_compliance(step: SetOutput, key: str, place: str, needed_v: float) -> Found:
    """Problem of a current whose voltage at the unit's input exceeds the compliance of the source."""
    if step.compliance_v is not None and needed_v > step.compliance_v:
        yield (
            key,
            f"the unit in place '{place}' needs {needed_v:.6g} V for it, the compliance is {step.compliance_v:g} V",
        )


def _one(name: str, key: str, bench: BenchFile) -> Found:
    """Problem of a group name where one member is needed."""
    if len(members := bench.members(name)) > 1:
        yield key, f"'{name}' of the bench is a group of {', '.join(members)}; name one of them"


def _measure(step: Measure, bench: BenchFile) -> Found:
    yield from _one(step.reading, "measure", bench)
    unit = unit_of(step.reading, bench)
    if step.duration_s is None and is_pulse_rate(step.reading, bench):
        yield "measure", "a pulse rate is counted over a time: give 'for'"
    if step.duration_s is None and measured_place(step.reading, bench) is not None:
        yield "measure", "the output of a unit is measured over a time: give 'for'"
    if step.limits is not None and unit is not None:
        for _, problem in unit_problems(step.limits, unit):
            yield "limits", problem


def _prompt(step: Prompt, bench: BenchFile) -> Found:
    mount = step.expect.mount if step.expect else None
    if mount is not None and mount not in bench.fixture.mounts:
        yield "expect", f"the fixture of the bench has no mount '{mount}'{did_you_mean(mount, bench.fixture.mounts)}"


def _in_unit(key: str, value: Any, unit: str | None) -> Found:
    try:
        value.to(unit or "")
    except QuantityError as problem:
        yield key, str(problem)


def _beyond(device: DeviceEntry, role: str, key: str, limit: str, value: float, unit: str) -> Found:
    """A problem when a value is outside the bench file's limit of that name."""
    allowed: Any = getattr(device.limits, limit, None)
    low, high = getattr(allowed, "min", None), getattr(allowed, "max", None)
    if low is not None and value < low:
        yield key, _outside(value, "below", low, unit, role)
    if high is not None and value > high:
        yield key, _outside(value, "above", high, unit, role)


def _outside(value: float, where: str, limit: float, unit: str, role: str) -> str:
    return f"{value:.12g} {unit} is {where} the {limit:.12g} {unit} that the bench file allows '{role}'"
