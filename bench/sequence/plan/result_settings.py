"""Settings of results that follow from the parameters of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bench.config.document import Problem
from bench.sequence.document.model import Outline, ResultEntry
from bench.sequence.language.expressions import Value
from bench.sequence.language.values import value_of
from bench.sequence.plan.scope import Scope, names_mentioned
from drivers.quantity.quantities import Quantity
from drivers.quantity.units import NO_DIMENSION


def evaluated_results(
    results: Sequence[ResultEntry], parameters: Mapping[str, Value], found: list[Problem]
) -> tuple[ResultEntry, ...]:
    """Results with the expressions of their settings evaluated; problems are added to `found`, without the setting."""
    scope = Scope("steps", "results", parameters, {}, {})

    def evaluated(index: int, entry: ResultEntry) -> ResultEntry:
        before = len(found)
        settings = scope.evaluated(entry.settings, ("results", index, "settings"), found)
        if len(found) > before:
            settings = {key: value for key, value in settings.items() if value is not None}
        return entry.model_copy(update={"settings": _plain(settings)})

    return tuple(evaluated(index, entry) for index, entry in enumerate(results))


def _plain(value: Any) -> Any:
    """The same with numbers for quantities without a dimension, as they are written in a file."""
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    if isinstance(value, Quantity) and value.dimension == NO_DIMENSION:
        number = value.base_value
        return int(number) if number.is_integer() else number
    return value


def kept_parameters(outline: Outline, written: Mapping[str, str]) -> dict[str, Value]:
    """Parameters that the settings of results mention, from their texts in a manifest."""
    mentioned = names_mentioned([entry.settings for entry in outline.results])
    lists = {name for name, parameter in outline.parameters.items() if isinstance(parameter.default, tuple)}
    return {
        name: value_of(text.split(", ") if name in lists else text)
        for name, text in written.items()
        if name in mentioned
    }
