"""Words for the flags of tumbles in a report."""

from __future__ import annotations

REASONS = {
    "extrapolated": "its reference temperature is outside the measured temperatures",
}
UNITS = {
    "calibration:extrapolated": (
        "Some dwells are outside of the temperatures of the calibration, whose curves keep their end values there."
    ),
    "tilt_of_two:not_determined": (
        "The tilt by both accelerometers of the pair is not found: one has no result, or by the bench file their axes "
        "are not at right angles."
    ),
    "not_closed": (
        "Back at the first temperature, the bias differed from its first value by more than the method's "
        "closure_limit: every verdict is marginal."
    ),
    "too_few_repetitions": "Fewer than three repetitions could be evaluated, so that no scatter is stated.",
    "type_a:no_repeats": (
        "No dwell has more readings than unknowns, so that their scatter is unknown; the budgets use the "
        "uncertainty of a single reading instead."
    ),
    "dwell {number} incomplete: ill_conditioned": (
        "Dwell {number} is left out: its readings do not determine the four unknowns."
    ),
    "dwell {number} incomplete: {angles}": (
        "Dwell {number} is left out: no usable reading near these angles in °: {angles}."
    ),
}
QUANTITIES = {
    "temperature_slope_unknown": (
        "its temperature dependence is unknown; U includes the change per 1 °C stated in the settings."
    ),
}
CONDITIONS = {
    "repetitions": "{value} repetitions",
}
SOURCES = ("residuals of the model", "scatter of the readings of a tumble")

WORDS = {
    "REASONS": REASONS,
    "UNITS": UNITS,
    "QUANTITIES": QUANTITIES,
    "CONDITIONS": CONDITIONS,
    "SOURCES": SOURCES,
}
