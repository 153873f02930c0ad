"""Settings of results with their expressions evaluated: they may name the parameters of the sequence."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from bench.config.document import Place, Problem
from bench.sequence.document.model import Outline
from bench.sequence.language.expressions import Scalar, Value, ValueProblem, scalar_of
from bench.sequence.language.values import as_written, bare, holds_expression, value_of
from drivers.quantity.quantities import Quantity

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
        name: _as_default(text, outline.parameters[name].default)
        for name, text in written.items()
        if name in outline.parameters
    }
    return with_settings(outline, parameters)[0]


def _as_default(text: str, default: Value) -> Value:
    """Value of a parameter that a manifest has as text; lists and truth values are known by the default."""
    if isinstance(default, tuple):
        return tuple(_scalar(item, default[0]) for item in text.split(", "))
    return _scalar(text, default)


def _scalar(text: str, like: Scalar) -> Scalar:
    return text == as_written(True) if isinstance(like, bool) else scalar_of(text)


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
    return [_in_document(each) for each in value] if isinstance(value, tuple) else _in_document(value)


def _in_document(value: Scalar) -> str | int | float | bool:
    """A value as a document without expressions has it."""
    plain: Quantity | str | int | float | bool = bare(value)
    return as_written(plain) if isinstance(plain, Quantity) else plain
