"""What analyses say in sentences of their own, with names and numbers in them, in the language of the report."""

from __future__ import annotations

import re

from bench.figures.languages import tr

NOTES = (
    "no decision: its own run is not valid",
    "no decision: the run it is compared with is not valid",
    "no decision: the slope it is compared with is less than three times its uncertainty",
    "no decision: a rate is 0",
    "keeps its own model: at the other polarity the converter has another scale factor",
    "fewer than half of its gates could be used, {used} of {count}",
    "too many outliers, {outliers} of {count} gates",
    "the accelerometer was not at its temperature in {away} of {count} gates; that should end a run",
    "headings were not checked: the latitude is not known",
    "the gyros do not tell the headings of {untold} of {count} attitudes",
    "the horizontal gyros saw north elsewhere than scheduled: {axes}",
    "the thermometer of {sensor} gave fewer than half of its readings",
    "fewer than {least} different angles are left",
    "the bias drifts by {drift} V per dwell; b_V is the bias at the first dwell of all",
    (
        "the residuals repeat themselves {periods} times over the angles; see whether the output beats with the "
        "sampling, or resonates"
    ),
    "the temperature changed by {change} °C",
    "rows left out because something is missing in them: {count}",
    "rows left out because they are duplicates: {count}",
    "{names} are not determined by these readings (rank {rank} of {count}, condition number {condition})",
    "{names} is not determined by these readings (rank {rank} of {count}, condition number {condition})",
)
WHERE = {"end up": "+Z up", "end down": "+Z down", "model": "model of all readings", "clock": "clock"}
"""What such a sentence may begin with; other beginnings are names."""
FORMS = (
    "U the output",
    "a along the input axis in g",
    "on the ground with +Z up",
    "on the ground with +Z down",
    "s = +1 with +Z up",
    "-1 with it down",
    "slope its own",
    "slope from {level}",
    "which serves this level too",
)
"""What an equation says of its symbols, each after a comma."""
_PLACE = re.compile(r"\\\{(\w+)\\\}")
_PATTERNS = {text: re.compile(_PLACE.sub(r"(?P<\1>[^:]+)", re.escape(text))) for text in (*NOTES, *FORMS)}


def _told(text: str) -> str | None:
    """A text that is known here, with its names and numbers; None for any other."""
    for known, pattern in _PATTERNS.items():
        if found := pattern.fullmatch(text):
            return tr(known, **found.groupdict())
    return None


def form_in_words(form: str) -> str:
    """An equation with what it says of its symbols."""
    equation, *clauses = form.split(", ")
    return "".join((equation, *(f"{tr(', ')}{_told(clause) or clause}" for clause in clauses)))


def note_in_words(note: str) -> str:
    """A sentence, after what it is of: "skew: no decision: a rate is 0"; one that is not known here as it stands."""
    if (known := _told(note)) is not None:
        return known
    where, colon, rest = note.partition(": ")
    told = note_in_words(rest) if colon else rest
    if told == rest:
        return note
    return f"{tr(WHERE[where]) if where in WHERE else where}{tr(colon)}{told}"
