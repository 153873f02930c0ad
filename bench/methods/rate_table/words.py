"""Words for the flags of tests on a rate table in a report."""

from __future__ import annotations

REASONS = {
    "clipped": "the sensor is at the end of its range",
    "off_rate": "the table did not turn at the commanded rate",
}
READINGS = {
    "no_encoder": "the encoder of the table was not latched",
    "no_common_clock": "its output shares no clock with the encoder of the table, as a swing requires",
    "not_at_rest": "the table moved",
    "not_swinging": "the table did not swing",
    "not_one_swing": "its channels and the encoder were not latched together: they record different motions",
    "mounting_unlike_sequence": (
        "the accelerometer that should point along the axis does not read gravity: the unit is not mounted as the "
        "sequence says; the results of this mounting are those of other axes"
    ),
    "not_swept": "the frequency did not change as commanded, or too fast",
}
UNITS = {
    "rest_missing": "There is no usable reading at rest, so that the bias and all errors are unknown.",
    "warming_up": (
        "The temperature of the unit changed by {change} °C during the readings, and its scale factor by up to "
        "{ppm} ppm with it: each error is that at its own temperature. Let the unit warm up for longer."
    ),
    "rest_of_one_angle": "The readings at rest do not cover a full turn, so that a tilt of the axis is in the bias.",
    "too_few_low_rates": (
        "Fewer than two usable rates are low enough to determine the radius, so that no error is known."
    ),
    "radius_not_determined": "The low rates do not determine the radius, so that no error is known.",
    "several_crossings": "The gain falls below -3 dB more than once; the bandwidth is at the first crossing.",
    "bandwidth_not_reached": (
        "The gain does not fall to -3 dB up to the highest frequency; the bandwidth is above that."
    ),
    "bandwidth_left_out": (
        "The gain does not fall to -3 dB up to {frequency} Hz, and higher frequencies are left out; the bandwidth is "
        "above {frequency} Hz and not known."
    ),
    "bandwidth_below_at_start": "The gain is below -3 dB at the lowest frequency already; the bandwidth is below that.",
    "lever_arm_short": (
        "The arm across the input axis is shorter than 5 mm, so that the gains are poorly known; see their U."
    ),
    "lever_arm_unlike_bench_file": (
        "The lever arms determined with the accelerometer differ from those in the bench file: is it in its place "
        "and correctly oriented?"
    ),
    "radius_unlike_bench_file": (
        "The radius determined with the accelerometer differs from that in the bench file: its scale factor at this"
        " temperature is not as stated, or it is not in its place."
    ),
    "{mount}: no_sensor": (
        "Mounting {mount}: no gyro points along the axis of the table, or no accelerometer is level, as the method "
        "needs."
    ),
    "no_response": "No frequency has a usable response.",
    "{frequency} Hz invalid": (
        "{frequency} Hz: left out: no sine can be fitted to its samples of the table or of the sensor."
    ),
    "{frequency} Hz droop": (
        "{frequency} Hz: left out: the table swung with less than half of the amplitude that it had at the lowest "
        "frequency."
    ),
    "{frequency} Hz few_pulses": (
        "{frequency} Hz: left out: the unit gave too few pulses from one reversal to the next for the play of its "
        "converter to be taken out; oscillate with a larger peak rate there, or an accelerometer on a longer arm."
    ),
    "{frequency} Hz phase_step": (
        "{frequency} Hz: its phase differs by more than 120° from the previous one; whole turns between them may be"
        " lost."
    ),
    "{frequency} Hz few_phases": (
        "{frequency} Hz: the samples cover few phases of the swing, so that the quantisation of the encoder does "
        "not average out."
    ),
    "{frequency} Hz off_frequency": (
        "{frequency} Hz: the frequency of the swing differed from the commanded one by more than 0.1 %."
    ),
}
PARTS = {
    "off_rate": "not judged: the table did not turn at the commanded rate.",
    "clipped": "the sensor is at the end of its range: more than 1 % of its samples are at the clip level.",
}
CONDITIONS = {
    "acceleration_g": "{value} g",
    "rate_dps": "{value} °/s",
    "frequency_hz": "{value} Hz",
}
VARIABLES = {
    "rate_dps": "rate of the table / °/s",
    "frequency_hz": "frequency / Hz",
}
SOURCES = (
    "sensor",
    "encoder",
    "axis",
    "low rates",
    "lever arm",
    "lowest frequency",
    "stretch of the arm",
    "misalignment of the input axis",
    "second-order nonlinearity of the sensor at low rates",
    "sensor and voltmeter",
    "low rates and voltmeter",
)

WORDS = {
    "REASONS": REASONS,
    "READINGS": READINGS,
    "UNITS": UNITS,
    "PARTS": PARTS,
    "CONDITIONS": CONDITIONS,
    "VARIABLES": VARIABLES,
    "SOURCES": SOURCES,
}
