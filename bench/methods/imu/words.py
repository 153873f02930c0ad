"""What the flags of tests on inertial units mean, in the words of the people who read a report."""

from __future__ import annotations

REASONS = {
    "within_from_the_start": "it was never outside its limits",
    "perhaps_to_the_end": "it may take longer than the observed time",
    "practically_not_determined": "practically not determined",
}
READINGS = {
    "beyond_calibration": "the unit was outside the temperature range of its calibration",
}
PARTS = {
    "no_power_on": "left out: the time of power-on is not in the record.",
}
QUANTITIES = {
    "start_up_not_determined": "too few readings after power-on to follow it.",
    "moved": "it changed over the run by more than the settings allow: every verdict is marginal.",
    "not_given": "no calibration of the unit was given, so that its output cannot be compensated.",
}

WORDS = {"REASONS": REASONS, "READINGS": READINGS, "PARTS": PARTS, "QUANTITIES": QUANTITIES}
