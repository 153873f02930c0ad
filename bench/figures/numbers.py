"""Display of numbers: units and digits."""

from __future__ import annotations

import math

from bench.figures.languages import tr
from bench.metrology.results.finding import LOWER_BOUND, Finding, Interval

# Display of a quantity: the factor from its unit, and the displayed unit.
SHOWN = {
    "K0": (1e6, "µg"),
    "K2": (1e6, "µg/g²"),
    "misalignment": (1e6, "µrad"),
    "K3": (1e6, "µg/g³"),
    "Kip": (1e6, "µg/g²"),
    "asymmetry": (1e6, "ppm"),
    "K0/closure": (1e6, "µg"),
    "level/closure": (1e6, "µrad"),
    "K0/sd": (1e6, "µg"),
    "K1/sd": (1e6, "ppm"),
    "misalignment/sd": (1e6, "µrad"),
    "K0/temperature_coefficient": (1e6, "µg/°C"),
    "K1/temperature_coefficient": (1e6, "ppm/°C"),
    "K0T1": (1e6, "µg/°C"),
    "K0T2": (1e6, "µg/°C²"),
    "K1T1": (1e6, "ppm/°C"),
    "K1T2": (1e6, "ppm/°C²"),
    "K0/hysteresis": (1e6, "µg"),
    "K1/hysteresis": (1e6, "ppm"),
    "K0/model_residual": (1e6, "µg"),
    "K0/model_residual_rms": (1e6, "µg"),
    "K0/repeatability": (1e6, "µg"),
    "K0/largest_jump": (1e6, "µg"),
    "K0/jump": (1e6, "µg"),
    "K0/jumps": (1.0, ""),
    "K1/model_residual": (1e6, "ppm"),
    "D0": (3600.0, "°/h"),
    "gyro_misalignment": (1e6, "µrad"),
    "g_sensitivity": (3600.0, "°/h/g"),
    "K0/change": (1e6, "µg"),
    "K1/change": (1e6, "ppm"),
    "D0/change": (3600.0, "°/h"),
    "KG/change": (1e6, "ppm"),
    "K0/interpolation": (1e6, "µg"),
    "K1/interpolation": (1e6, "ppm"),
    "D0/interpolation": (3600.0, "°/h"),
    "KG/interpolation": (1e6, "ppm"),
    "K1/repeatability": (1e6, "ppm"),
    "D0/repeatability": (3600.0, "°/h"),
    "KG/repeatability": (1e6, "ppm"),
    "K0/power_on": (1e6, "µg"),
    "K1/power_on": (1e6, "ppm"),
    "D0/power_on": (3600.0, "°/h"),
    "KG/power_on": (1e6, "ppm"),
    "K0/warm": (1e6, "µg"),
    "K1/warm": (1e6, "ppm"),
    "D0/warm": (3600.0, "°/h"),
    "KG/warm": (1e6, "ppm"),
    "K0/settling": (1 / 60, "min"),
    "K1/settling": (1 / 60, "min"),
    "D0/settling": (1 / 60, "min"),
    "KG/settling": (1 / 60, "min"),
    "rest_rate": (3600.0, "°/h"),
    "rate_error/relative": (1e6, "ppm"),
    "rest_output": (1e6, "µg"),
    "acceleration_error": (1e6, "µg"),
    "acceleration_error/relative": (1e6, "ppm"),
    "saturated_points": (1.0, ""),
    "scale_error": (1e6, "ppm"),
    "nonlinearity/cubic": (1e6, "ppm"),
    "nonlinearity/quadratic": (1e6, "ppm"),
    "radius": (1e3, "mm"),
    "lever_arm/x": (1e3, "mm"),
    "lever_arm/y": (1e3, "mm"),
    "gain": (1.0, ""),
    "threshold": (1e6, "µg"),
    "resolution": (1e6, "µg"),
    "rate/relative_temperature_coefficient": (1e6, "ppm/°C"),
    "rate/model_residual": (1e6, "ppm"),
    "rate/drift": (1e6, "ppm"),
    "current": (1e3, "mA"),
    "current/deviation": (1e6, "ppm"),
    "deviation/raw": (100.0, "%"),
    "deviation/normalised": (100.0, "%"),
    "tempco_scale": (1e6, "ppm/°C"),
    "scale_difference": (1e6, "ppm"),
    "seat_tilt": (1e6, "µrad"),
    "linearity": (1e6, "ppm"),
    "hysteresis": (1e6, "µg"),
    "verification/largest": (1e6, "µg"),
    "verification/rms": (1e6, "µg"),
}


def shown(finding: Finding) -> str:
    """Value ± expanded uncertainty in the displayed unit, to the digits that the uncertainty justifies.

    A count has no budget and is exact. A settling time is shown with its range, because it cannot be negative.
    """
    factor, _ = SHOWN.get(finding.quantity, (1.0, ""))
    mark = " !" if finding.verdict in ("FAIL", "INVALID") else ""
    if not finding.budget:
        return f"{finding.value * factor:.9g}{mark}"
    if finding.interval is not None and is_told_by_range(finding):
        return f"{_with_range(finding, finding.interval)}{mark}"
    return f"{with_expanded(finding.value * factor, finding.expanded * factor)}{mark}"


def with_expanded(value: float, expanded: float) -> str:
    """A value ± its expanded uncertainty, to the digits that this justifies."""
    digits = decimals(expanded)
    return f"{round(value, digits) + 0.0:.{digits}f} ± {expanded:.{digits}f}"  # never -0.0


def is_told_by_range(finding: Finding) -> bool:
    """True if a range replaces the expanded uncertainty: for a settling time."""
    return finding.interval is not None and finding.quantity.endswith("/settling")


def _with_range(finding: Finding, interval: Interval) -> str:
    """A time with its range, "14 (0 to 35)"; a lower bound as "> 52"."""
    value, low, high = range_shown(finding, interval, finding.value, interval.low, interval.high)
    return f"> {value}" if LOWER_BOUND in finding.flags else f"{value} ({tr('{low} to {high}', low=low, high=high)})"


def range_shown(finding: Finding, interval: Interval, *values: float) -> list[str]:
    """Values in the displayed unit, to the digits that the width of the finding's interval justifies.

    Settling times have at most tenths of a minute.
    """
    factor, _ = SHOWN.get(finding.quantity, (1.0, ""))
    digits = decimals((interval.high - interval.low) * factor)
    if not is_told_by_range(finding):
        return [f"{value * factor:.{digits}f}" for value in values]
    digits = min(digits, 1)
    return [f"{value * factor:.{digits}f}" if round(value * factor, digits) else "0" for value in values]


def decimals(u: float) -> int:
    """Decimals for an uncertainty with two significant digits."""
    if u <= 0:
        return 3
    return max(0, min(9, 1 - math.floor(math.log10(u))))
