"""Scale factors that are not those that the bench file or the sequence states: another sign, another size."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from bench.metrology.results.finding import Finding
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import UnitUnderTest

OTHER_SIGN = "sign_unlike_nominal"
OTHER_SIZE = "size_unlike_nominal"
SIZES = (0.5, 2.0)  # of the nominal scale factor; units of a type are within a few percent of it
INVERTED_DEG = 120.0  # a lag of the phase at the lowest frequency that no sensor has


def compared_with_nominal(findings: Sequence[Finding], unit: UnitUnderTest) -> tuple[Finding, ...]:
    """The findings of a unit, those flagged whose scale factor has another sign or size than is stated."""
    swung = [found.at["frequency_hz"] for found in findings if found.quantity == "phase"]
    return tuple(_compared(found, unit, min(swung, default=None)) for found in findings)


def _compared(found: Finding, unit: UnitUnderTest, lowest_hz: float | None) -> Finding:
    if found.quantity == "K1" and unit.nominal_per_g and found.unit == f"{unit.output_unit}/g":
        return _of_ratio(found, found.value / unit.nominal_per_g, found.expanded / abs(unit.nominal_per_g))
    if found.quantity == "scale_error":  # against the stated scale factor
        return _of_ratio(found, 1 + found.value, found.expanded)
    if found.quantity == "phase" and found.at["frequency_hz"] == lowest_hz and abs(found.value) > INVERTED_DEG:
        return found.flagged(OTHER_SIGN)
    return found


def _of_ratio(found: Finding, ratio: float, expanded: float) -> Finding:
    """The finding of a scale factor that is `ratio` times the stated one; not flagged where U does not tell it."""
    flag = unlike_nominal(ratio, expanded)
    return found.flagged(flag) if flag else found


def flags_of_scale(per_g: float, expanded: float, unit: UnitUnderTest) -> Iterator[Flag]:
    """The flag of a scale factor per g that is no finding, where the bench file states another sign or size."""
    if unit.nominal_per_g:
        flag = unlike_nominal(per_g / unit.nominal_per_g, expanded / abs(unit.nominal_per_g))
        yield from (Flag(each, of="K1") for each in (flag,) if each)


def unlike_nominal(ratio: float, expanded: float) -> str:
    """The flag of a scale factor that is `ratio` times the stated one, "" where that is within U or as usual."""
    if ratio < -expanded:
        return OTHER_SIGN
    return OTHER_SIZE if ratio + expanded < SIZES[0] or ratio - expanded > SIZES[1] else ""
