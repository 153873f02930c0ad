"""What a bench file says: the site, the instruments and their limits, the fixture, the places for units."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal
from zoneinfo import ZoneInfo

from pydantic import AfterValidator, Field, model_validator

from bench.config.devices import Calibration, CoverageFactor, DeviceEntry, Text
from drivers.fields import (
    NOT_EMPTY,
    Amperes,
    Arcseconds,
    Celsius,
    Date,
    Degrees,
    FileBeside,
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

    value: Annotated[float, InUnit("m/s²", at_least=9.7, at_most=9.9)]
    U: Annotated[float, InUnit("m/s²", at_least=0)]
    k: CoverageFactor = 2.0
    origin: Literal["measured", "model"]


class Site(StrictModel):
    """Where the bench stands."""

    latitude: Annotated[float, InUnit("°", at_least=-90, at_most=90)]
    height: Annotated[float, InUnit("m", at_least=-500, at_most=9000)]
    gravity: Gravity
    time_zone: Annotated[str, AfterValidator(_zone)] = "UTC"


class TemperatureWindow(Range):
    """What a reading may be."""

    min: Celsius
    max: Celsius


class ThermometerUncertainty(StrictModel):
    """Expanded: an offset, and a gain error on the temperature in °C."""

    offset: Annotated[float, InUnit("°C", at_least=0)] = 0.0
    gain: Annotated[Ratio, InUnit("", at_least=0)] = 0.0


class ThermometerCalibration(Calibration):
    """The certificate of a thermometer."""

    U: ThermometerUncertainty = ThermometerUncertainty()


class ReadingEntry(StrictModel):
    """A named reading: `DEVICE.CHANNEL`."""

    from_: Annotated[str, TextLike(r"[a-z][a-z0-9_]*\.[\w.]+", "DEVICE.CHANNEL")] = Field(alias="from")
    limits: TemperatureWindow | None = None
    stale_after: PositiveSeconds = 10.0
    calibration: ThermometerCalibration | None = None

    @property
    def device(self) -> str:
        """The role of the device."""
        return self.from_.partition(".")[0]

    @property
    def channel(self) -> str:
        """The device's name for the reading."""
        return self.from_.partition(".")[2]


Direction = Literal["level", "up", "down"]


class InputAxis(StrictModel):
    """How the input axis lies in the fixture at two angles of the head."""

    at_0: Direction
    at_90: Direction

    @model_validator(mode="after")
    def _turns_in_the_vertical_plane(self) -> InputAxis:
        if (self.at_0 == "level") == (self.at_90 == "level"):
            raise telling("of at_0 and at_90 one is level and the other up or down: the axis turns in a vertical plane")
        return self

    @property
    def sense(self) -> int:
        """+1 where the axis rises as the head angle does, at the angle where it is level."""
        rises = self.at_90 == "up" if self.at_0 == "level" else self.at_0 == "down"
        return 1 if rises else -1

    @property
    def offset_deg(self) -> float:
        """The angle of the axis above the horizontal at head angle 0."""
        return {"level": 0.0, "up": 90.0, "down": -90.0}[self.at_0]


class Level(StrictModel):
    """How far from level the fixture is when the head says it is level."""

    value: Annotated[float, InUnit("arcsec")]
    U: Arcseconds
    k: CoverageFactor = 2.0
    date: Date


class FixtureEntry(StrictModel):
    """What holds the units on the head."""

    serial: Text
    input_axis: InputAxis
    level: Level


class CurrentWindow(Range):
    """What a unit may draw while its supply is on."""

    min: Amperes
    max: Amperes


class PlaceEntry(StrictModel):
    """A place for a unit under test: how it lies, what counts it, what warms and feeds it."""

    channel: str
    type: Text = "accelerometer channel"
    mount_angle: Degrees = 0.0
    temperature: Name
    supply: Name
    supply_current: CurrentWindow | None = None


class Monitor(StrictModel):
    """How often devices are asked, the whole run long: those behind named readings, and all others."""

    period: PositiveSeconds = 1.0
    devices: PositiveSeconds = 10.0


class ChamberSimulation(StrictModel):
    """How the simulated chamber behaves."""

    start: Celsius = 20.0
    natural_period: PositiveSeconds = 360.0
    damping: Annotated[Ratio, InUnit("", above=0, at_most=5)] = 0.5
    limit_cycle: Annotated[float, InUnit("°C", at_least=0)] = 0.2
    limit_cycle_period: PositiveSeconds = 90.0


class HeadSimulation(StrictModel):
    """How the simulated head behaves."""

    backlash: Arcseconds = 1.0
    acceleration: Annotated[float, InUnit("°/s²", above=0)] = 40.0


class ThermometerSimulation(StrictModel):
    """How the simulated thermometers at the units behave."""

    noise: Annotated[float, InUnit("°C", at_least=0)] = 0.005
    lag: PositiveSeconds = 20.0


class FaultSimulation(StrictModel):
    """An instrument that breaks on purpose."""

    device: Name
    kind: Literal["silent", "cut", "frozen", "stuck", "restart"]
    at: Seconds


class Simulation(StrictModel):
    """What no certificate states; the errors that certificates bound are drawn from them with sd = U / k."""

    seed: Annotated[WholeNumber, Field(ge=0, lt=2**63)] = 1
    start: Instant = dt.datetime.fromisoformat("2026-01-01T00:00:00+00:00")
    units: Mapping[Name, Annotated[Path, FileBeside()]] = {}
    ambient: Celsius = 22.0
    chamber: ChamberSimulation = ChamberSimulation()
    head: HeadSimulation = HeadSimulation()
    thermometer: ThermometerSimulation = ThermometerSimulation()
    host_clock: Annotated[Ratio, InUnit("", at_least=0)] = 20e-6
    faults: tuple[FaultSimulation, ...] = ()


class BenchFile(StrictModel):
    """One `config/*.yaml`: a bench."""

    schema_: Literal["itb-bench/1"] = Field(alias="schema")
    title: Text
    site: Site
    devices: Annotated[Mapping[Name, DeviceEntry], NOT_EMPTY]
    readings: Mapping[Name, ReadingEntry] = {}
    fixture: FixtureEntry
    places: Annotated[Mapping[Name, PlaceEntry], NOT_EMPTY]
    monitor: Monitor = Monitor()
    simulation: Simulation = Simulation()

    def all_simulated(self) -> BenchFile:
        """The same bench with the simulator at the other end of every wire."""
        devices = {
            name: entry.model_copy(update={"connection": entry.connection.as_simulated()})
            for name, entry in self.devices.items()
        }
        return self.model_copy(update={"devices": devices})

    @property
    def is_simulated(self) -> bool:
        """Whether no instrument is real."""
        return all(entry.connection.simulated for entry in self.devices.values())

    @property
    def needs_simulators(self) -> bool:
        """Whether any instrument is simulated."""
        return any(entry.connection.simulated for entry in self.devices.values())
