"""Steps that address people: notes, alarms, and questions that the run waits to have answered."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from bench.sequence.steps.fields import Resumed, StepBase, Text
from drivers.quantity.quantities import Quantity
from drivers.quantity.units import QuantityError, parse_unit
from drivers.schema.fields import NOT_EMPTY, OR_EXPRESSION, AnyQuantity, FileBeside, Name, PositiveSeconds, StrictModel
from drivers.schema.wording import telling

DONE = "done"
NO_CHANNEL = "none"
A_DAY_S = 86400.0


class Note(StepBase):
    """Write a text to the record of the run and display it; the text may contain expressions."""

    text: Text = Field(alias="note")


class Alarm(StepBase):
    """Display a note that needs immediate attention: as an alarm, with the bell of the terminal."""

    text: Text = Field(alias="alarm")


def _unit(text: str) -> str:
    try:
        parse_unit(text)
    except QuantityError as problem:
        raise telling(str(problem)) from None
    return text


class TypedInput(StrictModel):
    """A quantity that a person types, in `unit`, within a range; without a unit, a text."""

    unit: Annotated[str, AfterValidator(_unit)] | None = Field(None, description="without it the answer is a text")
    min: AnyQuantity | None = Field(None, description="minimum")
    max: AnyQuantity | None = Field(None, description="maximum")

    @model_validator(mode="after")
    def _goes_together(self) -> Self:
        for name, bound in (("min", self.min), ("max", self.max)):
            if bound is None:
                continue
            if self.unit is None:
                raise telling(f"{name} needs a unit: without one the answer is a text")
            try:
                bound.to(self.unit)
            except QuantityError as problem:
                raise telling(f"{name} {problem}") from None
        if self.min is not None and self.max is not None and self.min > self.max:
            raise telling("min is above max")
        return self

    @property
    def example(self) -> Quantity | str:
        """Example of the typed value, for checking expressions before the run."""
        if self.unit is None:
            return "text"
        unit = parse_unit(self.unit)
        known = (bound for bound in (self.min, self.max) if bound is not None)
        return next(known, Quantity(float(unit.factor), unit.dimension))


class PhysicalChange(StrictModel):
    """Change that a person makes by hand; in simulation, a simulated technician makes it."""

    mount: Annotated[Name, OR_EXPRESSION] | None = Field(
        None, description="the mount of the fixture to which the unit is attached"
    )
    input: Literal["accelerometer", "source"] | None = Field(
        None,
        description="the input of the converter: its accelerometer (at the beginning of a run), "
        "or the cable of the current source",
    )
    channel: Annotated[Literal["acc_x", "acc_y", "acc_z", "none"], OR_EXPRESSION] | None = Field(
        None,
        description="with `input: source`, of an inertial unit: the channel into whose converter the cable is plugged; "
        "none for other units",
    )

    @model_validator(mode="after")
    def _something(self) -> Self:
        if not self.model_fields_set:
            raise telling("names nothing to change; write for instance {mount: upright}")
        if self.channel not in (None, NO_CHANNEL) and self.input != "source":
            raise telling("channel is for the cable of a source: give input: source as well")
        return self

    @property
    def fed_channel(self) -> str:
        """Channel of an inertial unit that the source feeds; empty for other units."""
        return "" if self.channel in (None, NO_CHANNEL) else self.channel


class Prompt(StepBase):
    """Ask a person and wait for the answer: one of `choices`, or typed input; the name of the person is recorded.

    `as` is the name of the answer in later expressions. `expect` names the change that the person is to make; confirm
    it by a reading in the next step.
    """

    resumed: ClassVar[Resumed] = "asked"

    text: Text = Field(alias="prompt")
    picture: Annotated[Path, FileBeside()] | None = Field(None, description="shown with the question")
    choices: Annotated[tuple[Text, ...], NOT_EMPTY] | None = Field(None, description="permitted answers; default: done")
    input: TypedInput | None = None
    name: Name | None = Field(None, alias="as", description="the name of the answer in later expressions")
    expect: PhysicalChange | None = None
    give_up_after_s: PositiveSeconds = Field(
        A_DAY_S, alias="give_up_after", description="after this time a missing answer is an error"
    )

    @model_validator(mode="before")
    @classmethod
    def _one_kind_of_answer(cls, raw: Any) -> Any:
        if isinstance(raw, dict) and "choices" in raw and "input" in raw:
            raise telling("has choices and input; an answer is chosen or typed")
        return raw

    @property
    def allowed(self) -> tuple[str, ...]:
        """Permitted choices; empty if the answer is typed."""
        if self.input is not None:
            return ()
        return self.choices or (DONE,)

    @property
    def example(self) -> Quantity | str:
        """Example of an answer, for checking expressions before the run."""
        return self.input.example if self.input is not None else self.allowed[0]
