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
    """How the controller is spoken to.

    `word_order` is the controller's own setting. `block_reads: false` is for controllers, or gateways, that refuse a
    request over several values. `poll` is how often a ramp that has nearly arrived is looked at.
    """

    unit_id: Annotated[WholeNumber, Field(ge=1, le=247)] = 1
    loop: Annotated[WholeNumber, Field(ge=1, le=4)] = 1
    word_order: WordOrder = "low_first"
    poll: Annotated[float, InUnit("s", above=0, at_most=30)] = 1.0
    answer_timeout: PositiveSeconds = 3.0
    block_reads: Flag = True


class TemperatureRange(Range):
    """From `min` to `max`, both allowed."""

    min: Celsius
    max: Celsius


class RampRateRange(StrictModel):
    """The fastest ramp."""

    max: CelsiusPerMinute


class F4TLimits(StrictModel):
    """What the bench allows the chamber; the controller's own limits hold as well."""

    temperature: TemperatureRange
    ramp_rate: RampRateRange


class F4TSafe(StrictModel):
    """Where the set point goes when the bench is made safe."""

    temperature: Celsius = 25.0


DESCRIPTION = DriverDescription(
    name="watlow_f4t",
    title="thermal chamber with a Watlow F4T, Modbus TCP",
    capabilities=frozenset({"thermal_chamber"}),
    schemes=frozenset({"tcp"}),
    target="drivers.watlow_f4t.driver:WatlowF4T",
    options=F4TOptions,
    limits=F4TLimits,
    safe=F4TSafe,
    channels={"process_value": "°C", "set_point": "°C"},
)
