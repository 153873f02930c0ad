"""Values of parameters and loop variables as written in documents: quantities, lists, ranges, expressions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from decimal import Decimal
from fractions import Fraction
from typing import Any

from bench.sequence.language.expressions import Scalar, Value, ValueProblem, evaluate, scalar_of
from drivers.quantity.quantities import Quantity, spell
from drivers.quantity.units import NO_DIMENSION, parse_unit, quoted
from drivers.schema.suggest import did_you_mean

LIST_LIMIT = 10_000
_KEYS = ("from", "to", "step", "per_decade")
_MARGIN = Decimal("1e-9")  # relative to a step: for units without exact decimals, such as radians
_DIGITS, _MOST_PER_DECADE = 4, 1000  # significant ones of a value between the ends of a geometric range, all different
_TEMPERATURE = parse_unit("°C").dimension

# For the schema: permitted forms of a value, see value_of.
QUANTITY_SCHEMA = {"type": ["string", "number"], "minLength": 1}
_ONE = {"type": ["string", "number", "boolean"], "minLength": 1}
_RANGE = {
    "type": "object",
    "properties": dict.fromkeys(_KEYS, QUANTITY_SCHEMA),
    "required": ["from", "to"],
    "not": {"required": ["step", "per_decade"]},
    "additionalProperties": False,
}
_LIST = {"type": "array", "items": {"anyOf": [_ONE, _RANGE, {"type": "array"}]}}
VALUE_SCHEMA = {
    "anyOf": [_ONE, _RANGE, _LIST],
    "description": "a value, a list of values, or a range {from, to, step} or {from, to, per_decade}",
}


def holds_expression(raw: object) -> bool:
    """True if a raw value is an expression or a text that contains one."""
    return isinstance(raw, str) and "${" in raw


def contains_expression(raw: object) -> bool:
    """True if a raw value is an expression, or a list or a mapping that contains one."""
    if isinstance(raw, Mapping):
        return any(map(contains_expression, raw.values()))
    return any(map(contains_expression, raw)) if isinstance(raw, (list, tuple)) else holds_expression(raw)


def value_of(raw: Any, names: Mapping[str, Value] | None = None) -> Value:
    """Value of a raw value, with expressions evaluated over `names`; raises ValueProblem.

    Numbers are ratios or counts, text that is a quantity is one, `{from, to, step}` and `{from, to, per_decade}` are
    ranges with both their ends, and lists of these are flattened.
    """
    if isinstance(raw, (list, tuple)):
        flat: list[Scalar] = []
        for item in raw:
            inner = value_of(item, names)
            flat.extend(inner if isinstance(inner, tuple) else (inner,))
            if len(flat) > LIST_LIMIT:
                raise ValueProblem(f"a list of more than {LIST_LIMIT} values")
        return tuple(flat)
    if isinstance(raw, Mapping):
        return _range(raw, names or {})
    if isinstance(raw, str) and holds_expression(raw):
        inside = raw[2:-1]
        if not raw.startswith("${") or not raw.endswith("}") or "{" in inside or "}" in inside:
            raise ValueProblem(f"{quoted(raw)}: an expression is the whole value, like ${{a + b}}")
        return evaluate(inside, names or {})
    return scalar_of(raw)


def _range(raw: Mapping[str, Any], names: Mapping[str, Value]) -> tuple[Quantity, ...]:
    """Values of `{from, to, step}` or `{from, to, per_decade}`, in decimals; without either, counts increase by 1."""
    if unknown := [key for key in raw if key not in _KEYS]:
        raise ValueProblem(f"unknown key {quoted(unknown[0])} in a range{did_you_mean(unknown[0], _KEYS)}")
    if missing := [key for key in ("from", "to") if key not in raw]:
        raise ValueProblem(f"a range needs '{missing[0]}'")
    first, last = (_quantity(raw[key], names, key) for key in ("from", "to"))
    if "per_decade" in raw:
        if "step" in raw:
            raise ValueProblem("a range has 'step' or 'per_decade', not both")
        return _geometric(first, _same("to", last, first), _quantity(raw["per_decade"], names, "per_decade"))
    if "step" not in raw and first.dimension != NO_DIMENSION:
        raise ValueProblem(f"a range from {in_words(first)} needs a 'step'")
    step = _same("step", _quantity(raw.get("step", 1), names, "step"), first)
    if step.base_value <= 0:
        raise ValueProblem("the step of a range is above 0; the direction follows from its ends")
    return _values(first, _same("to", last, first), step)


def _same(what: str, value: Quantity, first: Quantity) -> Quantity:
    """Return `value`; ValueProblem if its dimension is not that of `first`."""
    if value.dimension == first.dimension:
        return value
    raise ValueProblem(f"'{what}' of a range is {in_words(value)}, 'from' is {in_words(first)}")


def _geometric(first: Quantity, last: Quantity, per_decade: Quantity) -> tuple[Quantity, ...]:
    """Values with a constant ratio, at least `per_decade` of them to a factor of ten, and the ends as written.

    Those between the ends have four significant digits, which names of steps and terminals of instruments can hold.
    """
    if first.dimension == _TEMPERATURE:
        raise ValueProblem("temperatures have no ratio; use a range with 'step'")
    if 0 in (first.base_value, last.base_value) or (first.base_value > 0) != (last.base_value > 0):
        raise ValueProblem(
            f"a range with 'per_decade' is from {in_words(first)} to {in_words(last)}, expected ends of one sign and "
            "other than 0"
        )
    if per_decade.dimension != NO_DIMENSION or not 0 < per_decade.base_value <= _MOST_PER_DECADE:
        raise ValueProblem(
            f"'per_decade' of a range is {in_words(per_decade)}, expected a number up to {_MOST_PER_DECADE}"
        )
    begin, end = (Decimal(spell(quantity).split(" ")[0]) for quantity in (first, last))
    intervals = abs((end / begin).log10()) * Decimal(per_decade.base_value)
    if intervals >= LIST_LIMIT:
        raise ValueProblem(f"a range of more than {LIST_LIMIT} values")
    count = math.ceil(intervals - _MARGIN)
    factor = parse_unit(spell(first).partition(" ")[2]).factor
    between = (begin * (end / begin) ** (Decimal(index) / count) for index in range(1, count))
    rounded = (Decimal(f"{value:.{_DIGITS}g}") for value in between)
    ends = [Quantity(each.base_value, each.dimension) for each in (first, last)]
    inner = [Quantity(float(Fraction(value) * factor), first.dimension) for value in rounded]
    return (ends[0], *inner, ends[1]) if count else (ends[0],)


def _values(first: Quantity, last: Quantity, step: Quantity) -> tuple[Quantity, ...]:
    begin, end, stride = (Decimal(spell(quantity).split(" ")[0]) for quantity in (first, last, step))
    unit = spell(first).partition(" ")[2]
    strides = abs(end - begin) / stride
    if strides >= LIST_LIMIT:
        raise ValueProblem(f"a range of more than {LIST_LIMIT} values")
    count = round(strides)
    if abs(strides - count) > _MARGIN:
        raise ValueProblem(
            f"a range from {in_words(first)} in steps of {in_words(step)} does not meet its end, {in_words(last)}"
        )
    signed = stride if end >= begin else -stride
    factor = parse_unit(unit).factor
    between = (Quantity(float(Fraction(begin + signed * index) * factor), first.dimension) for index in range(1, count))
    ends = [Quantity(end.base_value, end.dimension) for end in (first, last)]  # all values are written in one unit
    return (ends[0], *between, ends[1]) if count else (ends[0],)


def _quantity(raw: Any, names: Mapping[str, Value], what: str) -> Quantity:
    value = value_of(raw, names)
    if not isinstance(value, Quantity):
        raise ValueProblem(f"'{what}' of a range is {quoted(in_words(value))}, expected a quantity")
    return value


def spelled(value: Value) -> str:
    """A value for the id of a step or a message, "20", "-40": the number in its customary unit, without it."""
    if isinstance(value, Quantity):
        return spell(value).split(" ")[0]
    if isinstance(value, tuple):
        return ", ".join(spelled(item) for item in value)
    return str(value).lower() if isinstance(value, bool) else value


def in_words(value: Value) -> str:
    """A value with its unit, for people: "20 °C, 30 °C"."""
    if isinstance(value, tuple):
        return ", ".join(in_words(item) for item in value)
    return spell(value) if isinstance(value, Quantity) else spelled(value)


def as_written(value: Value) -> str:
    """A value as written in its document, like "2.5 µg"; computed values in their customary unit."""
    if isinstance(value, tuple):
        return ", ".join(as_written(item) for item in value)
    return value.written or spell(value) if isinstance(value, Quantity) else spelled(value)


def bare(value: Any) -> Any:
    """A number without a unit as int or float; any other value unchanged, and each value of a list or a mapping."""
    if isinstance(value, Mapping):
        return {key: bare(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [bare(each) for each in value]
    if not isinstance(value, Quantity) or value.dimension != NO_DIMENSION or value.written.endswith(("%", "ppm")):
        return value
    number = value.to("")
    return int(number) if number.is_integer() else number
