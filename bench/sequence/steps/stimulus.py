"""Steps that stimulate the unit under test: motion, temperature, electrical supply."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from bench.sequence.steps.fields import Resumed, StepBase, choice_of, one_of
from bench.sequence.steps.nested import Steps
from drivers.capabilities import Approach
from drivers.schema.fields import (
    Amperes,
    Celsius,
    CelsiusPerMinute,
    Degrees,
    Hertz,
    InUnit,
    Name,
    PositiveAmperes,
    PositiveSeconds,
    Seconds,
    StrictModel,
    Volts,
)
from drivers.schema.wording import telling

TURN_DEG = 360.0
THERE_DEG = 0.01  # an axis this close is already there: no whole turn is meant
SWEEP_STEPS_PER_OCTAVE = 6
Way = Literal["as_written", "nearest", "increasing", "decreasing"]
Rate = Annotated[float, InUnit("°/s")]
Acceleration = Annotated[float, InUnit("°/s²", above=0)]
Amplitude = Annotated[float, InUnit("°", above=0)]


class Move(StepBase):
    """Turn the head to an angle and wait until it has settled.

    `to` is an encoder angle, `by` is relative to the target of the last move. With a way other than as_written, `to` is
    any angle that differs by whole turns: the nearest, or the next one up or down.
    """

    resumed: ClassVar[Resumed] = "restored"

    model_config = one_of(("to",), ("by",))

    role: Name = Field(alias="move")
    to_deg: Degrees | None = Field(None, alias="to", description="encoder angle")
    by_deg: Degrees | None = Field(None, alias="by", description="relative to the target of the last move")
    way: Way = Field("as_written", description="direction for an angle modulo a turn")
    approach: Approach = Field("direct", description="the side from which the angle is reached")
    settle_s: Seconds = Field(0.0, alias="settle", description="dwell after it has settled")

    @property
    def least_s(self) -> float:
        """Settling time."""
        return self.settle_s

    @model_validator(mode="after")
    def _one_target(self) -> Self:
        if choice_of({"to": self.to_deg, "by": self.by_deg}, "a move") == "by" and self.way != "as_written":
            raise telling("'way' is for 'to'; the sign of 'by' gives the direction")
        return self

    def target_deg(self, from_deg: float) -> float:
        """Target angle if the target of the last move was `from_deg`."""
        if self.by_deg is not None:
            return from_deg + self.by_deg
        to_deg = self.to_deg if self.to_deg is not None else math.nan
        if self.way == "as_written" or math.isnan(to_deg):
            return to_deg
        up_deg = (to_deg - from_deg) % TURN_DEG
        is_there = min(up_deg, TURN_DEG - up_deg) < THERE_DEG
        go_up = up_deg <= TURN_DEG / 2 if self.way == "nearest" or is_there else self.way == "increasing"
        return from_deg + up_deg if go_up else from_deg + up_deg - TURN_DEG


class Rotate(StepBase):
    """Rotate the table at a rate: for a number of turns, a time, or during other steps; it is at rest at the end."""

    model_config = one_of(("turns",), ("for",), ("during",))

    role: Name = Field(alias="rotate")
    rate_dps: Rate = Field(alias="at", description="the rate; its sign is the direction")
    acceleration_dps2: Acceleration | None = Field(
        None, alias="acceleration", description="angular acceleration; default: that of the table"
    )
    turns: Annotated[float, InUnit("", above=0)] | None = Field(None, description="number of turns at the rate")
    duration_s: PositiveSeconds | None = Field(None, alias="for", description="time at the rate")
    during: Steps | None = Field(None, description="these steps run meanwhile")

    @property
    def least_s(self) -> float:
        """Time at the rate."""
        if self.turns is not None:
            return self.turns * TURN_DEG / abs(self.rate_dps)
        return self.duration_s or 0.0

    @model_validator(mode="before")
    @classmethod
    def _one_end(cls, raw: Any) -> Any:
        if isinstance(raw, dict):
            choice_of({key: raw.get(key) for key in ("turns", "for", "during")}, "a rotation")
        return raw

    @model_validator(mode="after")
    def _turns(self) -> Self:
        if self.rate_dps == 0:
            raise telling("at 0 °/s nothing turns")
        return self


class Sweep(StrictModel):
    """Frequencies one after the other, each for the same time with a constant ratio, or with `over` a chirp.

    A chirp begins with the first of the steps in `during`, and its frequency is proportional to time.
    """

    from_hz: Hertz = Field(alias="from", description="the first frequency")
    to_hz: Hertz = Field(alias="to", description="the last frequency")
    over_s: PositiveSeconds | None = Field(
        None, alias="over", description="time within which the frequency changes continuously"
    )


class Oscillate(StepBase):
    """Oscillate the table about its present angle: for a time, or during other steps; it is at rest at the end."""

    role: Name = Field(alias="oscillate")
    amplitude_deg: Amplitude = Field(alias="amplitude", description="amplitude")
    frequency_hz: Hertz | None = Field(None, alias="frequency", description="a constant frequency")
    sweep: Sweep | None = None
    duration_s: PositiveSeconds | None = Field(None, alias="for", description="how long")
    during: Steps | None = Field(None, description="these steps run meanwhile")

    @property
    def least_s(self) -> float:
        """Duration of the oscillation."""
        return self.duration_s or 0.0

    @property
    def chirp(self) -> Sweep | None:
        """Continuous sweep of the frequency; None for constant frequencies."""
        return self.sweep if self.sweep is not None and self.sweep.over_s is not None else None

    @property
    def highest_hz(self) -> float:
        """Highest frequency, the most demanding one for the table."""
        return max(self.sweep.from_hz, self.sweep.to_hz) if self.sweep else self.frequency_hz or math.nan

    @property
    def frequencies_hz(self) -> tuple[float, ...]:
        """Frequencies in order, each for the same time; those of a sweep have a constant ratio."""
        if self.chirp is not None:
            return (self.chirp.from_hz,)
        if self.sweep is None or math.isnan(self.sweep.from_hz + self.sweep.to_hz):
            return (self.highest_hz,)
        octaves = math.log2(self.sweep.to_hz / self.sweep.from_hz)
        count = max(round(abs(octaves) * SWEEP_STEPS_PER_OCTAVE), 1)
        return tuple(self.sweep.from_hz * 2 ** (octaves * index / count) for index in range(count + 1))

    @model_validator(mode="before")
    @classmethod
    def _one_of_each(cls, raw: Any) -> Any:
        if isinstance(raw, dict):
            choice_of({key: raw.get(key) for key in ("frequency", "sweep")}, "an oscillation")
            end = choice_of({key: raw.get(key) for key in ("for", "during")}, "an oscillation")
            sweep = raw.get("sweep")
            if isinstance(sweep, Mapping) and sweep.get("over") is not None:
                if end == "for":
                    raise telling("a sweep with 'over' lasts as long as the steps inside it: give 'during'")
            elif sweep is not None and end == "during":
                raise telling("a sweep needs its duration: give 'for', or 'over' for a continuous one")
        return raw


class SetOutput(StepBase):
    """Set a supply (voltage, current_limit) or a current source (current, compliance), and switch its output on or off.

    For a current source, `acceleration` may be given instead of its current, by the nominal K1 of a place.
    """

    resumed: ClassVar[Resumed] = "restored"

    role: Name = Field(alias="set")
    voltage_v: Volts | None = Field(None, alias="voltage", description="of a supply")
    current_limit_a: PositiveAmperes | None = Field(
        None, alias="current_limit", description="of a supply: the current limit"
    )
    current_a: Amperes | None = Field(None, alias="current", description="of a current source")
    acceleration_g: Annotated[float, InUnit("g")] | None = Field(
        None, alias="acceleration", description="of a current source: the equivalent acceleration"
    )
    place: Name | None = Field(None, description="its nominal K1 converts the acceleration to a current")
    compliance_v: Volts | None = Field(None, alias="compliance", description="of a current source: the maximum voltage")
    output: Literal["on", "off"] = Field(description="state of the output")

    @model_validator(mode="after")
    def _complete(self) -> SetOutput:
        as_supply = (self.voltage_v, self.current_limit_a)
        level = self.current_a if self.acceleration_g is None else self.acceleration_g
        as_source = (level, self.compliance_v)
        if self.output == "off":
            if any(value is not None for value in (*as_supply, *as_source)):
                raise telling("with 'output: off' there is no level to set")
        elif None in as_supply and None in as_source:
            raise telling("switching on needs voltage and current_limit, or current and compliance")
        elif any(value is not None for value in as_supply) and any(value is not None for value in as_source):
            raise telling("give voltage and current_limit, or current and compliance, not both")
        if self.current_a is not None and self.acceleration_g is not None:
            raise telling("give current or acceleration, not both")
        if (self.acceleration_g is None) != (self.place is None):
            raise telling("acceleration and place go together: the K1 of the unit in that place makes it a current")
        return self


class Ramp(StepBase):
    """Ramp the set point of the chamber to a temperature; ends when the set point in force has arrived."""

    resumed: ClassVar[Resumed] = "restored"

    role: Name = Field(alias="ramp")
    temperature_c: Celsius = Field(alias="to", description="target of the set point")
    rate_c_per_min: CelsiusPerMinute = Field(alias="at", description="rate of the set point")
