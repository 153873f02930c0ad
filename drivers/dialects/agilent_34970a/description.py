"""Bench file keys of an Agilent 34970A or 34972A."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from drivers.capabilities import THERMOMETER
from drivers.description import DriverDescription
from drivers.dialects.agilent_34970a.wire import Kind, Sensor
from drivers.safe_state import NOTHING
from drivers.schema.fields import NOT_EMPTY, StrictModel, WholeNumber
from drivers.schema.wording import telling

KINDS: Mapping[str, Kind] = {"tc": "TC", "rtd": "RTD", "frtd": "FRTD"}


class SensorOptions(StrictModel):
    """A sensor on a channel. A four-wire resistor also occupies a second channel, which cannot be named then."""

    channel: Annotated[WholeNumber, Field(ge=101, le=340)] = Field(description="slot and channel, such as 101")
    sensor: Literal["tc", "rtd", "frtd"] = Field(
        description="a thermocouple, or a resistor of 100 Ω on two wires or on four"
    )
    type: Literal["B", "E", "J", "K", "N", "R", "S", "T"] | None = Field(
        None, description="type of a thermocouple, required for one"
    )
    alpha: Literal[85, 91] = Field(
        85, description="curve of a resistor: 85 for 0.00385/K (IEC 60751), 91 for 0.00391/K"
    )

    @model_validator(mode="after")
    def _type_of_a_thermocouple(self) -> Self:
        if (self.sensor == "tc") != (self.type is not None):
            raise telling("a thermocouple needs its type, such as K, and a resistor has none")
        return self


class ScannerOptions(StrictModel):
    """Sensors, by the names of their readings."""

    channels: Annotated[dict[str, SensorOptions], NOT_EMPTY]

    @model_validator(mode="after")
    def _one_sensor_on_a_channel(self) -> Self:
        numbers = [sensor.channel for sensor in self.channels.values()]
        if len(set(numbers)) < len(numbers):
            raise telling("two sensors are on one channel")
        return self

    def names(self) -> Mapping[int, str]:
        """Names of the readings by channel, in scan order."""
        return dict(sorted((sensor.channel, name) for name, sensor in self.channels.items()))

    def sensors(self) -> list[Sensor]:
        """Sensors in scan order."""
        found = (self.channels[name] for name in self.names().values())
        return [Sensor(each.channel, KINDS[each.sensor], each.type or str(each.alpha)) for each in found]


def channels(options: ScannerOptions) -> Mapping[str, str]:
    """Channels: one reading in °C for every name."""
    return dict.fromkeys(options.channels, "°C")


DESCRIPTION = DriverDescription(
    name="agilent_34970a",
    title="thermometers on an Agilent (HP, Keysight) 34970A or 34972A scanner",
    capabilities=frozenset({THERMOMETER}),
    schemes=frozenset({"serial", "socket", "tcp"}),
    target="drivers.dialects.agilent_34970a.driver:Agilent34970A",
    simulator="simulators.instruments.meters.agilent_34970a:SimulatedScanner",
    recognition="drivers.dialects.agilent_34970a.recognition:RECOGNITION",
    options=ScannerOptions,
    safe_state=NOTHING,
    channels=channels,
)
