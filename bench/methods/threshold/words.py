"""Words for the flags of threshold and resolution in a report."""

from __future__ import annotations

REASONS = {
    "at_most": "the smallest step passed already: it is this or less",
    "one_sense": "steps in one direction only, taken for both",
    "not_monotonic": "a step smaller than a failed one passed; it does not count",
    "too_short": "the counting time of some steps was too short: one count is more than a fifth of them",
    "marginal": "one of the two deciding steps is so close to one half that it could change if repeated",
}
UNITS = {
    "nominal_unknown": (
        "The bench file does not state its nominal scale factor (nominal of its place), so that the expected output"
        " of a step is unknown."
    ),
}
PARTS = {
    "no_steps": "left out: no step lies between two readings at the position.",
}
CONDITIONS = {
    "position_deg": "about {value}°",
}
SOURCES = ("ladder",)

WORDS = {"REASONS": REASONS, "UNITS": UNITS, "PARTS": PARTS, "CONDITIONS": CONDITIONS, "SOURCES": SOURCES}
