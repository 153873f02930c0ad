"""What a sequence file says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from bench.sequence.steps import NEEDS, AnyBlock, Name
from bench.sequence.values import Value, ValueProblem, in_words, value_of
from drivers.fields import StrictModel
from drivers.quantities import Quantity, describe
from drivers.suggest import did_you_mean

Text = Annotated[str, Field(min_length=1, max_length=500)]
KINDS = tuple(dict.fromkeys(kind for kinds in NEEDS.values() for kind in kinds))


def _kind(kind: str) -> str:
    if kind not in KINDS:
        problem = f"there is no kind of device '{kind}'{did_you_mean(kind, KINDS)}"
        raise PydanticCustomError("kind", "{problem}", {"problem": problem})
    return kind


def _value(raw: Any) -> Value:
    try:
        return value_of(raw)
    except ValueProblem as problem:
        raise PydanticCustomError("value", "{problem}", {"problem": str(problem)}) from None


AnyValue = Annotated[Any, AfterValidator(_value)]


class Parameter(StrictModel):
    """A value that a run may choose: its kind and unit are those of the default, its range is checked."""

    help: Text
    default: AnyValue
    min: AnyValue = None
    max: AnyValue = None

    @model_validator(mode="after")
    def _default_is_allowed(self) -> Parameter:
        problem = self.problem_with(self.default)
        if problem:
            raise ValueError(f"default {problem}")
        return self

    def problem_with(self, value: Value) -> str:
        """What is wrong with a value for this parameter; empty when nothing is."""
        one = self.default[0] if isinstance(self.default, tuple) and self.default else self.default
        if isinstance(self.default, tuple) != isinstance(value, tuple):
            return f"is {'a list' if isinstance(value, tuple) else 'one value'}, expected the other"
        for item in value if isinstance(value, tuple) else (value,):
            problem = self._item_problem(item, one)
            if problem:
                return problem
        return ""

    def _item_problem(self, item: Value, one: Value) -> str:
        if not isinstance(item, Quantity) or not isinstance(one, Quantity):
            return "" if type(item) is type(one) else f"is '{in_words(item)}', expected a value like {in_words(one)}"
        if item.dimension != one.dimension:
            return f"is in {describe(item.dimension)}, expected {describe(one.dimension)}"
        low, high = self.min, self.max
        if isinstance(low, Quantity) and item < low:
            return f"is {in_words(item)}, expected at least {in_words(low)}"
        if isinstance(high, Quantity) and item > high:
            return f"is {in_words(item)}, expected at most {in_words(high)}"
        return ""


class Preset(StrictModel):
    """Values for several parameters under one name."""

    help: Text
    set: Mapping[Name, AnyValue]


class LimitEntry(StrictModel):
    """What a result may be; at least one of both."""

    min: AnyValue = None
    max: AnyValue = None

    @model_validator(mode="after")
    def _something(self) -> LimitEntry:
        if not isinstance(self.min, Quantity) and not isinstance(self.max, Quantity):
            raise ValueError("needs min or max, a quantity")
        return self


class ResultEntry(StrictModel):
    """A reduction of the acquisitions under a label."""

    method: str
    data: Name
    settings: Any = Field(default_factory=dict)
    limits: Mapping[str, LimitEntry] = {}


class SequenceFile(StrictModel):
    """One `sequences/*.yaml`."""

    schema_: Literal["itb-sequence/1"] = Field(alias="schema")
    title: Text
    needs: Mapping[Name, Annotated[str, AfterValidator(_kind)]]
    parameters: Mapping[Name, Parameter] = {}
    presets: Mapping[Name, Preset] = {}
    setup: tuple[AnyBlock, ...] = ()
    steps: Annotated[tuple[AnyBlock, ...], Field(min_length=1)]
    teardown: tuple[AnyBlock, ...] = ()
    results: tuple[ResultEntry, ...] = ()
