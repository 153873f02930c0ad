"""Words for flags, notes and equations on an indexing table in a report."""

from __future__ import annotations

REASONS = {
    "ends_differ": "more than allowed; the remaining difference is the cross coupling",
}
UNITS = {
    "no_sweep": "There is no reading of a sweep, so that nothing can be determined.",
    "hysteresis:equal_histories": (
        "According to the record of the moves, the forward and the reverse pass approached every angle from the "
        "same side: their difference is no hysteresis, and none is stated. The reverse pass must approach from "
        "above: move with approach: direct, from the largest angle back."
    ),
    "no_clocking": (
        "The unit was not clocked on its seat: the tilt of the seat, except for the part measured by the level and "
        "the platform, is in the bias and in its uncertainty."
    ),
    "end_up_missing": (
        "The unit was not measured with its +Z up. Over small angles, bias and misalignment cannot be separated in "
        "one orientation: only the equation of the other orientation is determined, for tests in that orientation."
    ),
    "end_down_missing": (
        "The unit was not measured with its +Z down. Over small angles, bias and misalignment cannot be separated "
        "in one orientation: only the equation of the other orientation is determined, for tests in that "
        "orientation."
    ),
    "verification:corrected": (
        "The readings of the verification differ from the equation of their end by more than their uncertainty "
        "explains (F test, 95 %): bias or scale factor have changed since the sweeps. The corrected equation is the "
        "line through these readings; the equation for use in orbit is still that of the sweeps."
    ),
    "sides:incomplete": (
        "The unit was not measured, or not with enough usable readings, both with its +Y up and with its +Y down: its "
        "cross coupling with Y and its misalignment towards Y are not determined."
    ),
    "invalid": "The readings of one orientation do not give a calibration.",
    "ill_conditioned": "The angles hardly separate the terms of the model.",
    "marginal": "The calibration is marginal: the temperature changed, or both ends differ by more than allowed.",
    "K2_K3:range_too_small": (
        "Angles below ±30° do not separate K2 and K3 from noise; their effect is in the linearity, the bias and the"
        " scale factor."
    ),
    "ends_differ_after:{count}": "The scale factors of both ends still differ after {count} attempts.",
    "{count} readings: saturated": "{count} readings are left out: the output was at its limit.",
    "{count} readings: outlier": "{count} readings are left out: far from the line and its scatter.",
    "{count} readings: missing": "{count} readings are left out: a value in them is missing.",
    "{count} readings: duplicate": "{count} readings are left out: they are duplicates.",
}
FEW_ANGLES = "fewer than {least} different angles are left"
MANY_OUTLIERS = "{outliers} of {count} dwells are outliers"
NO_LINE = "its angles do not determine a line"
NOT_FOLLOWING = "its output does not follow the angle"
NO_DWELL = "none of its dwells can be used"
DRIFTS = "the bias drifts by {drift} V per dwell; b_V is the bias at the first dwell of all"
REPEATS = (
    "the residuals repeat themselves {periods} times over the angles; see whether the output beats with the sampling, "
    "or resonates"
)
WARMED = "the temperature changed by {change} °C"
LEFT_OUT = {
    "missing": "rows left out because something is missing in them: {count}",
    "duplicate": "rows left out because they are there twice: {count}",
}
NOTES = (
    FEW_ANGLES, MANY_OUTLIERS, NO_LINE, NOT_FOLLOWING, NO_DWELL, DRIFTS, REPEATS, WARMED, *LEFT_OUT.values(),
)  # fmt: skip
ORBIT = ("U the output", "a along the input axis in g")
ON_THE_GROUND = {"up": "on the ground with +Z up", "down": "on the ground with +Z down"}
CORRECTED = "corrected by the verification"
ENDS = ("s = +1 with +Z up", "-1 with it down")
FORMS = (*ORBIT, *ON_THE_GROUND.values(), CORRECTED, *ENDS)
WHERE = {
    "end up": "+Z up",
    "end down": "+Z down",
    "side up": "+Y up",
    "side down": "+Y down",
    "model": "model of all readings",
    "clock": "clock",
}
VARIABLES = {
    "input_g": "input / g",
}
SOURCES = ("platform",)

WORDS = {
    "REASONS": REASONS,
    "UNITS": UNITS,
    "NOTES": NOTES,
    "FORMS": FORMS,
    "WHERE": WHERE,
    "VARIABLES": VARIABLES,
    "SOURCES": SOURCES,
}
