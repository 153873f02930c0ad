"""Names visible to expressions in a part of a sequence, and their values during expansion."""

from __future__ import annotations

import re
import types
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel

from bench.config.document import Place, Problem
from bench.sequence.document.model import Phase
from bench.sequence.language.expressions import Value, ValueProblem, names_in
from bench.sequence.language.values import holds_expression, in_words, value_of
from bench.sequence.plan.plan import Waiting
from drivers.quantity.quantities import Quantity
from drivers.quantity.units import NO_DIMENSION, QuantityError, customary_unit, quoted
from drivers.schema.fields import InUnit

TEXTS = ("note", "alarm", "prompt")  # keys of texts, which may contain expressions
_IN_TEXT = re.compile(r"\$\{([^{}]*)\}")


class Scope(NamedTuple):
    """Scope of a step in a sequence.

    `names` are parameters and loop variables, of which `loops` are those around the step. `measured` are the names of
    measurements that come before it, each with an example of its kind; in a called sequence one may have the name of a
    parameter, which then takes precedence. `path` is the prefix of the ids in this scope.
    """

    phase: Phase
    path: str
    names: Mapping[str, Value]
    loops: Mapping[str, Value]
    measured: dict[str, Value | None]

    def inside(self, label: str, **own: Value) -> Scope:
        """Scope one level further in, under a label, with additional names."""
        return self._replace(
            path=f"{self.path}/{label}", names={**self.names, **own}, loops={**self.loops, **own}
        )  # fmt: skip

    def waits(self, raw: Any) -> bool:
        """True if a value contains an expression over measurements."""
        if isinstance(raw, Mapping):
            return any(self.waits(value) for value in raw.values())
        if isinstance(raw, (list, tuple)):
            return any(self.waits(value) for value in raw)
        if not self.measured or not holds_expression(raw):
            return False
        awaited = self.measured.keys() - self.names.keys()
        return any(names_in(inside) & awaited for inside in _IN_TEXT.findall(raw))

    def evaluated(self, raw: Any, place: Place, found: list[Problem]) -> Any:
        """Value of a step with its expressions evaluated except those that wait; problems are added to `found`."""
        if isinstance(raw, Mapping):
            return {key: self.evaluated(value, (*place, key), found) for key, value in raw.items()}
        if isinstance(raw, list) and any(holds_expression(item) or isinstance(item, Mapping) for item in raw):
            return [self.evaluated(value, (*place, index), found) for index, value in enumerate(raw)]
        if not holds_expression(raw):
            return raw
        try:
            value = self.value(raw, text=place[-1] in TEXTS)
        except ValueProblem as problem:
            found.append((place, f"{place[-1]}: {problem}"))
            return None
        return raw if self.waits(raw) else value

    def value(self, raw: Any, *, text: bool = False) -> Value | None:
        """Value of an expression, evaluated with examples if it waits; None if unknown; raises ValueProblem."""
        names: dict[str, Value] = dict(self.names)
        for name, example in self.measured.items():
            if example is None and isinstance(raw, str) and name in raw and self.waits(raw):
                return None
            if example is not None:
                names.setdefault(name, example)
        return filled(raw, names) if text else value_of(raw, names)

    def condition(self, raw: Any) -> bool | Waiting:
        """Value of a condition: true, false, or to be decided in the run; raises ValueProblem."""
        value = self.value(raw)
        if value is not None and not isinstance(value, bool):
            raise ValueProblem(f"is {in_words(value)}, expected something true or false such as ${{a > '5 °C'}}")
        if self.waits(raw):
            return Waiting(raw, self.names)
        return bool(value)

    def misfits(
        self, model: type[BaseModel], raw: Mapping[str, Any], place: Place, reading: Value | None
    ) -> list[Problem]:
        """Waiting expressions in another unit than that of their key or of the reading of the step."""
        found: list[Problem] = []
        for keys, unit in _units(model, reading) if self.waits(raw) else ():
            part: Any = raw
            for key in keys:
                part = part.get(key) if isinstance(part, Mapping) else None
            value = self.value(part) if self.waits(part) else None
            try:
                if isinstance(value, Quantity) and not (keys[-1] == "u_max" and value.dimension == NO_DIMENSION):
                    value.to(unit)  # a largest uncertainty may be a ratio
            except QuantityError as problem:
                found.append(((*place, *keys), f"{keys[-1]}: {problem}"))
        return found


def names_mentioned(raw: Any) -> frozenset[str]:
    """Every name in the expressions of a value."""
    if isinstance(raw, (Mapping, list)):
        parts = raw.values() if isinstance(raw, Mapping) else raw
        return frozenset().union(*map(names_mentioned, parts))
    return frozenset().union(*map(names_in, _IN_TEXT.findall(raw))) if holds_expression(raw) else frozenset()


def filled(raw: str, names: Mapping[str, Value]) -> str:
    """A text with its expressions replaced by their values, to six digits; ValueProblem."""
    if holds_expression(_IN_TEXT.sub("", raw)):
        raise ValueProblem(f"{quoted(raw)}: an expression in a text begins with ${{ and ends with }}")
    return _IN_TEXT.sub(lambda found: _in_text(value_of(found[0], names)), raw)


def _in_text(value: Value) -> str:
    if not isinstance(value, Quantity):
        return in_words(value)
    unit = customary_unit(value.dimension)
    return f"{value.to(unit):.6g} {unit}".rstrip()


def _units(model: type[BaseModel], reading: Value | None) -> Iterator[tuple[tuple[str, ...], str]]:
    """Keys of a step that have one unit; `reading` is an example of the reading of the step."""
    for name, info in model.model_fields.items():
        unit = unit_of((info.annotation, *info.metadata))
        if unit is not None:
            yield (info.alias or name,), unit
    if isinstance(reading, Quantity):
        unit = customary_unit(reading.dimension)
        yield from (((key,), unit) for key in ("above", "below"))
        yield from ((("limits", key), unit) for key in ("min", "max", "target", "tolerance", "marginal", "u_max"))


def unit_of(parts: tuple[Any, ...]) -> str | None:
    """Unit of a field by its annotation and metadata; None if it is not a quantity in a fixed unit."""
    for part in parts:
        if isinstance(part, InUnit):
            return part.unit
        if get_origin(part) in (Union, types.UnionType) or hasattr(part, "__metadata__"):
            inner = (*get_args(part), *getattr(part, "__metadata__", ()))
            if (unit := unit_of(inner)) is not None:
                return unit
    return None
