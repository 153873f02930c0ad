"""What a step can be. The first key of a step is its verb and names the role it acts on.

In a document a value may be an expression `${…}`; a model made for running holds numbers only, in the unit that its
name states.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

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


class Timed(StrictModel):
    """What every step may say: how long it may take at most."""

    timeout_s: PositiveSeconds | None = Field(None, alias="timeout")

    @property
    def least_s(self) -> float:
        """The time that the step takes at least, by what it says itself."""
        return 0.0

    @model_validator(mode="after")
    def _can_end_in_time(self) -> Self:
        if self.timeout_s is not None and self.timeout_s <= self.least_s:
            raise telling(f"its timeout of {self.timeout_s:g} s is over before the {self.least_s:g} s that it takes")
        return self


class Move(Timed):
    """Turns the head to an angle and waits until it stands there."""

    role: Name = Field(alias="move")
    angle_deg: Degrees = Field(alias="to")
    approach: Approach = "direct"
    settle_s: Seconds = Field(0.0, alias="settle")


class SetOutput(Timed):
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


class Wait(Timed):
    """Lets time pass."""

    duration_s: Seconds = Field(alias="wait")

    @property
    def least_s(self) -> float:
        """The time itself."""
        return self.duration_s


class WaitUntil(Timed):
    """Waits until a reading is above one value, below another, or both, and has been so for a time."""

    role: Name = Field(alias="wait_until")
    above_c: Celsius | None = Field(None, alias="above")
    below_c: Celsius | None = Field(None, alias="below")
    hold_s: Seconds = Field(0.0, alias="hold")
    give_up_after_s: PositiveSeconds = Field(alias="give_up_after")

    @property
    def least_s(self) -> float:
        """How long the condition must hold."""
        return self.hold_s

    @model_validator(mode="after")
    def _can_come_true(self) -> Self:
        if self.above_c is None and self.below_c is None:
            raise telling("needs above, or below, or both")
        if self.above_c is not None and self.below_c is not None and self.above_c >= self.below_c:
            raise telling(f"nothing is above {self.above_c:g} °C and below {self.below_c:g} °C")
        if self.give_up_after_s <= self.hold_s:
            raise telling("'give_up_after' must be longer than 'hold'")
        return self


class Note(Timed):
    """Writes a text into the record of the run, and shows it."""

    text: Annotated[str, Field(min_length=1, max_length=500)] = Field(alias="note")


class Ramp(Timed):
    """Takes the chamber's set point to a temperature; ends when the set point in force has arrived."""

    role: Name = Field(alias="ramp")
    temperature_c: Celsius = Field(alias="to")
    rate_c_per_min: CelsiusPerMinute = Field(alias="at")


class Stable(StrictModel):
    """Stable means: over the last `hold`, max - min within band and a fitted slope within slope."""

    band_c: PositiveCelsius = Field(alias="band")
    slope_c_per_h: CelsiusPerHour = Field(alias="slope")
    hold_s: PositiveSeconds = Field(alias="hold")


class Soak(Timed):
    """Waits at a temperature: at least so long, and until a reading is stable."""

    role: Name = Field(alias="soak")
    at_least_s: Seconds = Field(alias="at_least")
    until_stable: Stable | None = None
    give_up_after_s: PositiveSeconds | None = Field(None, alias="give_up_after")

    @property
    def least_s(self) -> float:
        """The fixed time, or the time to see that it is stable."""
        return max(self.at_least_s, self.until_stable.hold_s if self.until_stable else 0.0)

    @model_validator(mode="after")
    def _bounded(self) -> Soak:
        if self.until_stable is not None and self.give_up_after_s is None:
            raise telling("'until_stable' needs 'give_up_after': say when to stop waiting")
        return self


class Acquire(Timed):
    """Counts pulses for a time, under a label that a result can name."""

    role: Name = Field(alias="acquire")
    duration_s: PositiveSeconds = Field(alias="for")
    label: Name

    @property
    def least_s(self) -> float:
        """The counting time."""
        return self.duration_s


class ForEach(StrictModel):
    """Does steps again for each value of a list or range; the name holds the value inside."""

    variable: Name = Field(alias="for_each")
    values: Any = Field(alias="in")
    steps: Annotated[tuple[AnyBlock, ...], NOT_EMPTY]


class Repeat(StrictModel):
    """Does steps again and again, so many times."""

    count: Any = Field(alias="repeat")
    steps: Annotated[tuple[AnyBlock, ...], NOT_EMPTY]


class Group(StrictModel):
    """Steps under a name, which their ids then hold."""

    name: Name = Field(alias="group")
    steps: Annotated[tuple[AnyBlock, ...], NOT_EMPTY]


Step = Move | SetOutput | Wait | WaitUntil | Note | Ramp | Soak | Acquire
Block = ForEach | Repeat | Group
STEPS: dict[str, type[Step]] = {
    "move": Move, "set": SetOutput, "wait": Wait, "wait_until": WaitUntil, "note": Note, "ramp": Ramp, "soak": Soak,
    "acquire": Acquire,
}  # fmt: skip
BLOCKS: dict[str, type[Step | Block]] = {**STEPS, "for_each": ForEach, "repeat": Repeat, "group": Group}

# The capability that a verb needs of its role.
NEEDS: dict[str, tuple[str, ...]] = {
    "move": ("positioner",),
    "set": ("power_supply", "current_source"),
    "ramp": ("thermal_chamber",),
    "soak": (THERMOMETER,),
    "wait_until": (THERMOMETER,),
    "acquire": ("pulse_counter",),
}


def verb_of(step: Step) -> str:
    """The verb that a step begins with in a document."""
    return next(verb for verb, model in STEPS.items() if isinstance(step, model))


def block_model(raw: object) -> type[Step | Block]:
    """The model that a step's first key asks for; PydanticCustomError when it is not a verb."""
    if not isinstance(raw, dict) or not raw:
        raise expected("a step: a mapping whose first key is its verb", raw)
    verb = str(next(iter(raw)))
    if verb in BLOCKS:
        return BLOCKS[verb]
    if later := [key for key in raw if key in BLOCKS]:
        raise telling(f"the first key of a step is its verb: put '{later[0]}' before {quoted(verb)}")
    raise telling(f"unknown step {quoted(verb)}{did_you_mean(verb, BLOCKS)}")


def _block(raw: object, info: ValidationInfo) -> Step | Block:
    return block_model(raw).model_validate(raw, context=info.context)


AnyBlock = Annotated[Step | Block, PlainValidator(_block)]
