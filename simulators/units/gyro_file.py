"""File of a unit with one gyro."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from drivers.schema.fields import StrictModel
from simulators.units.gyro import GyroModel
from simulators.units.unit_file import Draw, DrawIn, SupplyModel, TelemetryModel, ThermalModel


class GyroTelemetryModel(TelemetryModel):
    """Codes of a gyro: S times its pulse rate, a zero, and white noise on each sample."""

    S: Annotated[Draw, DrawIn("code·s/pulse")]


class CurrentModel(StrictModel):
    """Current of a gyro with an analogue output: S times its pulse rate, and a zero."""

    S: Annotated[Draw, DrawIn("A·s/pulse")]
    zero: Annotated[Draw, DrawIn("A")] = Draw(0)


class GyroFile(StrictModel):
    """One `config/uut/*.yaml` with a gyro instead of an accelerometer; its input axis is the x of its place."""

    schema_: Literal["itb-uut/1"] = Field(alias="schema")
    title: str
    gyro: GyroModel
    thermal: ThermalModel = ThermalModel()
    supply: SupplyModel = SupplyModel()
    telemetry: GyroTelemetryModel | None = None
    current: CurrentModel | None = None
