"""Words for flags, notes and equations of a channel over temperature in a report."""

from __future__ import annotations

REASONS = {
    "decision_marginal": "the decision on this basis is marginal: it could change if the measurement is repeated",
}
READINGS = {
    "saturated": "as many pulses as the converter can give: its input is beyond its range",
    "stuck": "no pulse for much longer than the other rates imply",
    "outlier": "far from the line through the other points, as after lost pulses",
    "accelerometer_temperature": "the accelerometer was not at its temperature",
}
QUANTITIES = {
    "insufficient_temperature_span": "its temperature span is too small for a decision.",
    "ramp_too_fast": "its temperature changed faster than allowed.",
    "invalid": "too little of it could be used.",
    "input_drifted": (
        "its input drifted more than allowed between the points at rest; its verdicts, and decisions based on it, "
        "are marginal."
    ),
    "accelerometer_drift": (
        "its slope differs from that of the source at the same level by more than the accelerometer's drift with "
        "its own temperature as stated in the settings (accelerometer_drift_u). The uncertainties at levels of "
        "gravity are those of the drift found. Measure the accelerometer's temperature coefficients, or look for "
        "another difference between the two levels."
    ),
    "no_points": "the drift of its input is unknown: it needs two points at rest.",
    "slope_follows_level": (
        "its slope differs from that of its reference because its level does: the drift is proportional to the "
        "output. Relative to the outputs the slopes agree; the raw slopes (basis raw) deviate for this reason "
        "alone, which is no fault of the channel."
    ),
    "slope_same_at_all_levels": (
        "its slope equals that of its reference, although its level differs: the drift is an offset. Relative to "
        "the outputs the slopes deviate for this reason."
    ),
    "out_of_proportion": (
        "its output is out of proportion to that of the other levels: the fixture, the current, the polarity or the"
        " input of the converter is not the recorded one."
    ),
    "drift_not_linear": (
        "the slopes are not the sum of a constant part and a part proportional to the output: the drift depends on "
        "the level in another way."
    ),
    "channel_not_measured": (
        "no acquisition has an input for it: no mount with its axis up, and no current into its channel."
    ),
    "no_thermometer": "its temperature is not measured.",
    "not_certified": "it has no certificate: U does not include its gain, offset and drift.",
    "ammeter_missing": "the ammeter in the cable of the source has not read its current.",
    "source_and_ammeter_differ": (
        "the readings of ammeter and source differ by more than three times the uncertainty of their certificates: "
        "one of them is wrong, or current leaks past the ammeter."
    ),
}
PARTS = {
    "not_zero": "the source was off, but the channel had an output: is the accelerometer still connected?",
}
NAMES = {
    "rate": "output",
}
OWN_INVALID = "no decision: its own run is not valid"
OTHER_INVALID = "no decision: the run it is compared with is not valid"
UNCERTAIN_SLOPE = "no decision: the slope it is compared with is less than three times its uncertainty"
NO_RATE = "no decision: a rate is 0"
OTHER_POLARITY = "keeps its own model: at the other polarity the converter has another scale factor"
HARDLY_ANY_GATES = "only {used} of {count} gates could be used"
FEW_GATES = "fewer than half of its gates could be used, {used} of {count}"
MANY_OUTLIERS = "too many outliers, {outliers} of {count} gates"
THERMOSTAT = "the accelerometer was not at its temperature in {away} of {count} gates; that should end a run"
OTHER_AXIS = (
    "axis {axis} was along the vertical, unlike in mount '{mount}': the accelerometers read {read}. The acquisition is "
    "not used. Fix the unit as the prompt of this set-up asks, and measure it again"
)
ATTITUDE = (
    "the unit was not in mount '{mount}', or an accelerometer was not connected: the accelerometers read {read}. The "
    "acquisition is not used. Fix the unit as the prompt of this set-up asks, and measure it again"
)
OTHER_CHANNEL = (
    "the current of the source was in channel {found} instead of {channel}: at {level} g the channels read {read}. The "
    "acquisition is not used. Plug the cable in as the prompt asks, and measure this channel again"
)
NO_CHANNEL = (
    "the current of the source did not reach channel {channel}, nor another accelerometer channel: at {level} g the "
    "channels read {read}. The acquisition is not used. Plug the cable in as the prompt asks, and measure this channel "
    "again"
)
NOTES = (
    OWN_INVALID, OTHER_INVALID, UNCERTAIN_SLOPE, NO_RATE, OTHER_POLARITY, HARDLY_ANY_GATES, FEW_GATES, MANY_OUTLIERS,
    THERMOSTAT, OTHER_AXIS, ATTITUDE, OTHER_CHANNEL, NO_CHANNEL,
)  # fmt: skip
OWN_SLOPE, SLOPE_FROM, SERVES_TOO = "slope its own", "slope from {level}", "which serves this level too"
FORMS = (OWN_SLOPE, SLOPE_FROM, SERVES_TOO)
VARIABLES = {
    "rate_pps": "rate / (pulse/s)",
}
SOURCES = ("read-outs", "accelerometer", "source")

WORDS = {
    "REASONS": REASONS,
    "READINGS": READINGS,
    "QUANTITIES": QUANTITIES,
    "PARTS": PARTS,
    "NAMES": NAMES,
    "NOTES": NOTES,
    "FORMS": FORMS,
    "VARIABLES": VARIABLES,
    "SOURCES": SOURCES,
}
