"""What a step can be. The first key of a step is its verb and names the role it acts on.

In a document a value may be an expression `${…}`; a model made for running holds numbers only, in the unit that its
name states.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, PlainValidator, ValidationInfo, model_validator

from drivers.capabilities import THERMOMETER, Approach
from drivers.fields import (
    NOT_EMPTY,
    Amperes,
    Celsius,
    CelsiusPerHour,
    CelsiusPerMinute,
    Degrees,
    Name,
    PositiveAmperes,
    PositiveCelsius,
    PositiveSeconds,
    Seconds,
    StrictModel,
    Volts,
)
from drivers.suggest import did_you_mean
from drivers.units import quoted
from drivers.wording import expected, telling


class Move(StrictModel):
    """Turns the head to an angle and waits until it stands there."""

    role: Name = Field(alias="move")
    angle_deg: Degrees = Field(alias="to")
    approach: Approach = "direct"
    settle_s: Seconds = Field(0.0, alias="settle")


class SetOutput(StrictModel):
    """Sets a supply (voltage, current_limit) or a current source (current, compliance), and its output on or off."""

    role: Name = Field(alias="set")
    voltage_v: Volts | None = Field(None, alias="voltage")
    current_limit_a: PositiveAmperes | None = Field(None, alias="current_limit")
    current_a: Amperes | None = Field(None, alias="current")
    compliance_v: Volts | None = Field(None, alias="compliance")
    output: Literal["on", "off"]

    @model_validator(mode="after")
    def _complete(self) -> SetOutput:
        as_supply = (self.voltage_v, self.current_limit_a)
        as_source = (self.current_a, self.compliance_v)
        if self.output == "off":
            if any(value is not None for value in (*as_supply, *as_source)):
                raise telling("with 'output: off' there is no level to set")
        elif None in as_supply and None in as_source:
            raise telling("switching on needs voltage and current_limit, or current and compliance")
        elif any(value is not None for value in as_supply) and any(value is not None for value in as_source):
            raise telling("give voltage and current_limit, or current and compliance, not both")
        return self


class Wait(StrictModel):
    """Lets time pass."""

    duration_s: Seconds = Field(alias="wait")


class Ramp(StrictModel):
    """Takes the chamber's set point to a temperature; ends when the set point in force has arrived."""

    role: Name = Field(alias="ramp")
    temperature_c: Celsius = Field(alias="to")
    rate_c_per_min: CelsiusPerMinute = Field(alias="at")


class Stable(StrictModel):
    """Stable means: over the last `hold`, max - min within band and a fitted slope within slope."""

    band_c: PositiveCelsius = Field(alias="band")
    slope_c_per_h: CelsiusPerHour = Field(alias="slope")
    hold_s: PositiveSeconds = Field(alias="hold")


class Soak(StrictModel):
    """Waits at a temperature: at least so long, and until a reading is stable."""

    role: Name = Field(alias="soak")
    at_least_s: Seconds = Field(alias="at_least")
    until_stable: Stable | None = None
    give_up_after_s: PositiveSeconds | None = Field(None, alias="give_up_after")

    @model_validator(mode="after")
    def _bounded(self) -> Soak:
        if self.until_stable is not None and self.give_up_after_s is None:
            raise telling("'until_stable' needs 'give_up_after': say when to stop waiting")
        return self


class Acquire(StrictModel):
    """Counts pulses for a time, under a label that a result can name."""

    role: Name = Field(alias="acquire")
    duration_s: PositiveSeconds = Field(alias="for")
    label: Name


class ForEach(StrictModel):
    """Does steps again for each value of a list or range; the name holds the value inside."""

    variable: Name = Field(alias="for_each")
    values: Any = Field(alias="in")
    steps: Annotated[tuple[AnyBlock, ...], NOT_EMPTY]


Step = Move | SetOutput | Wait | Ramp | Soak | Acquire
STEPS: dict[str, type[Step]] = {
    "move": Move, "set": SetOutput, "wait": Wait, "ramp": Ramp, "soak": Soak, "acquire": Acquire,
}  # fmt: skip
BLOCKS: dict[str, type[Step | ForEach]] = {**STEPS, "for_each": ForEach}

# The capability that a verb needs of its role.
NEEDS: dict[str, tuple[str, ...]] = {
    "move": ("positioner",),
    "set": ("power_supply", "current_source"),
    "ramp": ("thermal_chamber",),
    "soak": (THERMOMETER,),
    "acquire": ("pulse_counter",),
}


def verb_of(step: Step) -> str:
    """The verb that a step begins with in a document."""
    return next(verb for verb, model in STEPS.items() if isinstance(step, model))


def block_model(raw: object) -> type[Step | ForEach]:
    """The model that a step's first key asks for; PydanticCustomError when it is not a verb."""
    if not isinstance(raw, dict) or not raw:
        raise expected("a step: a mapping whose first key is its verb", raw)
    verb = str(next(iter(raw)))
    if verb in BLOCKS:
        return BLOCKS[verb]
    if later := [key for key in raw if key in BLOCKS]:
        raise telling(f"the first key of a step is its verb: put '{later[0]}' before {quoted(verb)}")
    raise telling(f"unknown step {quoted(verb)}{did_you_mean(verb, BLOCKS)}")


def _block(raw: object, info: ValidationInfo) -> Step | ForEach:
    return block_model(raw).model_validate(raw, context=info.context)


AnyBlock = Annotated[Move | SetOutput | Wait | Ramp | Soak | Acquire | ForEach, PlainValidator(_block)]
ForEach.model_rebuild()
