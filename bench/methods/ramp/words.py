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
SOURCES = ("lag behind the thermometer, and the unit's response to the rate",)

WORDS = {"REASONS": REASONS, "PARTS": PARTS, "SOURCES": SOURCES}
