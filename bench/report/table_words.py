"""What the flags of tests on a rate table mean, in the words of the people who read a report."""

from __future__ import annotations

CONDITIONS = {"acceleration_g": "g", "rate_dps": "°/s", "frequency_hz": "Hz"}
"""Of a point, with their units."""
REASONS = {
    "clipped": "the sensor is at the end of its range",
    "off_rate": "the table did not turn at the rate that it was told",
}
READINGS = {
    "no_encoder": "the encoder of the table was latched by nothing",
    "no_common_clock": "its output has no clock in common with the encoder of the table, which a swing needs",
    "not_at_rest": "the table moved",
    "not_swinging": "the table did not swing",
}
UNITS = {
    "rest_missing": "There is no usable reading at rest, without which the bias and all errors are unknown.",
    "rest_of_one_angle": (
        "The readings at rest are not at angles all round the turn, so that a tilt of the axis is in the bias."
    ),
    "too_few_low_rates": "Fewer than two usable rates are low enough for the radius, without which nothing is known.",
    "radius_not_determined": "The low rates do not determine the radius, without which no error is known.",
    "several_crossings": "The gain falls through -3 dB more than once; the bandwidth is where it first does.",
    "bandwidth_not_reached": (
        "The gain does not fall to -3 dB up to the highest frequency; the bandwidth is above that."
    ),
    "bandwidth_below_at_start": (
        "The gain is below -3 dB at the lowest frequency already; the bandwidth is below that."
    ),
    "lever_arm_short": (
        "The arm across the input axis is shorter than 5 mm, so that the gains are hardly known; their U says how well."
    ),
    "lever_arm_unlike_bench_file": (
        "The arms that the accelerometer found are not those of the bench file: is it in its place, and turned rightly?"
    ),
    "radius_unlike_bench_file": (
        "The radius that the accelerometer found is not that of the bench file: its scale factor is not what is "
        "stated, at this temperature, or it is not in its place."
    ),
    "no_response": "There is no frequency with a response.",
}
PARTS = {
    "off_rate": "not judged: the table did not turn at the rate that it was told.",
    "clipped": "the sensor is at the end of its range: more than 1 % of its samples are at the clip level.",
}
FREQUENCIES = {
    "invalid": "left out: its samples tell no sine of the table or of the sensor.",
    "droop": "left out: the table swung with less than half of the amplitude that it had at the lowest frequency.",
    "phase_step": "its phase differs by more than 120° from that before; whole turns between them may be lost.",
    "few_phases": "the samples see few phases of the swing, so that the steps of the encoder do not average out.",
    "off_frequency": "the table swung at another frequency than it was told, by more than a part in a thousand.",
}
