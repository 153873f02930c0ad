"""What the flags of tests on inertial units mean, in the words of the people who read a report."""

from __future__ import annotations

REASONS = {
    "within_from_the_start": "it was never outside its limits",
    "perhaps_to_the_end": "it may take longer than was watched",
    "practically_not_determined": "practically not determined",
}
READINGS = {
    "beyond_calibration": "the unit was colder or warmer than its calibration is known at",
}
PARTS = {
    "no_power_on": "left out: the run does not tell when the unit was put on.",
}
QUANTITIES = {
    "start_up_not_determined": "too few readings after power-on to follow it.",
    "moved": "it changed over the run by more than the settings allow: every verdict is marginal.",
    "not_given": "the run was not given one for the unit, without which nothing can be compensated.",
}
