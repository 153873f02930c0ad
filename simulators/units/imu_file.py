"""Truth of a simulated inertial unit as stated in its file; only the simulators read it.

The rules are those of a single channel (`unit_file`): each accelerometer with its converter is one.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from drivers.schema.fields import Celsius, InUnit, PositiveSeconds, StrictModel
from simulators.units.gyro import GyroModel
from simulators.units.unit_file import (
    AccelerometerModel,
    BoardCodes,
    CodesModel,
    ConverterModel,
    Draw,
    DrawIn,
    Ratio,
    SupplyModel,
    TelemetryModel,
    ThermalModel,
    ThermostatModel,
    UnitFile,
)

NAMES = ("x", "y", "z")
Angle = Annotated[Draw, DrawIn("rad")]


Length = Annotated[Draw, DrawIn("m")]


class Position(StrictModel):
    """Position in the frame of the unit, from its reference point."""

    x: Length = Draw(0)
    y: Length = Draw(0)
    z: Length = Draw(0)


class ImuAccelerometer(AccelerometerModel):
    """An accelerometer of the three; its misalignments are those of the unit's matrix."""

    converter: ConverterModel
    position: Position = Position()

    @model_validator(mode="after")
    def _has_no_play(self) -> ImuAccelerometer:
        if self.input_hysteresis.thresholds:
            raise ValueError("input_hysteresis is simulated for single accelerometers only, not for inertial units")
        return self


class MatrixRow(StrictModel):
    """Cross-sensitivity of an axis to the others; that to itself is one."""

    x: Angle = Draw(0)
    y: Angle = Draw(0)
    z: Angle = Draw(0)


class Misalignment(StrictModel):
    """A row for each axis."""

    x: MatrixRow = MatrixRow()
    y: MatrixRow = MatrixRow()
    z: MatrixRow = MatrixRow()


class Accelerometers(StrictModel):
    """Three accelerometers with their converters."""

    x: ImuAccelerometer
    y: ImuAccelerometer
    z: ImuAccelerometer
    misalignment: Misalignment = Misalignment()

    @model_validator(mode="after")
    def _share_a_board(self) -> Accelerometers:
        boards = {
            (each.converter.in_chamber, each.converter.time_constant, each.converter.temperature)
            for each in (self.x, self.y, self.z)
        }
        if len(boards) > 1:
            raise ValueError("the converters share a board: in_chamber, time_constant and temperature are those of all")
        return self


class ZeroWarmUp(StrictModel):
    """A bias that decays exponentially from power-on."""

    amplitude: Annotated[Draw, DrawIn("°/s")] = Draw(0)
    time_constant: PositiveSeconds = 1200.0


class ImuGyro(GyroModel):
    """A gyro of the three; its misalignments are those of the unit's matrix."""

    drift: Annotated[Draw, DrawIn("°/s²")] = Draw(0)
    warm_up: ZeroWarmUp = ZeroWarmUp()


class Gyros(StrictModel):
    """Three gyros with pulse outputs."""

    x: ImuGyro
    y: ImuGyro
    z: ImuGyro
    misalignment: Misalignment = Misalignment()


class GyroCodes(CodesModel):
    """Codes of a gyro instead of pulses: S times its pulse rate."""

    S: Annotated[Draw, DrawIn("code/(pulse/s)")]


class ImuTelemetry(StrictModel):
    """A unit that sends codes; `clock` is the relative error of the clock by which all channels are sampled."""

    accelerometers: BoardCodes
    gyros: GyroCodes
    clock: Ratio = Draw(0)


Share = Annotated[float, InUnit("", at_least=-0.5, at_most=0.5)]


class ToRoom(StrictModel):
    """Shares of the difference between the room and the unit in the temperatures of its sensors."""

    Ax: Share = 0.0
    Ay: Share = 0.0
    Az: Share = 0.0
    Wx: Share = 0.0
    Wy: Share = 0.0
    Wz: Share = 0.0

    @property
    def shares(self) -> tuple[float, ...]:
        """Those of the accelerometers x, y, z, then of the gyros."""
        return self.Ax, self.Ay, self.Az, self.Wx, self.Wy, self.Wz


class CircuitModel(StrictModel):
    """Temperature circuit of the unit: output as a polynomial about a temperature, white noise of a reading."""

    at: Celsius = 25.0
    output: Annotated[Draw, DrawIn("Hz")]
    linear: Annotated[Draw, DrawIn("Hz/°C")]
    quadratic: Annotated[Draw, DrawIn("Hz/°C²")] = Draw(0)
    noise: Annotated[Draw, DrawIn("Hz")] = Draw(0)


class ImuThermal(StrictModel):
    """Thermal response of the unit to the chamber: one case, and the sensors in it.

    A thermostat holds the accelerometers.
    """

    case_time_constant: PositiveSeconds = 900.0
    accelerometer_time_constant: PositiveSeconds = 240.0
    gyro_time_constant: PositiveSeconds = 240.0
    self_heating: Celsius = 0.0
    thermostat: ThermostatModel | None = None
    to_room: ToRoom = ToRoom()
    circuit: CircuitModel | None = None


class ImuFile(StrictModel):
    """One `config/uut/*.yaml` with accelerometers and gyros."""

    schema_: Literal["itb-uut/1"] = Field(alias="schema")
    title: str
    accelerometers: Accelerometers
    gyros: Gyros
    thermal: ImuThermal = ImuThermal()
    supply: SupplyModel = SupplyModel()
    telemetry: ImuTelemetry | None = None

    def accelerometer(self, axis: str) -> UnitFile:
        """One accelerometer with its converter, as a unit of its own."""
        model: ImuAccelerometer = getattr(self.accelerometers, axis)
        fields = {name: getattr(model, name) for name in AccelerometerModel.model_fields}
        fields |= _turned(self.accelerometers.misalignment, axis)
        return UnitFile.model_construct(
            schema_=self.schema_,
            title=f"{self.title}, accelerometer {axis}",
            accelerometer=AccelerometerModel.model_construct(**fields),
            converter=model.converter,
            thermal=ThermalModel.model_construct(
                case_time_constant=self.thermal.case_time_constant,
                sensor_time_constant=self.thermal.accelerometer_time_constant,
                self_heating=self.thermal.self_heating,
                thermostat=self.thermal.thermostat,
            ),
            supply=self.supply,
            telemetry=None if self.telemetry is None else _sent(self.telemetry),
        )

    def gyro(self, axis: str) -> ImuGyro:
        """One gyro, with its misalignments."""
        model: ImuGyro = getattr(self.gyros, axis)
        return model.model_copy(update=_turned(self.gyros.misalignment, axis))


def _sent(model: ImuTelemetry) -> TelemetryModel:
    """Codes of an accelerometer as a unit of its own; the clock is that of all channels."""
    return TelemetryModel.model_construct(**dict(model.accelerometers), clock=Draw(0))


def _turned(matrix: Misalignment, axis: str) -> dict[str, Draw]:
    """Misalignments of a single sensor, from a row of a matrix; its pendulous and output axes are the next two."""
    row: MatrixRow = getattr(matrix, axis)
    pendulous, output = following(axis)
    second: Draw = getattr(row, output)
    return {"misalignment_o": getattr(row, pendulous), "misalignment_p": Draw(-second.mean, second.sd)}


def following(axis: str) -> tuple[str, str]:
    """The two axes after one: for x, y and z."""
    index = NAMES.index(axis)
    return NAMES[(index + 1) % 3], NAMES[(index + 2) % 3]
