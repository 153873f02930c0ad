"""Words for the flags of tests on inertial units in a report."""

from __future__ import annotations

MISSING_POSITION = "T={set_c}:missing_position:{what}"
MISSING_RATE = "T={set_c}:missing_rate:{what}"
INCONSISTENT = "T={set_c}:attitude_inconsistent:{what}"
REASONS = {
    "within_from_the_start": "it was never outside its limits",
    "perhaps_to_the_end": "it may take longer than the observed time",
    "practically_not_determined": "practically not determined",
}
READINGS = {
    "no_attitude": "the unit was in none of the 24 attitudes, or was rotated about none of its axes",
    "beyond_calibration": "the unit was outside the temperature range of its calibration",
}
UNITS = {
    MISSING_POSITION: ("Set point {set_c} °C: attitude {what} has no usable reading; its axis is left out there."),
    MISSING_RATE: ("Set point {set_c} °C: rates about {what} are missing; the axis is left out there."),
    INCONSISTENT: (
        "Set point {set_c} °C: in attitude {what} the unit seems to have been in another attitude; its axis is left"
        " out there."
    ),
    "T={set_c}:near_zero:{what}": (
        "Set point {set_c} °C: {what} is in the dead band of its converter, or near it, and is left out of K2 and the"
        " misalignments."
    ),
}
QUANTITIES = {
    "start_up_not_determined": "too few readings after power-on to follow it.",
    "moved": "it changed over the run by more than the settings allow: every verdict is marginal.",
    "not_given": "no calibration of the unit was given, so that its output cannot be compensated.",
}
PARTS = {
    "no_power_on": "left out: the time of power-on is not in the record.",
}
NO_LATITUDE = "headings were not checked: the latitude is not known"
HEADINGS_UNKNOWN = "the gyros do not tell the headings of {untold} of {count} attitudes"
NORTH_ELSEWHERE = "the horizontal gyros saw north elsewhere than scheduled: {axes}"
FEW_TEMPERATURES = "the thermometer of {sensor} gave fewer than half of its readings"
NOMINAL_UNREACHED = "the nominal temperature is beyond the temperatures of {sensors}: their outputs were not regressed"
THERMOMETER_APART = "the thermometer of {sensor} is up to {apart} °C from those of its triad; is it at its sensor?"
OTHER_THERMOMETER = "{sensor} is calibrated over {thermometer}; here its temperature is that of {read}"
NOTES = (
    NO_LATITUDE,
    HEADINGS_UNKNOWN,
    NORTH_ELSEWHERE,
    FEW_TEMPERATURES,
    NOMINAL_UNREACHED,
    OTHER_THERMOMETER,
    THERMOMETER_APART,
)
SOURCES = ("power-on", "computer", "gyro", "readings of the rates", "K2 of the accelerometer")

WORDS = {
    "REASONS": REASONS,
    "READINGS": READINGS,
    "UNITS": UNITS,
    "QUANTITIES": QUANTITIES,
    "PARTS": PARTS,
    "NOTES": NOTES,
    "SOURCES": SOURCES,
}
