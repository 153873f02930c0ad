"""Expressions `${…}` over parameters and loop variables: arithmetic and comparison of quantities, a few functions.

Arithmetic of a list and a quantity is that of each of its values.

A constant with a unit is quoted: `${temperature + '5 °C'}`. Everything else that Python knows (attributes,
indices, powers, formatted text, calls of anything but the functions here) is refused before it is evaluated.
"""

from __future__ import annotations

import ast
import functools
import math
import re
import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

from drivers.quantity.quantities import Quantity, as_quantity, parse
from drivers.quantity.units import QuantityError, dimension_of, quoted
from drivers.schema.suggest import did_you_mean
from drivers.schema.wording import value_text

Scalar = Quantity | bool | str
Value = Scalar | tuple[Scalar, ...]

LENGTH_LIMIT = 500
_QUOTED = re.compile(r"'[^']*'|\"[^\"]*\"")
_BARE_QUANTITY = re.compile(r"\d[\d.]* ?(?!if\b|and\b|or\b|else\b)[°µ%A-Za-z][\w°/²³]*")


class ValueProblem(ValueError):
    """A value or an expression that cannot be used."""


def scalar_of(raw: object) -> Scalar:
    """Read a number as a ratio and text as a quantity if it is one; return other values unchanged; raises ValueProblem.

    Text that begins like a number must be a quantity.
    """
    if isinstance(raw, (bool, Quantity)):
        return raw
    if isinstance(raw, (int, float)) and math.isfinite(raw):
        return Quantity(float(raw))
    if not isinstance(raw, str) or not raw:
        raise ValueProblem(f"is {value_text(raw)}, expected a value")
    try:
        return parse(raw)
    except QuantityError as problem:
        if raw[0].isnumeric() or raw[0] in "+-−.‐‒–—":
            raise ValueProblem(str(problem)) from None
        return raw


def evaluate(expression: str, names: Mapping[str, Value]) -> Value:
    """Value of an expression; raises ValueProblem."""
    try:
        read = _read(expression)
        for what, used, known in (("name", read.names, names), ("function", read.functions, _FUNCTIONS)):
            for name in sorted(used - set(known)):
                raise ValueProblem(f"there is no {what} '{name}'{did_you_mean(name, known)}")
        return _evaluated(expression, read.tree, names)
    except (ValueProblem, QuantityError) as problem:
        reason = str(problem)
    except TypeError:
        reason = "a function has too many or too few arguments"
    except (ValueError, ArithmeticError, MemoryError, RecursionError):
        reason = "is too deep or too large to be evaluated"
    raise ValueProblem(f"{quoted(f'${{{expression}}}')}: {reason}")


def names_in(expression: str) -> frozenset[str]:
    """The names used in an expression; none if it is invalid, which `evaluate` reports."""
    try:
        return _read(expression).names
    except ValueProblem:
        return frozenset()


class _Read(NamedTuple):
    """An expression as a tree, with the names of its values and functions."""

    tree: ast.expr
    names: frozenset[str]
    functions: frozenset[str]


@functools.lru_cache(maxsize=256)
def _read(expression: str) -> _Read:
    """Parse an expression; raises ValueProblem for any Python that is not supported here."""
    if len(expression) > LENGTH_LIMIT:
        raise ValueProblem(f"has more than {LENGTH_LIMIT} characters")
    if "\\" in expression:  # Python would turn it into control characters and surrogates
        raise ValueProblem("a backslash has no meaning in an expression")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # syntax that a later Python will reject, such as 1if
            tree = ast.parse(expression.strip(), mode="eval").body
    except (SyntaxError, ValueError):  # ValueError for a NUL character before Python 3.11.4
        bare = _BARE_QUANTITY.search(_QUOTED.sub("", expression))
        expected = f"a quantity stands in quotes: '{bare[0]}'" if bare else _UNDERSTOOD
        raise ValueProblem(f"is not an expression; {expected}") from None
    nodes = list(ast.walk(tree))
    called = {node.func for node in nodes if isinstance(node, ast.Call)}
    if not all(isinstance(node, _NODES) for node in nodes) or not all(isinstance(node, ast.Name) for node in called):
        raise ValueProblem(_UNDERSTOOD)
    names, functions = (
        frozenset(node.id for node in nodes if isinstance(node, ast.Name) and (node in called) == is_called)
        for is_called in (False, True)
    )
    return _Read(tree, names, functions)


def _evaluated(expression: str, tree: ast.expr, names: Mapping[str, Value]) -> Value:
    from simpleeval import SimpleEval  # imported on demand: few sequences have expressions

    evaluator = SimpleEval(operators=_OPERATORS, functions=_FUNCTIONS, names=dict(names))

    def found(node: ast.expr) -> Any:
        return evaluator.eval(expression, previously_parsed=node)

    evaluator.nodes |= {
        ast.Constant: lambda node: scalar_of(node.value),
        ast.IfExp: lambda node: found(node.body if _truth(found(node.test)) else node.orelse),
        ast.BoolOp: lambda node: _ALL_OR_ANY[type(node.op)](_truth(found(part)) for part in node.values),
    }
    value = found(tree)
    return value if isinstance(value, tuple) else scalar_of(value)


def _truth(value: object) -> bool:
    """A truth value; `on` and `off` are text, and both would be true in Python."""
    if isinstance(value, bool):
        return value
    what = {Quantity: "a quantity", tuple: "a list"}.get(type(value)) or quoted(value)
    raise QuantityError(f"{what} is neither true nor false; compare it with another")


def _numbers(values: tuple[object, ...]) -> Iterator[Quantity]:
    """Quantities, including those in lists."""
    for value in values:
        yield from map(as_quantity, value if isinstance(value, tuple) else (value,))


def _smallest(*values: object) -> Quantity:
    return functools.reduce(lambda a, b: a if a <= b else b, _numbers(values))


def _largest(*values: object) -> Quantity:
    return functools.reduce(lambda a, b: a if a >= b else b, _numbers(values))


def _rounded(value: object) -> Quantity:
    return Quantity(float(round(as_quantity(value).to(""))))


def _root(value: object) -> Quantity:
    quantity = as_quantity(value)
    if quantity.base_value < 0:
        raise QuantityError("the square root of a negative quantity")
    return Quantity(math.sqrt(quantity.base_value), dimension_of(power / 2 for power in quantity.dimension))


def _turning(function: Callable[[float], float]) -> Callable[[object], Quantity]:
    return lambda angle: Quantity(function(math.radians(as_quantity(angle).to("°"))))


def _length(values: object) -> Quantity:
    if not isinstance(values, tuple):
        raise QuantityError("len needs a list")
    return Quantity(float(len(values)))


def _equal(a: object, b: object) -> bool:
    if isinstance(a, Quantity) or isinstance(b, Quantity):
        return as_quantity(a) <= b and as_quantity(a) >= b
    return a == b


def _of_each(operate: Callable[[Quantity, object], Quantity]) -> Callable[[object, object], Value]:
    """An operation of two quantities, or of a list and a quantity for each value of the list."""

    def operated(a: object, b: object) -> Value:
        if isinstance(a, tuple):
            return tuple(operate(as_quantity(each), b) for each in a)
        if isinstance(b, tuple):
            return tuple(operate(as_quantity(a), each) for each in b)
        return operate(as_quantity(a), b)

    return operated


_OPERATORS: dict[type[ast.AST], Any] = {
    ast.Add: _of_each(lambda a, b: a + b),
    ast.Sub: _of_each(lambda a, b: a - b),
    ast.Mult: _of_each(lambda a, b: a * b),
    ast.Div: _of_each(lambda a, b: a / b),
    ast.USub: lambda a: -as_quantity(a),
    ast.UAdd: lambda a: as_quantity(a),
    ast.Not: lambda a: not _truth(a),
    ast.Lt: lambda a, b: as_quantity(a) < b,
    ast.LtE: lambda a, b: as_quantity(a) <= b,
    ast.Gt: lambda a, b: as_quantity(a) > b,
    ast.GtE: lambda a, b: as_quantity(a) >= b,
    ast.Eq: _equal,
    ast.NotEq: lambda a, b: not _equal(a, b),
}
_ALL_OR_ANY: dict[type[ast.boolop], Any] = {ast.And: all, ast.Or: any}
_FUNCTIONS: dict[str, Any] = {
    "abs": lambda value: abs(as_quantity(value)),
    "min": _smallest,
    "max": _largest,
    "round": _rounded,
    "sqrt": _root,
    "sin": _turning(math.sin),
    "cos": _turning(math.cos),
    "len": _length,
}
_NODES = (
    ast.Constant, ast.Name, ast.Load, ast.UnaryOp, ast.BinOp, ast.BoolOp, ast.boolop, ast.Compare, ast.IfExp, ast.Call,
    *_OPERATORS,
)  # fmt: skip
_UNDERSTOOD = f"expected numbers, names, + - * /, comparisons, and, or, not, if else, {', '.join(_FUNCTIONS)}"
