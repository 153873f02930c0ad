"""Words for the flags of temperature ramps in a report."""

from __future__ import annotations

REASONS = {
    "lag": "the loop is a lag behind the thermometer, not hysteresis: a model with dT/dt removes most of it",
}
PARTS = {
    "part_missing": "part: there is no leg at this input, so that nothing can be determined.",
    "leg_incomplete": "more than half of its samples could not be used.",
    "not_one_leg": "left out: its set point ends where it began.",
    "another_angle": "left out: the part has legs at another angle; the method uses one angle.",
}
UNITS = {
    "calibration:no_dynamic_model": (
        "The calibration has no dynamic model of the bias, which a ramp determines: results of the dynamic model are "
        "those of its curves over temperature."
    ),
    "calibration:samples_extrapolated": (
        "Some samples are outside of the temperatures of the calibration, whose curves keep their end values there."
    ),
    "calibration:faster": (
        "The temperature changed faster than in the run of the dynamic model, which is extrapolated."
    ),
}
VARIABLES = {"rate_c_per_min": "dT/dt / °C/min"}
SOURCES = ("lag behind the thermometer, and the unit's response to the rate",)

WORDS = {"UNITS": UNITS, "VARIABLES": VARIABLES, "REASONS": REASONS, "PARTS": PARTS, "SOURCES": SOURCES}
