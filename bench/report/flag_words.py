"""What the flags of units and readings mean, in sentences."""

from __future__ import annotations

import re

from bench.figures.languages import tr
from bench.figures.words import REASONS
from bench.metrology.unlike_nominal import OTHER_SIGN, OTHER_SIZE
from bench.report.note_words import note_in_words
from bench.sequence.method import MethodWords

_READINGS = MethodWords(
    "READINGS",
    {
        "too_few_latches": "fewer than half of its counter readings arrived",
        "counter_restarted": "the counter restarted",
        "irregular_clock": "its clock and its latch numbers contradict each other, as after a restart of the counter",
        "ambiguous_gap": "a gap in which a counter may have wrapped around unnoticed",
        "impossible_rate": "more pulses than the converter can give",
        "dead_band": "no pulse for much longer than its rate implies, as in the dead band of the converter",
        "unstable": "it did not become stable in the time allowed",
        "too_few_voltages": "fewer than two readings of the voltmeter",
        "too_few_codes": "fewer than half of the samples of the unit arrived and are valid",
        "stuck_code": "one constant value, as from a unit that no longer measures",
        "no_temperature": "no temperature of the unit",
        "thermometer": "a temperature that a working thermometer cannot indicate",
        "no_attitude": "the unit was in none of the 24 attitudes, or was rotated about none of its axes",
        "missing": "the instrument that measures the output, or a thermometer, gave no value",
        "saturated": "as many pulses as the converter can give: its input is beyond its range",
        "stuck": "no pulse for much longer than the other rates imply",
        "outlier": "far from the line through the other points, as after lost pulses",
        "accelerometer_temperature": "the accelerometer was not at its temperature",
    },
)
_UNITS = MethodWords(
    "UNITS",
    {
        "not_closed": (
            "Back at the first temperature, the bias differed from its first value by more than the method's "
            "closure_limit: every verdict is marginal."
        ),
        "too_few_repetitions": "Fewer than three repetitions could be evaluated, so that no scatter is stated.",
        "type_a:no_repeats": (
            "No dwell has more readings than unknowns, so that their scatter is unknown; the budgets use "
            "the uncertainty of a single reading instead."
        ),
        "nominal_unknown": (
            "The bench file does not state its nominal scale factor (nominal of its place), so that the expected "
            "output of a step is unknown."
        ),
        "no_sweep": "There is no reading of a sweep, so that nothing can be determined.",
        "hysteresis:equal_histories": (
            "According to the record of the moves, the forward and the reverse pass approached every angle from "
            "the same "
            "side: their difference is no hysteresis, and none is stated. The reverse pass must approach from above: "
            "move with approach: "
            "direct, from the largest angle back."
        ),
        "no_clocking": (
            "The unit was not clocked on its seat: the tilt of the seat, except for the part measured by the level "
            "and the platform, is in the bias and in its uncertainty."
        ),
        "end_up_missing": (
            "The unit was not measured with its +Z up. Over small angles, bias and misalignment cannot be "
            "separated in one "
            "orientation: only the equation of the other orientation is determined, for tests in that orientation."
        ),
        "end_down_missing": (
            "The unit was not measured with its +Z down. Over small angles, bias and misalignment cannot be "
            "separated in "
            "one "
            "orientation: only the equation of the other orientation is determined, for tests in that orientation."
        ),
        "invalid": "The readings of one orientation do not give a calibration.",
        "ill_conditioned": "The angles hardly separate the terms of the model.",
        "marginal": "The calibration is marginal: the temperature changed, or both ends differ by more than allowed.",
        "K2_K3:range_too_small": (
            "Angles below ±30° do not separate K2 and K3 from noise; their effect is in the linearity, the bias and "
            "the scale factor."
        ),
    },
)
_LEFT_OUT = {
    "saturated": "the output was at its limit",
    "outlier": "far from the line and its scatter",
    "missing": "a value in them is missing",
    "duplicate": "they are duplicates",
}
_QUANTITIES = MethodWords(
    "QUANTITIES",
    {
        "too_few_temperatures": "fewer temperatures than the model asked for needs: the model has a lower degree, or "
        "there is none.",
        "ill_conditioned": "the temperatures do not determine the model.",
        "not_determined": "it has a limit, but the run lacks the data to determine it.",
        "insufficient_temperature_span": "its temperature span is too small for a decision.",
        "ramp_too_fast": "its temperature changed faster than allowed.",
        "invalid": "too little of it could be used.",
        "input_drifted": (
            "its input drifted more than allowed between the points at rest; its verdicts, and decisions based "
            "on it, are marginal."
        ),
        "accelerometer_drift": (
            "its slope differs from that of the source at the same level by more than the accelerometer's "
            "drift with its own temperature as stated in the settings (accelerometer_drift_u). The uncertainties at "
            "levels of gravity are those of the drift found. Measure the accelerometer's temperature coefficients, or "
            "look for "
            "another difference between the two levels."
        ),
        "no_points": "the drift of its input is unknown: it needs two points at rest.",
        "slope_follows_level": (
            "its slope differs from that of its reference because its level does: the drift is proportional to "
            "the output. Relative to the outputs the slopes agree; the raw slopes (basis raw) deviate for this reason "
            "alone, "
            "which is no fault of the channel."
        ),
        "slope_same_at_all_levels": (
            "its slope equals that of its reference, although its level differs: the drift is an offset. "
            "Relative to the "
            "outputs the slopes deviate for this reason."
        ),
        "out_of_proportion": (
            "its output is out of proportion to that of the other levels: the fixture, the current, the polarity "
            "or the input of the converter is not the recorded one."
        ),
        "drift_not_linear": (
            "the slopes are not the sum of a constant part and a part proportional to the output: the "
            "drift depends on the level in another way."
        ),
        "no_thermometer": "its temperature is not measured.",
        "not_certified": "it has no certificate: U does not include its gain, offset and drift.",
        "ammeter_missing": "the ammeter in the cable of the source has not read its current.",
        "source_and_ammeter_differ": (
            "the readings of ammeter and source differ by more than three times the uncertainty of their "
            "certificates: one of them is wrong, or current leaks past the ammeter."
        ),
        "temperature_slope_unknown": (
            "its temperature dependence is unknown; U includes the change per 1 °C stated in the settings."
        ),
    },
)
_PARTS = MethodWords(
    "PARTS",
    {
        "part_missing": "part: there is no leg at this input, so that nothing can be determined.",
        "leg_incomplete": "more than half of its samples could not be used.",
        "no_steps": "left out: no step lies between two readings at the position.",
        "not_one_leg": "left out: its set point ends where it began.",
        "not_zero": "the source was off, but the channel had an output: is the accelerometer still connected?",
        "another_angle": "left out: the part has legs at another angle; the method uses one angle.",
    },
)
_ATTITUDES = {
    "missing_position": "Set point {set_c} °C: attitude {what} has no usable reading; its axis is left out there.",
    "missing_rate": "Set point {set_c} °C: rates about {what} are missing; the axis is left out there.",
    "attitude_inconsistent": (
        "Set point {set_c} °C: in attitude {what} the unit seems to have been in another attitude; its axis is left "
        "out there."
    ),
}
_ATTITUDE = re.compile(r"T=(\S+?):(\w+):(\w+)")
_FREQUENCIES = MethodWords("FREQUENCIES", {})
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
