"""What states, flags, quantities and conditions mean, in the words of the people who read a report."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from bench.analysis.finding import LOWER_BOUND, Finding
from bench.analysis.limits import GUARD_BANDS_MEET, IN_GUARD_BAND, U_UNKNOWN, Limits
from bench.report import imu_words, table_words
from bench.report.languages import tr
from bench.report.shown import SHOWN

ENDINGS = {
    "completed": "It ran to its end.",
    "error": "It was ended by a problem of the bench; what was measured until then is evaluated here.",
    "failed": "It was ended because a value was outside its limits, as the sequence says.",
    "aborted": "It was ended by the operator; what was measured until then is evaluated here.",
    "interrupted": (
        "It was interrupted: the program, the computer or its power stopped before the run was over. What was "
        "on the disk until then is evaluated here."
    ),
    "running": "It was still going on when this report was written.",
}
QUANTITIES = {"K1": "K1 per local g", "K1_si": "K1 per m/s²", "K2": "K2 + asymmetry"}
REASONS = {
    **table_words.REASONS,
    **imu_words.REASONS,
    IN_GUARD_BAND: "inside its limits, but within their guard band",
    GUARD_BANDS_MEET: "its uncertainty is so large that no value could pass the guard band",
    U_UNKNOWN: "its uncertainty is not known, and the guard band needs it",
    "extrapolated": "its reference temperature is outside of the temperatures that were measured",
    LOWER_BOUND: "it is more than this, and how much more was not measured",
    "at_most": "the smallest step passed already: it is this or less",
    "one_sense": "steps of one sense only, which are taken for both",
    "not_monotonic": "a smaller step passed than one that failed, which does not count",
    "too_short": "some steps were counted too short: one count is more than a fifth of them",
    "marginal": "one of the two steps that decide is so near one half that it could be otherwise if repeated",
    "not_closed": "the unit or its table was not at the end of the run as at its beginning",
    "ends_differ": "more than they may; what stays is the cross coupling",
    "lag": "the loop is a lag behind the thermometer, not hysteresis: a model with dT/dt removes most of it",
}
# What sources of uncertainty are of, besides the names of readings.
SOURCES = (
    "head", "fixture", "platform", "counter", "site", "readings", "samples", "bias", "K1", "ladder", "power-on",
    "asymmetry of the converter", "read-outs", "points", "accelerometer", "source", "sensor", "encoder", "axis",
    "low rates", "lever arm", "scale factor", "fit and readings",
    "lowest frequency",
    "lag behind the thermometer, and the unit's response to the rate",
)  # fmt: skip
ON_A_TABLE = {"acceleration_g": "g", "rate_dps": "°/s", "frequency_hz": "Hz"}  # conditions of a point, and their units
CONTENTS = {
    "contains:K2": "contains K2",
    "contains:K3": "contains K3",
    "contains:asymmetry": "contains the asymmetry of converter or voltmeter",
}

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
    "missing": "a counter or a thermometer gave nothing",
    "saturated": "as many pulses as the converter can give: its input is beyond its range",
    "stuck": "no pulse for much longer than the other rates let expect",
    "outlier": "a rate far from the line through the others, as where pulses are lost",
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
    "no_points": "no two points at rest tell how its input drifted.",
    "slope_follows_level": (
        "its slope is not that of its reference, because its level is not: the drift is in proportion to the rate. "
        "Relative to the rates the slopes agree; slopes as they are (basis raw) deviate for this reason alone, which "
        "is no fault of the channel."
    ),
    "slope_same_at_all_levels": (
        "its slope is that of its reference, though its level is another: the drift is an offset. Relative to the "
        "rates the slopes deviate for this reason."
    ),
    "out_of_proportion": (
        "its rate is out of proportion to that of the other levels: a wrong fixture, current or polarity, or what "
        "feeds the converter is not what the record says."
    ),
    "drift_not_linear": (
        "the slopes are not a part that is the same at all levels and one in proportion to the rate: the drift depends "
        "on the level in another way."
    ),
    "no_thermometer": "nothing reads its temperature.",
    "not_counted": "the unit is read by a voltmeter or sends its output itself, and has none that counts.",
    "not_certified": "it has no certificate, so that its gain, offset and drift have no part in U.",
    "temperature_slope_unknown": "how it changes with temperature is not known, so the thermometer has no part in U.",
}
_PARTS = {
    **table_words.PARTS,
    **imu_words.PARTS,
    "part_missing": "part: there is no leg at this input, without which nothing can be determined.",
    "leg_incomplete": "more than half of its samples could not be used.",
    "no_steps": "left out: it has no step between two readings at the position.",
    "not_one_leg": "left out: it is no leg, its set point ends where it began.",
    "not_zero": "the source gave nothing, and the channel counted: is the accelerometer still connected?",
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
        return f"{at_frequency[1]}: {tr(_FREQUENCIES[at_frequency[2]])}"
    return ""


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
    samples = _SAMPLES.fullmatch(flag)
    if samples and samples[3] in _READINGS:
        told = tr("{count} samples are left out: {why}", count=samples[2], why=tr(_READINGS[samples[3]]))
        return told + (f" ({samples[1]})." if samples[1] else ".")
    if (left := _LEFT.fullmatch(flag)) and left[2] in _LEFT_OUT:
        return tr("{count} readings are left out: {why}.", count=left[1], why=tr(_LEFT_OUT[left[2]]))
    if differ := _DIFFER.fullmatch(flag):
        return tr("The scale factors of both ends still differ after {count} attempts.", count=differ[1])
    step, _, problem = flag.rpartition(": ")
    if problem in _PARTS:
        return f"{tr(step) if problem == 'part_missing' else step}: {tr(_PARTS[problem])}"
    if problem in _READINGS:
        return tr("A reading is left out: {why} ({step}).", why=tr(_READINGS[problem]), step=step)
    quantity, _, problem = flag.partition(":")
    return f"{quantity}: {tr(_QUANTITIES[problem])}" if problem in _QUANTITIES else flag


def quantity_in_words(quantity: str) -> str:
    """A quantity for the head of a table: "K1 per m/s²", "K0: temperature coefficient"."""
    return ": ".join(tr(part) for part in quantity_text(quantity).split(": "))


def quantity_text(quantity: str) -> str:
    """The same in English."""
    return QUANTITIES.get(quantity, quantity.replace("/", ": ").replace("_", " "))


def name_of(finding: Finding) -> str:
    """What a finding is, without its quantity, which stands before it."""
    return tr(finding.name.removeprefix(quantity_text(finding.quantity) + ": "))


def quantity_of(finding: Finding) -> str:
    """The quantity of a finding for the head of a table; K2 by itself where the asymmetry is not in it."""
    alone = finding.quantity == "K2" and "contains:asymmetry" not in finding.flags
    return finding.quantity if alone else quantity_in_words(finding.quantity)


def source_in_words(source: str) -> str:
    """A source of uncertainty: "head: zero"; the name of a reading is nothing to translate."""
    what, colon, part = source.partition(": ")
    return f"{tr(what) if what in SOURCES else what}{colon}{tr(part)}" if colon else tr(source)


def end_in_words(end: str) -> str:
    """The end that a unit stands on: "up" or "down" as words."""
    return tr("+Z up") if end == "up" else tr("+Z down")


def leg_in_words(leg: str) -> str:
    """Which way the temperature went: "up" or "down" as words."""
    return tr("rising") if leg == "up" else tr("falling")


def unit_shown(quantity: str, unit: str) -> str:
    """The unit in which a quantity is shown; `unit` when it is shown as it is."""
    return SHOWN.get(quantity, (1.0, unit))[1]


def limits_in_words(quantity: str, limits: Limits) -> str:
    """Limits in the unit shown: "-50 to 50", "at most 200", "11300 ± 50"; empty when there are none."""
    factor = SHOWN.get(quantity, (1.0, ""))[0]
    low, high = (None if side is None else f"{side * factor:.12g}" for side in (limits.low, limits.high))
    if limits.target is not None and limits.high is not None:
        return f"{limits.target * factor:.12g} ± {(limits.high - limits.target) * factor:.6g}"
    if low is not None and high is not None:
        return tr("{low} to {high}", low=low, high=high)
    if low is not None:
        return tr("at least {low}", low=low)
    return tr("at most {high}", high=high) if high is not None else ""


def bands_in_words(quantity: str, limits: Limits) -> str:
    """What else limits state: "guard band 2 u", "marginal within 50"; empty when they state only themselves."""
    factor = SHOWN.get(quantity, (1.0, ""))[0]
    guard = "" if limits.guard_k is None else tr("guard band {k} u", k=f"{limits.guard_k:g}")
    marginal = (
        "" if limits.marginal is None else tr("marginal within {width}", width=f"{limits.marginal * factor:.12g}")
    )
    return ", ".join(filter(None, (guard, marginal)))


def _levels_in_words(at: Mapping[str, Any]) -> Iterator[str]:
    """The input level that a finding is of, and how it compares."""
    if "run" in at:
        yield at["run"]
    if "reference" in at:
        yield tr("against {reference}", reference=at["reference"])
        yield tr(at["decision"])


def _dwells_in_words(at: Mapping[str, Any], dwells: Mapping[str, int]) -> Iterator[str]:
    """Which dwells or cycle a finding is of."""
    if "dwell" in at:
        yield tr("dwell {number}", number=at["dwell"])
    if "dwells" in at:
        numbers = [str(dwells.get(path, path)) for path in at["dwells"]]
        yield tr("dwells {numbers}" if len(numbers) > 1 else "dwell {numbers}", numbers=tr(" and ").join(numbers))
    elif "cycle" in at:
        yield tr("cycle {number}", number=at["cycle"])


def where(at: Mapping[str, Any], dwells: Mapping[str, int]) -> str:
    """The conditions of a finding: "dwell 5, set point 70 °C, rising"; `dwells` are the numbers of the dwells."""
    parts = [*_levels_in_words(at), *_dwells_in_words(at, dwells)]
    if "axis" in at:
        parts.insert(0, tr("axis {axis}", axis=at["axis"] + at.get("toward", "")))
    if at.get("temperature_set_c") is not None:
        parts.append(tr("set point {set_c} °C", set_c=f"{at['temperature_set_c']:g}"))
    elif "temperature_c" in at:
        parts.append(tr("centre {at_c} °C", at_c=f"{at['temperature_c']:.1f}"))
    if "direction" in at:
        parts.append(tr(at["direction"]))
    if "position_deg" in at:
        parts.append(tr("about {angle}°", angle=f"{at['position_deg']:g}"))
    parts += [told(at[key]) for key, told in (("end", end_in_words), ("leg", leg_in_words)) if key in at]
    if "repetitions" in at:
        parts.append(tr("{count} repetitions", count=at["repetitions"]))
    if "at_c" in at:
        parts.append(tr("at {at_c} °C", at_c=f"{at['at_c']:.1f}"))
    parts += [f"{at[key]:.5g} {unit}" for key, unit in table_words.CONDITIONS.items() if key in at]
    return ", ".join(parts)
