"""The parts of a sequence file other than its steps, and the problems of single steps."""

from __future__ import annotations

from pydantic import ValidationError

from bench.config.document import Document, Place, Problem
from bench.config.load import problems
from bench.errors import InputError
from bench.sequence.document.model import CONTEXT, PHASES, Outline, SequenceFile

_LISTS = (*PHASES, "then", "else", "during")


def outline_of(document: Document) -> tuple[Outline, list[Problem]]:
    """Outline of a sequence and the problems of its steps; InputError if the outline itself is invalid."""
    value = document.value
    try:
        context = {**CONTEXT, "folder": document.path.parent}
        return SequenceFile.model_validate(value, context=context), []
    except ValidationError as error:
        found = list(problems(value, error))
    if any(block_around(place) is None for place, _ in found):
        raise InputError(*document.located(found))
    return Outline.model_validate({key: part for key, part in value.items() if key not in PHASES}), found


def block_around(place: Place) -> Place | None:
    """Innermost step or block that contains a place: its path ends with its index in a list of steps."""
    if not place or place[0] not in PHASES:
        return None
    numbers = [
        index for index, part in enumerate(place)
        if isinstance(part, int) and (place[index - 1] in _LISTS or place[index - 2] == "parallel")
    ]  # fmt: skip
    return place[: numbers[-1] + 1] if numbers else None
