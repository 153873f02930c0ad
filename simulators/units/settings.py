"""The laboratory of one run as drawn, from which the simulated world is constructed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from simulators.physics.attitude import Fixture, Mount, Vector
from simulators.physics.motion import AxisErrors
from simulators.physics.table_kinematics import NOWHERE, TableErrors
from simulators.physics.thermal import ChamberPhysics
from simulators.units.accelerometer import Decoding, Through
from simulators.units.gyro_file import GyroFile
from simulators.units.imu_file import ImuFile
from simulators.units.unit_file import UnitFile
from simulators.units.unit_temperatures import ThermometerErrors

PERFECT = ThermometerErrors()


@dataclass(frozen=True, slots=True)
class PlaceSettings:
    """One unit in its place.

    Outputs are pulses on a `channel`, the voltage across `load_ohm`, or codes with their `decoding`; `source` is the
    device that may feed its converter. `arm_m` is its true position relative to the intersection of the table's axes,
    in the fixture's frame.
    """

    unit: UnitFile | GyroFile
    channel: str
    supply: str
    mount_angle_deg: float = 0.0
    thermometer: ThermometerErrors = PERFECT
    load_ohm: float | None = None
    converter_thermometer: ThermometerErrors = PERFECT
    source: str = ""
    arm_m: Vector = NOWHERE
    decoding: Decoding | None = None
    clock_deg: float = 0.0

    @property
    def through(self) -> Through:
        """Signal path of its current."""
        return self.decoding if self.load_ohm is None else self.load_ohm


@dataclass(frozen=True, slots=True)
class ImuPlace:
    """An inertial unit in its place.

    `channels` are those of the counter or of the telemetry, by CHANNELS, and `decodings` those of sent codes;
    `thermometers` are their errors, by SENSORS, and by CHANNELS those at single sensors. `source` is the device that
    may feed one of its converters. `arm_m` is the true position of its reference point, as in PlaceSettings.
    """

    unit: ImuFile
    channels: Mapping[str, str]
    supply: str
    mount_angle_deg: float
    thermometers: Mapping[str, ThermometerErrors]
    decodings: Mapping[str, Decoding] = field(default_factory=dict)
    converter_thermometer: ThermometerErrors = PERFECT
    source: str = ""
    arm_m: Vector = NOWHERE


@dataclass(frozen=True, slots=True)
class WorldSettings:
    """The laboratory of one run: its seed, its own errors as drawn, and the units by place.

    `axes` are those of the table by the role of their drive, outer first, in the order of the fixture. `level_deg` is
    the tilt of its base in the middle of the run, `mount` the initial mounting of the units. `fixture` is the nominal
    one, `built` the real one; without it they are the same.
    """

    seed: int
    gravity_mps2: float
    host_clock: float = 0.0  # relative error of the host's clock against the true second
    device_clock: float = 0.0  # relative error of the counter's time base
    encoder_skew_s: float = 0.0  # delay of the counter's encoder latch after that of the pulses
    axes: Mapping[str, AxisErrors] = field(default_factory=lambda: {"head": AxisErrors()})
    axis_acceleration_dps2: float = 40.0
    level_deg: float = 0.0
    level_drift_deg: float = 0.0  # change within the run
    latitude_deg: float = 0.0
    table: TableErrors = field(default_factory=TableErrors)
    mount: Mount = field(default_factory=Mount)
    ambient_c: float = 22.0  # temperature of the room
    remount_deg: float = 0.0  # standard deviation of the mounting error of a unit, each time it is mounted by hand
    fixture: Fixture = field(default_factory=Fixture)
    chamber: ChamberPhysics = field(default_factory=ChamberPhysics)
    thermometer_lag_s: float = 20.0
    thermometer_noise_c: float = 0.005
    run_s: float = 0.0  # expected duration of the run, for errors that drift within it; 0 for no drift
    places: Mapping[str, PlaceSettings] = field(default_factory=dict)
    imus: Mapping[str, ImuPlace] = field(default_factory=dict)
    built: Fixture | None = None
