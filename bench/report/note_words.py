"""Sentences that analyses make themselves, with names and numbers in them, in the language of the report."""

from __future__ import annotations

from bench.figures.languages import tr
from bench.figures.words import sentence_of
from bench.sequence.method import MethodWords, texts_of

NOTES = (
    "{names} are not determined by these readings (rank {rank} of {count}, condition number {condition})",
    "{names} is not determined by these readings (rank {rank} of {count}, condition number {condition})",
)
WHERE = MethodWords("WHERE", {})
"""What such a sentence may begin with; other beginnings are names."""


def form_in_words(form: str) -> str:
    """An equation with what it says of its symbols."""
    known = {text: text for text in texts_of("FORMS", ())}
    equation, *clauses = form.split(", ")
    return "".join((equation, *(f"{tr(', ')}{sentence_of(clause, known) or clause}" for clause in clauses)))


def note_in_words(note: str) -> str:
    """A sentence, after what it is of: "skew: no decision: a rate is 0"; one that is not known here as it stands."""
    if (known := sentence_of(note, {text: text for text in texts_of("NOTES", NOTES)})) is not None:
        return known
    where, colon, rest = note.partition(": ")
    told = note_in_words(rest) if colon else rest
    if told == rest:
        return note
    return f"{tr(WHERE[where]) if where in WHERE else where}{tr(colon)}{told}"
