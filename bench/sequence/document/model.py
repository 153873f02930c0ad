"""Model of a sequence file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, PlainValidator, WithJsonSchema, WrapValidator, model_validator

from bench.config.interlocks import InterlockEntry
from bench.sequence.language.expressions import Scalar, Value, ValueProblem
from bench.sequence.language.values import QUANTITY_SCHEMA, VALUE_SCHEMA, in_words, value_of
from bench.sequence.steps.limits import LimitEntry, quantity
from bench.sequence.steps.nested import MODELS, AnyBlock, Steps
from bench.sequence.steps.verbs import BLOCKS, NEEDS
from drivers.capabilities import READING
from drivers.quantity.quantities import Quantity
from drivers.quantity.units import NO_DIMENSION, customary_unit, in_unit, quoted
from drivers.schema.fields import DEFERRED, Name, StrictModel
from drivers.schema.suggest import did_you_mean
from drivers.schema.wording import telling

Phase = Literal["setup", "steps", "teardown"]
PHASES: tuple[Phase, ...] = ("setup", "steps", "teardown")
Text = Annotated[str, Field(min_length=1, max_length=500)]
CONTEXT: Mapping[str, Any] = {**DEFERRED, MODELS: BLOCKS}  # in which a sequence file is validated
KINDS = (*dict.fromkeys(kind for kinds in NEEDS.values() for kind in kinds), READING)


def _kind(kind: str) -> str:
    if kind not in KINDS:
        raise telling(f"there is no kind of device {quoted(kind)}{did_you_mean(kind, KINDS)}")
    return kind


def _value(raw: Any) -> Value:
    try:
        return value_of(raw)
    except ValueProblem as problem:
        raise telling(str(problem)) from None


AnyValue = Annotated[Any, AfterValidator(_value), WithJsonSchema(VALUE_SCHEMA)]


Limit = Annotated[Quantity | None, PlainValidator(quantity), WithJsonSchema(QUANTITY_SCHEMA)]


class Parameter(StrictModel):
    """A value that a run may choose; kind and unit are those of the default, the range is checked."""

    help: Text = Field(description="meaning, for the person who chooses")
    default: AnyValue = Field(description="gives the kind and the unit")
    min: Limit = Field(None, description="the lowest value allowed, of each in a list")
    max: Limit = Field(None, description="the highest value allowed, of each in a list")

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.default == ():
            raise telling("the default is an empty list, from which no unit follows")
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
        """Problem of a value for this parameter; empty if it has none."""
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
        if item.dimension == NO_DIMENSION != one.dimension:
            if "%" in item.written:
                return f"is '{item.written}', a ratio; expected a value like {in_words(one)}"
            return f"is {in_words(item)}, without a unit; write it like '{in_words(item)} {_unit_as_written(one)}'"
        if item.dimension != one.dimension:
            return f"is {in_words(item)}, expected {in_unit(customary_unit(one.dimension))}"
        if self.min is not None and item < self.min:
            return f"is {in_words(item)}, expected at least {in_words(self.min)}"
        if self.max is not None and item > self.max:
            return f"is {in_words(item)}, expected at most {in_words(self.max)}"
        return ""


def _unit_as_written(quantity: Quantity) -> str:
    number, _, unit = quantity.written.partition(" ")
    return (
        unit if number and unit and not any(letter.isdigit() for letter in unit) else customary_unit(quantity.dimension)
    )


class Preset(StrictModel):
    """Values for several parameters under one name."""

    help: Text = Field(description="purpose")
    set: Mapping[Name, AnyValue] = Field(description="values of the parameters")


def _without_names(raw: Any, _handler: Any) -> LimitEntry:
    """Validate limits with their expressions evaluated at once: those of a result have no names with later values."""
    return LimitEntry.model_validate(raw)


def _positive(raw: Any) -> Quantity:
    value = quantity(raw)
    if value.base_value <= 0:
        raise telling(f"is {in_words(value)}, expected more than 0")
    return value


class ResultEntry(StrictModel):
    """A reduction of the acquisitions under a label."""

    method: str = Field(description="the name of an installed method")
    data: Name = Field(description="the label of the acquisitions")
    settings: Any = Field(default_factory=dict, description="settings of the method")
    closure: Name | None = Field(
        None, description="the label of acquisitions at the beginning and at the end, compared as a stability check"
    )
    limits: Mapping[str, Annotated[LimitEntry, WrapValidator(_without_names)]] = {}
    monthly_drift: Mapping[str, Annotated[Quantity, PlainValidator(_positive), WithJsonSchema(QUANTITY_SCHEMA)]] = (
        Field(
            {},
            description="specified largest change of results of the unit in a month, in their unit or as a ratio: "
            "stated in the report, not judged in this run; the next calibration is compared with it",
        )
    )

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of all acquisitions that it reduces."""
        return (self.data,) if self.closure is None else (self.data, self.closure)


class Outline(StrictModel):
    """Everything in a sequence file except its steps."""

    schema_: Literal["itb-sequence/1"] = Field(alias="schema", description="version of the file format")
    title: Text = Field(description="the title in the report")
    needs: Mapping[Name, Annotated[str, AfterValidator(_kind), WithJsonSchema({"enum": list(KINDS)})]] = Field(
        description="the devices and readings of the steps, named as on the bench"
    )
    parameters: Mapping[Name, Parameter] = {}
    presets: Mapping[Name, Preset] = {}
    interlocks: Mapping[Name, InterlockEntry] = {}
    results: tuple[ResultEntry, ...] = ()


class SequenceFile(Outline):
    """One file `sequences/*.yaml`."""

    setup: tuple[AnyBlock, ...] = Field((), description="before the measurement")
    steps: Steps = Field(description="the measurement")
    teardown: tuple[AnyBlock, ...] = Field((), description="at the end, also after a failure")
