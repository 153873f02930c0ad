"""What a bench file says: the site, the instruments and their limits, the fixture, the places for units."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal
from zoneinfo import ZoneInfo

from pydantic import AfterValidator, ConfigDict, Field, model_validator

from bench.config.devices import Calibration, CoverageFactor, DeviceEntry, Text
from bench.config.fixture import DIRECTIONS, FixtureEntry, Vector
from bench.config.interlocks import InterlockEntry
from drivers.corrections import TemperatureTable
from drivers.fields import (
    NOT_EMPTY,
    Amperes,
    Arcseconds,
    Celsius,
    Degrees,
    FileBeside,
    Hertz,
    Instant,
    InUnit,
    Name,
    PositiveSeconds,
    Range,
    Ratio,
    Seconds,
    StrictModel,
    TextLike,
    WholeNumber,
)
from drivers.wording import expected, telling


def _zone(name: str) -> str:
    try:
        ZoneInfo(name)
    except (KeyError, ValueError, OSError):
        raise expected("a time zone like Europe/Berlin or UTC", name) from None
    return name


class Gravity(StrictModel):
    """Local gravity in m/s², its expanded uncertainty, and where it comes from."""

    value: Annotated[float, InUnit("m/s²", at_least=9.7, at_most=9.9)] = Field(description="at the height of the units")
    U: Annotated[float, InUnit("m/s²", at_least=0)] = Field(description="expanded uncertainty")
    k: CoverageFactor = Field(2.0, description="coverage factor of U")
    origin: Literal["measured", "model"] = Field(description="how the value was found")


class Site(StrictModel):
    """Where the bench stands."""

    latitude: Annotated[float, InUnit("°", at_least=-90, at_most=90)] = Field(description="north of the equator")
    height: Annotated[float, InUnit("m", at_least=-500, at_most=9000)] = Field(description="above sea level")
    gravity: Gravity
    time_zone: Annotated[str, AfterValidator(_zone)] = Field(
        "UTC", description="of the times in reports, such as Europe/Berlin"
    )
    ambient: tuple[Name, ...] = Field((), description="the readings that tell what the room is like, for reports")


class TemperatureWindow(Range):
    """What a reading may be: from `min` to `max`; outside is an error of the bench."""

    min: Celsius
    max: Celsius


class ThermometerUncertainty(StrictModel):
    """Expanded: an offset, and a gain error on the temperature in °C."""

    offset: Annotated[float, InUnit("°C", at_least=0)] = Field(0.0, description="the same at every temperature")
    gain: Annotated[Ratio, InUnit("", at_least=0)] = Field(0.0, description="of the temperature in °C, such as 0.2 %")


class ThermometerCalibration(Calibration):
    """The certificate of a thermometer."""

    U: ThermometerUncertainty = ThermometerUncertainty()
    corrections: TemperatureTable = Field((), description="rows, by rising temperature")


class ReadingEntry(StrictModel):
    """A named reading: `DEVICE.CHANNEL`."""

    from_: Annotated[str, TextLike(r"[a-z][a-z0-9_]*\.[\w.]+", "DEVICE.CHANNEL")] = Field(
        alias="from", description="the device above, and what its driver calls the reading"
    )
    limits: TemperatureWindow | None = None
    stale_after: PositiveSeconds = Field(10.0, description="an older value is not believed")
    calibration: ThermometerCalibration | None = None

    @property
    def device(self) -> str:
        """The role of the device."""
        return self.from_.partition(".")[0]

    @property
    def channel(self) -> str:
        """The device's name for the reading."""
        return self.from_.partition(".")[2]


class CurrentWindow(Range):
    """What a unit may draw while its supply is on: from `min` to `max`.

    Outside ends the run; where a supply feeds one of several units, that unit is dropped and the others go on.
    """

    min: Amperes
    max: Amperes


class Nominal(StrictModel):
    """What a unit of this type is made to be.

    `time_constants` and `self_heating` are for estimates of how long it takes to settle.
    """

    K1: Annotated[float, InUnit("A/g", above=0)] = Field(description="scale factor")
    S: Annotated[float, InUnit("Hz/A", above=0)] | None = Field(None, description="scale of its converter")
    resistor: Annotated[float, InUnit("Ω", above=0)] | None = Field(
        None, description="what its current flows through, for a voltmeter"
    )
    max_current: Annotated[float, InUnit("A", above=0)] | None = Field(None, description="the most it may be fed")
    load: Annotated[float, InUnit("Ω", at_least=0)] | None = Field(
        None, description="what its input resists; a source's compliance must do for it"
    )
    time_constants: Annotated[tuple[PositiveSeconds, ...], NOT_EMPTY] = Field(
        (180.0, 60.0), description="with which it follows the air, one behind the other: case, sensor"
    )
    self_heating: Annotated[float, InUnit("°C", at_least=0)] = Field(
        0.0, description="how much warmer than the air it becomes while its supply is on"
    )
    converter_time_constant: PositiveSeconds = Field(
        120.0, description="with which its converter follows the air, where that is in the chamber"
    )


class ImuChannels(StrictModel):
    """The channels of the counter that count the pulses of an inertial unit."""

    acc_x: str = Field(description="of accelerometer x")
    acc_y: str = Field(description="of accelerometer y")
    acc_z: str = Field(description="of accelerometer z")
    gyro_x: str = Field(description="of gyro x")
    gyro_y: str = Field(description="of gyro y")
    gyro_z: str = Field(description="of gyro z")


class Arm(StrictModel):
    """Where the sensor of a place is, from the axis that turns it, in the frame of the fixture."""

    x: Annotated[float, InUnit("m")] = Field(0.0, description="along the x of the fixture")
    y: Annotated[float, InUnit("m")] = Field(0.0, description="along the y of the fixture")
    z: Annotated[float, InUnit("m")] = Field(0.0, description="along the z of the fixture")
    U: Annotated[float, InUnit("m", at_least=0)] = Field(0.0, description="expanded uncertainty of each")
    k: CoverageFactor = Field(2.0, description="coverage factor of U")

    @property
    def vector_m(self) -> Vector:
        """All three."""
        return self.x, self.y, self.z


class PlaceEntry(StrictModel):
    """A place for a unit under test: how it lies, what measures its output, what warms and feeds it.

    Its output are the pulses on a `channel`, or the volts that a `voltmeter` reads; an inertial unit has `channels`
    and, beside the thermometer at its accelerometers, one at its gyros. `source` is the current source that can be
    plugged into its converter in place of the accelerometer.
    """

    model_config = ConfigDict(
        json_schema_extra={
            "oneOf": [{"required": ["channel"]}, {"required": ["channels"]}, {"required": ["voltmeter"]}]
        }
    )

    channel: str = Field(
        default_factory=str, min_length=1, description="the channel of the counter that counts its pulses"
    )
    channels: ImuChannels | None = None
    voltmeter: Name | None = Field(
        None, description="the voltmeter across the resistor that its current flows through, where none counts it"
    )
    type: Text = Field("accelerometer channel", description="what the unit is, for the report")
    mount_angle: Degrees = Field(0.0, description="how it is turned in the fixture; added to the head angle")
    temperature: Name = Field(description="the reading of the thermometer at the unit")
    gyro_temperature: Name | None = Field(
        None, description="the reading of the thermometer at the gyros of an inertial unit; as temperature unless given"
    )
    supply: Name = Field(description="the device that feeds the unit")
    supply_current: CurrentWindow | None = None
    source: Name | None = None
    converter_temperature: Name | None = Field(
        None, description="the reading of the thermometer at its converter, where that is in the chamber"
    )
    nominal: Nominal | None = None
    arm: Arm | None = None

    @model_validator(mode="after")
    def _has_one_output(self) -> PlaceEntry:
        found = [name for name in ("channel", "channels", "voltmeter") if getattr(self, name)]
        if len(found) != 1:
            has = f"it has {' and '.join(found)}" if found else "it has none of them"
            raise telling(f"needs channel, channels or voltmeter, which measures the output of the unit; {has}")
        if self.channels is None and self.gyro_temperature is not None:
            raise telling("gyro_temperature is for a unit with channels")
        return self

    @property
    def measured_by(self) -> Mapping[str, str]:
        """The voltmeter, or the channels of the counter, by their keys here, such as "channel" or "channels.acc_x"."""
        if self.channels is not None:
            return {f"channels.{name}": channel for name, channel in self.channels}
        return {"channel": self.channel} if self.voltmeter is None else {"voltmeter": self.voltmeter}

    @property
    def output_unit(self) -> str:
        """What its output is in."""
        return "pulse/s" if self.voltmeter is None else "V"

    @property
    def nominal_per_g(self) -> float | None:
        """What its output is made to change by for 1 g, in its unit; None where the file does not say."""
        if self.nominal is None:
            return None
        converter = self.nominal.S if self.voltmeter is None else self.nominal.resistor
        return None if converter is None else self.nominal.K1 * converter


class Monitor(StrictModel):
    """How often devices are asked, the whole run long: those behind named readings, and all others."""

    period: PositiveSeconds = Field(1.0, description="of the devices behind named readings")
    devices: PositiveSeconds = Field(10.0, description="of all other devices")


FAULTS_OF_DEVICES = ("silent", "cut", "frozen", "stuck", "restart")
FAULTS_OF_UNITS = ("silent", "dead", "open_thermometer", "current")


class ChamberSimulation(StrictModel):
    """How the simulated chamber behaves."""

    start: Celsius = Field(20.0, description="of the air when a run begins")
    natural_period: PositiveSeconds = Field(360.0, description="of the control loop")
    damping: Annotated[Ratio, InUnit("", above=0, at_most=5)] = Field(
        0.5, description="of the control loop; 1 is critical"
    )
    limit_cycle: Annotated[float, InUnit("°C", at_least=0)] = Field(
        0.2, description="root mean square of how the air swings at rest"
    )
    limit_cycle_period: PositiveSeconds = Field(90.0, description="how long one such swing takes")


class HeadSimulation(StrictModel):
    """How the simulated head behaves."""

    backlash: Arcseconds = Field(1.0, description="between its two directions")
    acceleration: Annotated[float, InUnit("°/s²", above=0)] = Field(40.0, description="of every move")


class TableSimulation(StrictModel):
    """What a simulated rate table makes of what it is told."""

    loop: Hertz = Field(150.0, description="natural frequency of its control loop")
    damping: Annotated[Ratio, InUnit("", above=0, at_most=5)] = Field(0.7, description="of its control loop")
    torque: Annotated[float, InUnit("N·m", above=0)] = Field(640.0, description="the most that its motor gives")
    inertia: Annotated[float, InUnit("kg·m²", above=0)] = Field(0.3, description="of the table and its load")
    ripple: Annotated[Ratio, InUnit("", at_least=0)] = Field(
        1e-4, description="of its rate, over a turn: once, twice, and twice for each pair of poles"
    )
    pole_pairs: Annotated[WholeNumber, Field(ge=1, le=100)] = Field(12, description="of its motor")


class ThermometerSimulation(StrictModel):
    """How the simulated thermometers at the units behave."""

    noise: Annotated[float, InUnit("°C", at_least=0)] = Field(0.005, description="standard deviation of a reading")
    lag: PositiveSeconds = Field(20.0, description="time constant behind the unit")


class VoltmeterSimulation(StrictModel):
    """What a simulated voltmeter is connected to: a resistor that the current of a unit flows through."""

    place: Name = Field(description="of the unit")
    load: Annotated[float, InUnit("Ω", above=0)] = Field(description="the resistor")
    noise: Annotated[float, InUnit("V", at_least=0)] = Field(
        0.0, description="standard deviation of a reading over 10 line cycles; it falls with the root of their number"
    )


class SourceSimulation(StrictModel):
    """How a simulated current source errs: standard deviations, in place of a certificate or of what it leaves out."""

    gain: Annotated[Ratio, InUnit("", at_least=0)] = Field(0.0, description="of the current")
    offset: Annotated[float, InUnit("A", at_least=0)] = Field(0.0, description="the same at every current")
    drift: Annotated[float, InUnit("1/h", at_least=0)] = Field(0.0, description="of the current in an hour")
    warm_up: PositiveSeconds = Field(7200.0, description="how long it drifts faster after its power came on")
    fresh: Annotated[Ratio, InUnit("", at_least=1)] = Field(5.0, description="how many times as fast until then")


class FaultSimulation(StrictModel):
    """An instrument, or a unit under test, that breaks on purpose."""

    device: Name | None = Field(None, description="which instrument, as in devices")
    unit: Name | None = Field(None, description="or the unit in which place")
    kind: Literal["silent", "cut", "frozen", "stuck", "restart", "dead", "open_thermometer", "current"] = Field(
        description="a device answers nothing (silent), loses the connection (cut), its values stand still (frozen), "
        "it carries out no command (stuck), or a counter loses its power for a moment (restart); of a unit the frames "
        "stop (silent), the counts stand still (dead), the thermometer opens, or it draws three times its current"
    )
    at: Seconds = Field(description="when, after the beginning of the run")

    @model_validator(mode="after")
    def _of_a_device_or_a_unit(self) -> FaultSimulation:
        if (self.device is None) == (self.unit is None):
            raise telling("give device or unit, one of them")
        allowed = FAULTS_OF_DEVICES if self.unit is None else FAULTS_OF_UNITS
        if self.kind not in allowed:
            what = "a device" if self.unit is None else "a unit"
            raise telling(f"kind is '{self.kind}', {what} can be {', '.join(allowed)}")
        return self


class Simulation(StrictModel):
    """What no certificate states; the errors that certificates bound are drawn from them with sd = U / k."""

    seed: Annotated[WholeNumber, Field(ge=0, lt=2**63)] = Field(1, description="the same one gives the same run")
    start: Instant = Field(
        dt.datetime.fromisoformat("2026-01-01T00:00:00+00:00"), description="when simulated runs begin"
    )
    units: Mapping[Name, Annotated[Path, FileBeside()]] = Field({}, description="the truth of the unit in each place")
    ambient: Celsius = Field(22.0, description="temperature of the room")
    chamber: ChamberSimulation = ChamberSimulation()
    head: HeadSimulation = HeadSimulation()
    table: TableSimulation | None = None
    thermometer: ThermometerSimulation = ThermometerSimulation()
    remount: Arcseconds = Field(
        0.0,
        description="standard deviation of how askew a unit lies each time that it is fixed by hand",
    )
    voltmeters: Mapping[Name, VoltmeterSimulation] = Field({}, description="what each voltmeter is connected to")
    sources: Mapping[Name, SourceSimulation] = Field({}, description="how each current source errs")
    host_clock: Annotated[Ratio, InUnit("", at_least=0)] = Field(
        20e-6, description="standard deviation of the host clock against the true second"
    )
    faults: tuple[FaultSimulation, ...] = ()


class BenchFile(StrictModel):
    """One `config/*.yaml`: a bench."""

    schema_: Literal["itb-bench/1"] = Field(alias="schema", description="what the file is")
    title: Text = Field(description="what the report calls the bench")
    site: Site
    devices: Annotated[Mapping[Name, DeviceEntry], NOT_EMPTY]
    readings: Mapping[Name, ReadingEntry] = {}
    together: Mapping[Name, Annotated[tuple[Name, ...], NOT_EMPTY]] = Field(
        {},
        description="one name for several supplies, current sources or readings, such as one for each unit: a sequence "
        "that sets it sets each, and one that waits for it waits for all",
    )
    interlocks: Mapping[Name, InterlockEntry] = {}
    fixture: FixtureEntry
    places: Annotated[Mapping[Name, PlaceEntry], NOT_EMPTY]
    monitor: Monitor = Monitor()
    simulation: Simulation = Simulation()

    def members(self, name: str) -> tuple[str, ...]:
        """The devices or readings that a name of a sequence stands for; mostly itself alone."""
        return self.together.get(name, (name,))

    def all_simulated(self) -> BenchFile:
        """The same bench with the simulator at the other end of every wire."""
        devices = {
            name: entry.model_copy(update={"connection": entry.connection.as_simulated()})
            for name, entry in self.devices.items()
        }
        return self.model_copy(update={"devices": devices})

    def with_capability(self, *capabilities: str) -> list[str]:
        """The roles of the devices that have one of these capabilities, in the order of the file."""
        return [
            role for role, entry in self.devices.items() if entry.description.capabilities & frozenset(capabilities)
        ]

    @property
    def axes(self) -> Mapping[str, Vector]:
        """Where the axes of the table point while all their angles are 0°, by the devices that drive them, outer first.

        In the level frame: east, north, up.
        """
        fixture = self.fixture
        if fixture.input_axis is None:
            return {axis.device: DIRECTIONS[axis.points] for axis in fixture.axes}
        return dict.fromkeys(self.with_capability("positioner")[:1], DIRECTIONS[fixture.input_axis.points])

    def acquired_from(self, role: str) -> tuple[str, ...]:
        """The devices that an acquisition of `role` records: it alone, or all that measure the outputs of units."""
        if role in self.devices:
            return (role,)
        channels = {place.channel for place in self.places.values()}
        meters = {place.voltmeter for place in self.places.values()}
        return tuple(
            name
            for name, entry in self.devices.items()
            if name in meters or channels & set(getattr(entry.options, "channels", {}))
        )

    def past_due(self, day: dt.date) -> dict[str, dt.date]:
        """The devices and readings whose calibration is not valid any more on a day, each with when it was due."""
        certified: dict[str, DeviceEntry | ReadingEntry] = {**self.devices, **self.readings}
        return {
            name: entry.calibration.due
            for name, entry in certified.items()
            if entry.calibration is not None and entry.calibration.due < day
        }

    @property
    def is_simulated(self) -> bool:
        """Whether no instrument is real."""
        return all(entry.connection.simulated for entry in self.devices.values())

    @property
    def needs_simulators(self) -> bool:
        """Whether any instrument is simulated."""
        return any(entry.connection.simulated for entry in self.devices.values())
