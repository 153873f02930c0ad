"""Sentences for the flags of units and readings."""

from __future__ import annotations

from bench.figures.languages import tr
from bench.figures.words import REASONS
from bench.metrology.results.flag import NOT_DETERMINED, ONE_NOT_DETERMINED, SAMPLES, Flag
from bench.metrology.unlike_nominal import OTHER_SIGN, OTHER_SIZE
from bench.sequence.method import MethodWords, texts_of

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
        "missing": "the instrument that measures the output, or a thermometer, gave no value",
    },
)
_QUANTITIES = MethodWords(
    "QUANTITIES",
    {
        "too_few_temperatures": "fewer temperatures than the model asked for needs: the model has a lower degree, or "
        "there is none.",
        "ill_conditioned": "the temperatures do not determine the model.",
        "not_determined": "it has a limit, but the run lacks the data to determine it.",
    },
)
_UNITS = MethodWords("UNITS", {})
_PARTS = MethodWords("PARTS", {})
_WHERE = MethodWords("WHERE", {})
NOTES = (
    ONE_NOT_DETERMINED, NOT_DETERMINED, "the model has no finite values where the fit begins",
    "no step makes the residuals smaller", "the parameters still change after {steps} steps",
)  # fmt: skip
"""Codes that are sentences themselves."""


def reading_in_words(problem: str) -> str:
    """Text of the reason why a reading is unusable; an unknown one is returned unchanged."""
    return tr(_READINGS[problem]) if problem in _READINGS else problem


def flag_in_words(flag: Flag) -> str:
    """Sentence for a flag of a unit; an unknown one is returned unchanged."""
    code, at, of = flag.code, flag.at, flag.of
    if code == SAMPLES and flag.values["why"] in _READINGS:
        return _of_samples(flag)
    if at and code in _PARTS:
        return f"{tr(at)}{tr(': ')}{tr(_PARTS[code])}"
    if at and code in _READINGS:
        return tr("A reading is left out: {why} ({step}).", why=tr(_READINGS[code]), step=at)
    if of and code in (OTHER_SIGN, OTHER_SIZE):
        return f"{of}{tr(': ')}{tr(REASONS[code])}{tr('.')}"
    if of and code in _QUANTITIES:
        return f"{of}{tr(': ')}{tr(_QUANTITIES[code])}"
    if not (at or of) and code in _UNITS:
        return tr(_UNITS[code], **flag.values)
    if of or code not in texts_of("NOTES", NOTES):
        return str(flag)
    where = f"{tr(_WHERE[at]) if at in _WHERE else at}{tr(': ')}" if at else ""
    return f"{where}{tr(code, **flag.values)}"


def _of_samples(flag: Flag) -> str:
    values = {"count": flag.values["count"], "why": tr(_READINGS[str(flag.values["why"])])}
    if flag.at:
        return tr("{count} samples are left out: {why} ({step}).", step=flag.at, **values)
    return tr("{count} samples are left out: {why}.", **values)
