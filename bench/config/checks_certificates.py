"""Ranges of certificates, compared with those in which a bench uses its instruments."""

from __future__ import annotations

from collections.abc import Iterator

from bench.config.devices import Calibration, DeviceEntry
from bench.config.document import Problem
from bench.config.models import BenchFile
from drivers.quantity.quantities import Quantity, spell
from drivers.quantity.units import parse_unit
from drivers.schema.fields import InUnit

_ROUNDING = 1e-9
_ANGLE = parse_unit("°").dimension  # tables of angles are of one turn, and hold for all


def range_misfits(bench: BenchFile) -> Iterator[Problem]:
    """Yield instruments whose measuring range is not within that of their certificate."""
    for role, entry in bench.devices.items():
        used = _measured(entry)
        if used is not None and (
            words := _of_others(entry.calibration, used) or _beyond(entry.calibration, -used, used)
        ):
            yield ("devices", role, "options", "range"), f"range: {words}; give it the certificate of this range"


def beyond_certificates(bench: BenchFile) -> Iterator[Problem]:
    """Yield limits of instruments and readings that are wider than the range of their certificate."""
    for role, entry in bench.devices.items():
        for name, limits in entry.limits or ():
            low, high = getattr(limits, "min", None), getattr(limits, "max", None)
            if low is not None and high is not None:
                unit = _unit(type(limits), "max")
                if words := _beyond(entry.calibration, *(_in(unit, side) for side in (low, high))):
                    yield ("devices", role, "limits", name), f"the limits of '{role}' reach to where {words}"
    for name, reading in bench.readings.items():
        if reading.limits is not None:
            low, high = (_in("°C", side) for side in (reading.limits.min, reading.limits.max))
            if words := _beyond(reading.calibration, low, high):
                yield ("readings", name, "limits"), f"the limits of '{name}' reach to where {words}"


def _measured(entry: DeviceEntry) -> Quantity | None:
    """Range of a meter or a source, by its options; None without one."""
    number = getattr(entry.options, "range", None)
    unit = _unit(type(entry.options), "range")
    return _in(unit, number) if isinstance(number, float) and unit else None


def _unit(model: type, name: str) -> str:
    fields = getattr(model, "model_fields", {})
    found = fields[name].metadata if name in fields else ()
    return next((each.unit for each in found if isinstance(each, InUnit)), "")


def _in(unit: str, number: float) -> Quantity:
    known = parse_unit(unit)
    return Quantity(number * float(known.factor), known.dimension)


def _of_others(calibration: Calibration | None, used: Quantity) -> str:
    """Return in words that a certificate covers readings of another kind; "" if it does not."""
    covers = None if calibration is None or calibration.dcc is None else calibration.dcc.covers
    if calibration is None or covers is None or covers[0].dimension == used.dimension:
        return ""
    return f"certificate {calibration.certificate} covers {spell(covers[0])} to {spell(covers[1])} only"


def _beyond(calibration: Calibration | None, low: Quantity, high: Quantity) -> str:
    """Return in words that a range is not within that of a certificate; "" if it is, or nothing is stated of it."""
    covers = None if calibration is None or calibration.dcc is None else calibration.dcc.covers
    if covers is None or covers[0].dimension != high.dimension or high.dimension == _ANGLE:
        return ""
    room = _ROUNDING * max(abs(side.base_value) for side in covers)
    if low.base_value >= covers[0].base_value - room and high.base_value <= covers[1].base_value + room:
        return ""
    assert calibration is not None  # noqa: S101  it has a certificate
    return f"certificate {calibration.certificate} covers {spell(covers[0])} to {spell(covers[1])} only"
