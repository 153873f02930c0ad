"""What a bench file says of a chamber with a Watlow F4T."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drivers.description import DriverDescription
from drivers.fields import (
    Celsius,
    CelsiusPerMinute,
    Flag,
    InUnit,
    PositiveSeconds,
    Range,
    StrictModel,
    WholeNumber,
)
from drivers.watlow_f4t.wire import WordOrder


class F4TOptions(StrictModel):
    """How the controller is spoken to."""

    unit_id: Annotated[WholeNumber, Field(ge=1, le=247)] = Field(1, description="its Modbus address")
    loop: Annotated[WholeNumber, Field(ge=1, le=4)] = Field(1, description="the control loop of the chamber")
    word_order: WordOrder = Field("low_first", description="as it is set in the controller")
    poll: Annotated[float, InUnit("s", above=0, at_most=30)] = Field(
        1.0, description="how often a ramp that has nearly arrived is looked at"
    )
    answer_timeout: PositiveSeconds = Field(3.0, description="how long an answer may take")
    block_reads: Flag = Field(True, description="false for what refuses a request over several values, as gateways may")


class TemperatureRange(Range):
    """From `min` to `max`, both allowed."""

    min: Celsius
    max: Celsius


class RampRateRange(StrictModel):
    """The fastest ramp: `max`."""

    max: CelsiusPerMinute


class F4TLimits(StrictModel):
    """What the bench allows the chamber; the controller's own limits hold as well."""

    temperature: TemperatureRange
    ramp_rate: RampRateRange


class F4TSafe(StrictModel):
    """Where the set point goes when the bench is made safe."""

    temperature: Celsius = Field(25.0, description="the set point")


DESCRIPTION = DriverDescription(
    name="watlow_f4t",
    title="thermal chamber with a Watlow F4T, Modbus TCP or RTU",
    capabilities=frozenset({"thermal_chamber"}),
    schemes=frozenset({"tcp", "serial", "socket"}),
    target="drivers.watlow_f4t.driver:WatlowF4T",
    simulator="simulators.watlow_f4t:SimulatedF4T",
    options=F4TOptions,
    limits=F4TLimits,
    safe=F4TSafe,
    channels={"process_value": "°C", "set_point": "°C"},
)
