"""Sentences for the flags of units and readings."""

from __future__ import annotations

import re

from bench.figures.languages import tr
from bench.figures.words import REASONS, sentence_of
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
_SAMPLES = re.compile(r"(?:(.+): )?(\d+) samples(?:: (\w+))")


def _of_samples(flag: str) -> str:
    """Sentence for a flag that counts samples; empty for any other."""
    samples = _SAMPLES.fullmatch(flag)
    if samples is None or samples[3] not in _READINGS:
        return ""
    step, count, why = samples[1], samples[2], tr(_READINGS[samples[3]])
    if step:
        return tr("{count} samples are left out: {why} ({step}).", count=count, why=why, step=step)
    return tr("{count} samples are left out: {why}.", count=count, why=why)


def reading_in_words(problem: str) -> str:
    """Text of the reason why a reading is unusable; an unknown one is returned unchanged."""
    return tr(_READINGS[problem]) if problem in _READINGS else problem


def flag_in_words(flag: str) -> str:
    """Sentence for a flag of a unit; an unknown one is returned unchanged."""
    if found := sentence_of(flag, _UNITS) or _of_samples(flag):
        return found
    step, _, problem = flag.rpartition(": ")
    if problem in _PARTS:
        return f"{tr(step)}{tr(': ')}{tr(_PARTS[problem])}"
    if problem in _READINGS:
        return tr("A reading is left out: {why} ({step}).", why=tr(_READINGS[problem]), step=step)
    return _of_a_quantity(flag)


def _of_a_quantity(flag: str) -> str:
    quantity, _, problem = flag.partition(":")
    if problem in (OTHER_SIGN, OTHER_SIZE):
        return f"{quantity}{tr(': ')}{tr(REASONS[problem])}{tr('.')}"
    return f"{quantity}{tr(': ')}{tr(_QUANTITIES[problem])}" if problem in _QUANTITIES else note_in_words(flag)
