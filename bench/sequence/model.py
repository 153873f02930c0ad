"""What a sequence file says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, ConfigDict, Field, PlainValidator, WithJsonSchema, model_validator

from bench.sequence.expressions import Scalar, Value, ValueProblem
from bench.sequence.steps import NEEDS, AnyBlock
from bench.sequence.values import in_words, value_of
from drivers.fields import NOT_EMPTY, Name, StrictModel
from drivers.quantities import Quantity
from drivers.suggest import did_you_mean
from drivers.units import customary_unit, in_unit, quoted
from drivers.wording import expected, telling

Text = Annotated[str, Field(min_length=1, max_length=500)]
KINDS = tuple(dict.fromkeys(kind for kinds in NEEDS.values() for kind in kinds))


def _kind(kind: str) -> str:
    if kind not in KINDS:
        raise telling(f"there is no kind of device {quoted(kind)}{did_you_mean(kind, KINDS)}")
    return kind


def _value(raw: Any) -> Value:
    try:
        return value_of(raw)
    except ValueProblem as problem:
        raise telling(str(problem)) from None


# For editors: how a document may write a value, see value_of.
_ONE = {"type": ["string", "number", "boolean"], "minLength": 1}
_END = {"type": ["string", "number"], "minLength": 1}
_RANGE = {
    "type": "object",
    "properties": {"from": _END, "to": _END, "step": _END},
    "required": ["from", "to"],
    "additionalProperties": False,
}
_LIST = {"type": "array", "items": {"anyOf": [_ONE, _RANGE, {"type": "array"}]}}
VALUE_SCHEMA = {"anyOf": [_ONE, _RANGE, _LIST], "description": "a value, a list of values, or a range {from, to, step}"}
AnyValue = Annotated[Any, AfterValidator(_value), WithJsonSchema(VALUE_SCHEMA)]


def _limit(raw: Any) -> Quantity:
    value = _value(raw)
    if not isinstance(value, Quantity):
        raise expected("a quantity", raw)
    return value


Limit = Annotated[Quantity | None, PlainValidator(_limit), WithJsonSchema(_END)]


class Parameter(StrictModel):
    """A value that a run may choose: its kind and unit are those of the default, its range is checked."""

    help: Text
    default: AnyValue
    min: Limit = None
    max: Limit = None

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.default == ():
            raise telling("the default is an empty list, which tells no unit")
        one = self._example
        for name, limit in (("min", self.min), ("max", self.max)):
            if limit is not None and not (isinstance(one, Quantity) and one.dimension == limit.dimension):
                raise telling(f"{name} is {in_words(limit)}, the default is {in_words(one)}")
        if self.min is not None and self.max is not None and self.min > self.max:
            raise telling("min is above max")
        if problem := self.problem_with(self.default):
            raise telling(f"the default {problem}")
        return self

    @property
    def _example(self) -> Scalar:
        one: Scalar = self.default[0] if isinstance(self.default, tuple) else self.default
        return one

    def problem_with(self, value: Value) -> str:
        """What is wrong with a value for this parameter; empty when nothing is."""
        if isinstance(value, tuple) != isinstance(self.default, tuple):
            return "is a list, expected one value" if isinstance(value, tuple) else "is one value, expected a list"
        if value == ():
            return "is empty, expected at least one value"
        items = value if isinstance(value, tuple) else (value,)
        return next(filter(None, map(self._item_problem, items)), "")

    def _item_problem(self, item: Scalar) -> str:
        one = self._example
        if not isinstance(item, Quantity) or not isinstance(one, Quantity):
            return (
                "" if type(item) is type(one) else f"is {quoted(in_words(item))}, expected a value like {in_words(one)}"
            )
        if item.dimension != one.dimension:
            return f"is {in_words(item)}, expected {in_unit(customary_unit(one.dimension))}"
        if self.min is not None and item < self.min:
            return f"is {in_words(item)}, expected at least {in_words(self.min)}"
        if self.max is not None and item > self.max:
            return f"is {in_words(item)}, expected at most {in_words(self.max)}"
        return ""


class Preset(StrictModel):
    """Values for several parameters under one name."""

    help: Text
    set: Mapping[Name, AnyValue]


class LimitEntry(StrictModel):
    """What a result may be; at least one of both."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1})

    min: Limit = None
    max: Limit = None

    @model_validator(mode="after")
    def _something(self) -> Self:
        if self.min is None and self.max is None:
            raise telling("needs min or max, or both")
        return self


class ResultEntry(StrictModel):
    """A reduction of the acquisitions under a label."""

    method: str
    data: Name
    settings: Any = Field(default_factory=dict)
    limits: Mapping[str, LimitEntry] = {}


class Outline(StrictModel):
    """All that a sequence file says besides its steps."""

    schema_: Literal["itb-sequence/1"] = Field(alias="schema")
    title: Text
    needs: Mapping[Name, Annotated[str, AfterValidator(_kind), WithJsonSchema({"enum": list(KINDS)})]]
    parameters: Mapping[Name, Parameter] = {}
    presets: Mapping[Name, Preset] = {}
    results: tuple[ResultEntry, ...] = ()


class SequenceFile(Outline):
    """One `sequences/*.yaml`."""

    setup: tuple[AnyBlock, ...] = ()
    steps: Annotated[tuple[AnyBlock, ...], NOT_EMPTY]
    teardown: tuple[AnyBlock, ...] = ()
