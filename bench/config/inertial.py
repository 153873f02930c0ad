"""Parts of a place for an inertial unit: its channels, thermometers at its sensors, its temperature circuit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field, model_validator

from drivers.schema.fields import AnyQuantity, InUnit, Name, StrictModel
from drivers.schema.wording import telling


class ImuChannels(StrictModel):
    """Channels of an inertial unit: of the counter that counts its pulses, or of the telemetry it sends."""

    acc_x: str = Field(description="of accelerometer x")
    acc_y: str = Field(description="of accelerometer y")
    acc_z: str = Field(description="of accelerometer z")
    gyro_x: str = Field(description="of gyro x")
    gyro_y: str = Field(description="of gyro y")
    gyro_z: str = Field(description="of gyro z")


class SensorThermometers(StrictModel):
    """Readings of the thermometers at single sensors of an inertial unit: accelerometers A, gyros W.

    A sensor without one has the thermometer of its triad: `temperature`, or of a gyro `gyro_temperature`.
    """

    Ax: Name | None = Field(None, description="at accelerometer x")
    Ay: Name | None = Field(None, description="at accelerometer y")
    Az: Name | None = Field(None, description="at accelerometer z")
    Wx: Name | None = Field(None, description="at gyro x")
    Wy: Name | None = Field(None, description="at gyro y")
    Wz: Name | None = Field(None, description="at gyro z")

    @model_validator(mode="after")
    def _has_one(self) -> SensorThermometers:
        if not self.named:
            raise telling("needs at least one of Ax, Ay, Az, Wx, Wy, Wz")
        return self

    @property
    def named(self) -> Mapping[str, str]:
        """Readings by their keys, without sensors that have no thermometer of their own."""
        return {key: reading for key, reading in self if reading is not None}


class CircuitEntry(StrictModel):
    """Temperature circuit of an inertial unit, its own thermometer, whose output at the nominal temperature is found.

    `nominal`, `at` and `slope` are its nominal characteristic, which a temperature indicated by it needs; one whose
    output is in °C has none.
    """

    output: Name = Field(description="the reading of its output")
    reference: Name | None = Field(
        None, description="the reading of the thermometer it is compared with; as temperature unless given"
    )
    nominal: AnyQuantity | None = Field(None, description="nominal output, in the unit of the reading")
    at: Annotated[float, InUnit("°C")] | None = Field(None, description="temperature of the nominal output")
    slope: AnyQuantity | None = Field(None, description="nominal change of the output with 1 °C, such as 20 Hz/°C")

    @model_validator(mode="after")
    def _is_whole(self) -> CircuitEntry:
        stated = [self.nominal is not None, self.at is not None, self.slope is not None]
        if any(stated) and not all(stated):
            raise telling("needs nominal, at and slope together, or none of them")
        if self.slope is not None and not self.slope.base_value:
            raise telling("slope is 0, expected the change of the output with 1 °C")
        return self
