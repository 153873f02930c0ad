"""Values of parameters and loop variables, and the expressions `${…}` over them."""

from __future__ import annotations

import ast
import functools
import math
from collections.abc import Mapping
from typing import Any

from drivers.quantities import NO_DIMENSION, Quantity, QuantityError, as_quantity, describe, parse, spell
from drivers.suggest import did_you_mean

Scalar = Quantity | bool | str
Value = Scalar | tuple[Scalar, ...]

LIST_LIMIT = 10_000
EXPRESSION_LIMIT = 500
_MARGIN = 1e-9  # of a step: a range whose end is a whole number of steps away includes it


class ValueProblem(ValueError):
    """A value or an expression that cannot be used."""


def is_expression(raw: object) -> bool:
    """Whether a raw value is an expression."""
    return isinstance(raw, str) and raw.startswith("${") and raw.endswith("}")


def value_of(raw: Any, names: Mapping[str, Value] | None = None) -> Value:
    """The value that a document's value means, expressions evaluated over `names`; raises ValueProblem.

    Numbers are ratios or counts, text that is a quantity is one, `{from, to, step}` is a range with both its ends, and
    lists of these are flattened.
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
    if is_expression(raw):
        return evaluate(raw[2:-1], names or {})
    return _scalar(raw)


def _scalar(raw: Any) -> Scalar:
    if isinstance(raw, (bool, Quantity)):
        return raw
    if isinstance(raw, (int, float)) and math.isfinite(raw):
        return Quantity(float(raw))
    if not isinstance(raw, str):
        raise ValueProblem(f"expected a value, found {'nothing' if raw is None else type(raw).__name__}")
    if "${" in raw:
        raise ValueProblem(f"'{raw}': an expression is the whole value, like ${{a + b}}")
    try:
        return parse(raw)
    except QuantityError as problem:
        if raw[:1].isdigit() or raw[:1] in "+-−.":
            raise ValueProblem(str(problem)) from None
        return raw


def _range(raw: Mapping[str, Any], names: Mapping[str, Value]) -> tuple[Quantity, ...]:
    """`{from, to, step}` as values; without a step it goes up or down by 1, which only counts can."""
    if unknown := [key for key in raw if key not in ("from", "to", "step")]:
        raise ValueProblem(f"unknown key '{unknown[0]}' in a range{did_you_mean(unknown[0], ('from', 'to', 'step'))}")
    if missing := [key for key in ("from", "to") if key not in raw]:
        raise ValueProblem(f"a range needs '{missing[0]}'")
    first, last = (_quantity(value_of(raw[key], names), f"'{key}'") for key in ("from", "to"))
    if "step" not in raw and first.dimension != NO_DIMENSION:
        raise ValueProblem(f"a range of {describe(first.dimension)} needs a 'step'")
    step = _quantity(value_of(raw.get("step", 1)), "'step'")
    try:
        steps = as_quantity((last - first) / step).to("")
    except QuantityError as problem:
        raise ValueProblem(f"a range whose ends and step do not go together: {problem}") from None
    if step.base_value <= 0:
        raise ValueProblem("the step of a range is above 0; the direction follows from its ends")
    count = math.floor(abs(steps) + _MARGIN) + 1
    if count > LIST_LIMIT:
        raise ValueProblem(f"a range of {count} values; at most {LIST_LIMIT}")
    signed = step if steps >= 0 else -step
    return tuple(Quantity(_tidy((first + signed * index).base_value), first.dimension) for index in range(count))


def _tidy(number: float) -> float:
    return float(f"{number:.12g}")


def _quantity(value: Value, what: str) -> Quantity:
    if not isinstance(value, Quantity):
        raise ValueProblem(f"{what} is not a quantity")
    return value


def evaluate(expression: str, names: Mapping[str, Value]) -> Value:
    """The value of an expression over quantities: arithmetic, comparison, a few functions; raises ValueProblem."""
    if len(expression) > EXPRESSION_LIMIT:
        raise ValueProblem(f"an expression of more than {EXPRESSION_LIMIT} characters")
    from simpleeval import InvalidExpression, SimpleEval  # only where a sequence has expressions

    evaluator = SimpleEval(operators=dict(_OPERATORS), functions=dict(_FUNCTIONS), names=dict(names))
    try:
        found = evaluator.eval(expression.strip())
    except QuantityError as problem:
        raise ValueProblem(f"${{{expression}}}: {problem}") from None
    except (InvalidExpression, SyntaxError, LookupError, TypeError, ValueError, ArithmeticError, MemoryError,
            RecursionError, AttributeError) as problem:  # fmt: skip
        reason = str(problem).splitlines()[0] if str(problem) else type(problem).__name__
        raise ValueProblem(f"${{{expression}}}: {reason}{_hint(expression, names)}") from None
    return found if isinstance(found, tuple) else _scalar(found)


def names_in(expression: str) -> set[str]:
    """The names that an expression uses; empty when it cannot be read."""
    try:
        tree = ast.parse(expression.strip(), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return set()
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def _hint(expression: str, names: Mapping[str, Value]) -> str:
    unknown = sorted(names_in(expression) - set(names) - set(_FUNCTIONS))
    return did_you_mean(unknown[0], names) if unknown else ""


def _rounded(value: object) -> Quantity:
    return Quantity(float(round(as_quantity(value).to(""))))


def _root(value: object) -> Quantity:
    quantity = as_quantity(value)
    if quantity.base_value < 0:
        raise QuantityError("the square root of a negative quantity")
    return Quantity(math.sqrt(quantity.base_value), tuple(power / 2 for power in quantity.dimension))


def _turning(function: Any) -> Any:
    return lambda angle: Quantity(function(math.radians(as_quantity(angle).to("°"))))


_OPERATORS: dict[type[ast.AST], Any] = {
    ast.Add: lambda a, b: as_quantity(a) + b,
    ast.Sub: lambda a, b: as_quantity(a) - b,
    ast.Mult: lambda a, b: as_quantity(a) * b,
    ast.Div: lambda a, b: as_quantity(a) / b,
    ast.USub: lambda a: -as_quantity(a),
    ast.UAdd: lambda a: as_quantity(a),
    ast.Not: lambda a: not a,
    ast.Lt: lambda a, b: as_quantity(a) < b,
    ast.LtE: lambda a, b: as_quantity(a) <= b,
    ast.Gt: lambda a, b: as_quantity(a) > b,
    ast.GtE: lambda a, b: as_quantity(a) >= b,
    ast.Eq: lambda a, b: a == b,
    ast.NotEq: lambda a, b: a != b,
}
_FUNCTIONS: dict[str, Any] = {
    "abs": lambda value: abs(as_quantity(value)),
    "min": lambda *values: functools.reduce(lambda a, b: a if a <= b else b, map(as_quantity, values)),
    "max": lambda *values: functools.reduce(lambda a, b: a if a >= b else b, map(as_quantity, values)),
    "round": _rounded,
    "sqrt": _root,
    "sin": _turning(math.sin),
    "cos": _turning(math.cos),
    "len": lambda values: Quantity(float(len(values))),
}


def spelled(value: Value) -> str:
    """A value for a step's id or a message: "20", "-40", "0.5"; the number in its customary unit without it."""
    if isinstance(value, Quantity):
        return spell(value).split(" ")[0]
    if isinstance(value, tuple):
        return ", ".join(spelled(item) for item in value)
    return str(value).lower() if isinstance(value, bool) else value


def in_words(value: Value) -> str:
    """A value with its unit, for a person: "20 °C, 30 °C"."""
    if isinstance(value, tuple):
        return ", ".join(in_words(item) for item in value)
    return spell(value) if isinstance(value, Quantity) else spelled(value)
