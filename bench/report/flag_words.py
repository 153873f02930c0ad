"""What the flags of units and readings mean, in sentences."""

from __future__ import annotations

import re

from bench.analysis.unlike_nominal import OTHER_SIGN, OTHER_SIZE
from bench.report import imu_words, table_words
from bench.report.languages import tr
from bench.report.note_words import note_in_words
from bench.report.words import REASONS

_READINGS = {
    **table_words.READINGS,
    **imu_words.READINGS,
    "too_few_latches": "fewer than half of its counter readings came",
    "counter_restarted": "the counter began anew",
    "irregular_clock": "its clock and its reading numbers do not go together, as when the counter begins anew",
    "ambiguous_gap": "a gap in which a counter may have gone round unseen",
    "impossible_rate": "more pulses than the converter can give",
    "dead_band": "no pulse for much longer than its rate lets expect, as in the dead band of the converter",
    "unstable": "it did not become stable in the time that it had",
    "too_few_voltages": "fewer than two readings of the voltmeter",
    "too_few_codes": "fewer than half of the samples that the unit sends came and are valid",
    "stuck_code": "one value again and again, as of a unit that does not measure any more",
    "no_temperature": "no temperature of the unit",
    "thermometer": "a temperature that a working thermometer cannot say",
    "no_attitude": "the unit stood in none of the 24 attitudes, or was turned about none of its axes",
    "missing": "what measures the output, or a thermometer, gave nothing",
    "saturated": "as many pulses as the converter can give: its input is beyond its range",
    "stuck": "no pulse for much longer than the other rates let expect",
    "outlier": "far from the line through the others, as where pulses are lost",
    "accelerometer_temperature": "the accelerometer was not at its temperature",
}
_UNITS = {
    **table_words.UNITS,
    "not_closed": (
        "Back at its first temperature the bias was further from where it began than the method's closure_limit "
        "allows: every verdict is marginal."
    ),
    "too_few_repetitions": "Fewer than three repetitions could be solved, so that nothing is said of how they scatter.",
    "type_a:no_repeats": (
        "No dwell has more readings than unknowns, so their scatter is not known; what a reading alone tells of its "
        "uncertainty stands in the budgets instead."
    ),
    "nominal_unknown": (
        "The bench file does not say its nominal scale factor (nominal of its place), without which it is not known "
        "what a step lets expect."
    ),
    "no_sweep": "There is no reading of a sweep, without which nothing can be determined.",
    "hysteresis:equal_histories": (
        "Forward and reverse came to every angle from the same side, by the record of the moves: their difference is "
        "no hysteresis, and none is stated. The reverse pass is to come from above: move with approach: direct, from "
        "the largest angle back."
    ),
    "no_clocking": (
        "The unit was not clocked on its seat: the tilt of the seat is in the bias, but for what the level and the "
        "platform tell of it, and in its uncertainty."
    ),
    "end_up_missing": (
        "The unit was not measured with its +Z up. Over small angles one end does not tell bias and misalignment "
        "apart: only the equation of the other end is found, for tests in that orientation."
    ),
    "end_down_missing": (
        "The unit was not measured with its +Z down. Over small angles one end does not tell bias and misalignment "
        "apart: only the equation of the other end is found, for tests in that orientation."
    ),
    "invalid": "The readings of an end are no calibration.",
    "ill_conditioned": "The angles hardly tell the terms of the model apart.",
    "marginal": "The calibration is marginal: the temperature changed, or both ends differ by more than they may.",
    "K2_K3:range_too_small": (
        "Angles below ±30° do not tell K2 and K3 from noise; what they do is in the linearity, the bias and the scale "
        "factor."
    ),
}
_LEFT_OUT = {
    "saturated": "the output was at its limit",
    "outlier": "far from the line and its scatter",
    "missing": "something of them is missing",
    "duplicate": "they are there twice",
}
_QUANTITIES = {
    **imu_words.QUANTITIES,
    "too_few_temperatures": "fewer temperatures than the model asked for needs; its degree is lower, or there is none.",
    "ill_conditioned": "the temperatures do not determine the model.",
    "not_determined": "it has a limit, and the run does not hold what it takes to determine it.",
    "insufficient_temperature_span": "its temperatures span too little, so that nothing is decided.",
    "ramp_too_fast": "its temperature went faster than it may.",
    "invalid": "too little of it could be used.",
    "input_drifted": (
        "its input drifted more than it may between the points at rest; its verdicts, and what is decided by it, are "
        "marginal."
    ),
    "accelerometer_drift": (
        "its slope differs from that of the source at the same level by more than the settings state of the "
        "accelerometer's drift with its own temperature (accelerometer_drift_u). The uncertainties at levels of "
        "gravity are those of the drift found. Measure the accelerometer's temperature coefficients, or look for what "
        "else differs between the two levels."
    ),
    "no_points": "no two points at rest tell how its input drifted.",
    "slope_follows_level": (
        "its slope is not that of its reference, because its level is not: the drift is in proportion to the output. "
        "Relative to the outputs the slopes agree; slopes as they are (basis raw) deviate for this reason alone, which "
        "is no fault of the channel."
    ),
    "slope_same_at_all_levels": (
        "its slope is that of its reference, though its level is another: the drift is an offset. Relative to the "
        "outputs the slopes deviate for this reason."
    ),
    "out_of_proportion": (
        "its output is out of proportion to that of the other levels: a wrong fixture, current or polarity, or what "
        "feeds the converter is not what the record says."
    ),
    "drift_not_linear": (
        "the slopes are not a part that is the same at all levels and one in proportion to the output: the drift "
        "depends on the level in another way."
    ),
    "no_thermometer": "nothing reads its temperature.",
    "not_certified": "it has no certificate, so that its gain, offset and drift have no part in U.",
    "ammeter_missing": "the ammeter in the cable of the source has not read its current.",
    "source_and_ammeter_differ": (
        "the ammeter reads another current than the source says, by more than three times what their certificates "
        "admit: one of them is wrong, or current leaks past the ammeter."
    ),
    "temperature_slope_unknown": (
        "how it changes with temperature is not known; U allows for what the settings state for 1 °C."
    ),
}
_PARTS = {
    **table_words.PARTS,
    **imu_words.PARTS,
    "part_missing": "part: there is no leg at this input, without which nothing can be determined.",
    "leg_incomplete": "more than half of its samples could not be used.",
    "no_steps": "left out: it has no step between two readings at the position.",
    "not_one_leg": "left out: it is no leg, its set point ends where it began.",
    "not_zero": "the source gave nothing, and the channel put something out: is the accelerometer still connected?",
    "another_angle": "left out: the part has legs at another angle, and the method is of one.",
}
_ATTITUDES = {
    "missing_position": "Set point {set_c} °C: attitude {what} has no usable reading; its axis is left out there.",
    "missing_rate": "Set point {set_c} °C: rates about {what} are missing; the axis is left out there.",
    "attitude_inconsistent": (
        "Set point {set_c} °C: in attitude {what} the unit seems to have stood otherwise; its axis is left out there."
    ),
}
_ATTITUDE = re.compile(r"T=(\S+?):(\w+):(\w+)")
_FREQUENCIES = table_words.FREQUENCIES
_AT_FREQUENCY = re.compile(r"([\d.e+-]+ Hz) (\w+)")
_SAMPLES = re.compile(r"(?:(.+): )?(\d+) samples(?:: (\w+))")
_LEFT = re.compile(r"(\d+) readings: (\w+)")
_DIFFER = re.compile(r"ends_differ_after:(\d+)")
_INCOMPLETE = re.compile(r"dwell (\d+) incomplete: (.+)")


def _of_one_point(flag: str) -> str:
    """A flag of an attitude or of a frequency in words; empty for any other."""
    attitude = _ATTITUDE.fullmatch(flag)
    if attitude and attitude[2] in _ATTITUDES:
        return tr(_ATTITUDES[attitude[2]], set_c=attitude[1], what=attitude[3])
    at_frequency = _AT_FREQUENCY.fullmatch(flag)
    if at_frequency and at_frequency[2] in _FREQUENCIES:
        return f"{at_frequency[1]}{tr(': ')}{tr(_FREQUENCIES[at_frequency[2]])}"
    return ""


def _of_samples(flag: str) -> str:
    """A flag that counts samples in words; empty for any other."""
    samples = _SAMPLES.fullmatch(flag)
    if samples is None or samples[3] not in _READINGS:
        return ""
    step, count, why = samples[1], samples[2], tr(_READINGS[samples[3]])
    if step:
        return tr("{count} samples are left out: {why} ({step}).", count=count, why=why, step=step)
    return tr("{count} samples are left out: {why}.", count=count, why=why)


def reading_in_words(problem: str) -> str:
    """What makes a reading unusable, in words; what is not known here as it stands."""
    return tr(_READINGS[problem]) if problem in _READINGS else problem


def flag_in_words(flag: str) -> str:
    """A flag of a unit as a sentence; one that is not known here as it stands."""
    if flag in _UNITS:
        return tr(_UNITS[flag])
    if found := _of_one_point(flag):
        return found
    incomplete = _INCOMPLETE.fullmatch(flag)
    if incomplete:
        number, missing = incomplete.groups()
        if missing == "ill_conditioned":
            return tr("Dwell {number} is left out: its readings do not determine the four unknowns.", number=number)
        angles = missing.replace(", ", "°, ") + "°"
        return tr("Dwell {number} is left out: no usable reading near {angles}.", number=number, angles=angles)
    if found := _of_samples(flag):
        return found
    if (left := _LEFT.fullmatch(flag)) and left[2] in _LEFT_OUT:
        return tr("{count} readings are left out: {why}.", count=left[1], why=tr(_LEFT_OUT[left[2]]))
    if differ := _DIFFER.fullmatch(flag):
        return tr("The scale factors of both ends still differ after {count} attempts.", count=differ[1])
    step, _, problem = flag.rpartition(": ")
    if problem in _PARTS:
        return f"{tr(step) if problem == 'part_missing' else step}{tr(': ')}{tr(_PARTS[problem])}"
    if problem in _READINGS:
        return tr("A reading is left out: {why} ({step}).", why=tr(_READINGS[problem]), step=step)
    return _of_a_quantity(flag)


def _of_a_quantity(flag: str) -> str:
    quantity, _, problem = flag.partition(":")
    if problem in (OTHER_SIGN, OTHER_SIZE):
        return f"{quantity}{tr(': ')}{tr(REASONS[problem])}{tr('.')}"
    return f"{quantity}{tr(': ')}{tr(_QUANTITIES[problem])}" if problem in _QUANTITIES else note_in_words(flag)
