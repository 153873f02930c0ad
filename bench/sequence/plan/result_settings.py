"""Settings of results with their expressions evaluated: they may name the parameters of the sequence."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from bench.config.document import Place, Problem
from bench.sequence.document.model import Outline
from bench.sequence.language.expressions import Value, ValueProblem
from bench.sequence.language.values import as_written, holds_expression, value_of

AnyOutline = TypeVar("AnyOutline", bound=Outline)


def with_settings(outline: AnyOutline, parameters: Mapping[str, Value]) -> tuple[AnyOutline, list[Problem]]:
    """Return the outline with the settings of its results evaluated, and the problems of expressions."""
    found: list[Problem] = []
    results = []
    for index, entry in enumerate(outline.results):
        settings = _evaluated(entry.settings, parameters, ("results", index, "settings"), found)
        results.append(entry.model_copy(update={"settings": settings}))
    return outline.model_copy(update={"results": tuple(results)}), found


def as_chosen(outline: AnyOutline, written: Mapping[str, str]) -> AnyOutline:
    """Return the outline of a run with its settings evaluated; `written` are its parameters as in the manifest."""
    parameters = {
        name: value_of(text.split(", ") if isinstance(outline.parameters[name].default, tuple) else text)
        for name, text in written.items()
        if name in outline.parameters
    }
    return with_settings(outline, parameters)[0]


def _evaluated(raw: Any, parameters: Mapping[str, Value], place: Place, found: list[Problem]) -> Any:
    if isinstance(raw, Mapping):
        return {key: _evaluated(value, parameters, (*place, key), found) for key, value in raw.items()}
    if isinstance(raw, list):
        return [_evaluated(value, parameters, (*place, index), found) for index, value in enumerate(raw)]
    if not holds_expression(raw):
        return raw
    try:
        value = value_of(raw, parameters)
    except ValueProblem as problem:
        found.append((place, f"{place[-1]}: {problem}"))
        return raw
    return [as_written(each) for each in value] if isinstance(value, tuple) else as_written(value)
