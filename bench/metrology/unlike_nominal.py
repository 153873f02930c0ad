"""Scale factors that differ from the nominal ones of the bench file or the sequence in sign or size."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from bench.metrology.results.finding import Finding
from bench.metrology.run_data import UnitUnderTest

OTHER_SIGN = "sign_unlike_nominal"
OTHER_SIZE = "size_unlike_nominal"
SIZES = (0.5, 2.0)  # relative to the nominal scale factor; units of a type agree within a few percent
INVERTED_DEG = 120.0  # phase lag at the lowest frequency that no sensor has


def compared_with_nominal(findings: Sequence[Finding], unit: UnitUnderTest) -> tuple[Finding, ...]:
    """Findings of a unit; those with a scale factor of another sign or size than stated are flagged."""
    swung = [found.at["frequency_hz"] for found in findings if found.quantity == "phase"]
    return tuple(_compared(found, unit, min(swung, default=None)) for found in findings)


def _compared(found: Finding, unit: UnitUnderTest, lowest_hz: float | None) -> Finding:
    if found.quantity == "K1" and unit.nominal_per_g and found.unit == f"{unit.output_unit}/g":
        return _of_ratio(found, found.value / unit.nominal_per_g, found.expanded / abs(unit.nominal_per_g))
    if found.quantity == "scale_error":  # relative to the stated scale factor
        return _of_ratio(found, 1 + found.value, found.expanded)
    if found.quantity == "phase" and found.at["frequency_hz"] == lowest_hz and abs(found.value) > INVERTED_DEG:
        return found.flagged(OTHER_SIGN)
    return found


def _of_ratio(found: Finding, ratio: float, expanded: float) -> Finding:
    """Finding of a scale factor that is `ratio` times the stated one; flagged only if U permits the distinction."""
    flag = unlike_nominal(ratio, expanded)
    return found.flagged(flag) if flag else found


def flags_of_scale(per_g: float, expanded: float, unit: UnitUnderTest) -> Iterator[str]:
    """Flag of a scale factor per g that is not a finding, if the bench file states another sign or size."""
    if unit.nominal_per_g:
        flag = unlike_nominal(per_g / unit.nominal_per_g, expanded / abs(unit.nominal_per_g))
        yield from (f"K1:{each}" for each in (flag,) if each)


def unlike_nominal(ratio: float, expanded: float) -> str:
    """Flag of a scale factor that is `ratio` times the stated one; "" if that is within U or usual."""
    if ratio < -expanded:
        return OTHER_SIGN
    return OTHER_SIZE if ratio + expanded < SIZES[0] or ratio - expanded > SIZES[1] else ""
