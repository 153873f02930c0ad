"""Models of a bench file: site, instruments with limits, fixture, and places for units."""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Collection, Iterator, Mapping
from typing import Annotated, Literal
from zoneinfo import ZoneInfo

from pydantic import AfterValidator, Field

from bench.config.dcc import CertificateFile
from bench.config.devices import CoverageFactor, DeviceEntry, Text
from bench.config.fixture import DIRECTIONS, FixtureEntry, Vector
from bench.config.interlocks import InterlockEntry
from bench.config.places import PlaceEntry, total_current
from bench.config.power import PowerEntry
from bench.config.simulation import Simulation
from bench.config.thermometer import ThermometerCalibration
from drivers.can.sent_frames import Counted, Sampled
from drivers.schema.fields import (
    NOT_EMPTY,
    Celsius,
    CelsiusPerMinute,
    InUnit,
    Name,
    PositiveSeconds,
    Range,
    Ratio,
    StrictModel,
    TextLike,
    WholeNumber,
)
from drivers.schema.wording import expected


def _zone(name: str) -> str:
    try:
        ZoneInfo(name)
    except (KeyError, ValueError, OSError):
        raise expected("a time zone like Europe/Berlin or UTC", name) from None
    return name


TimeZone = Annotated[str, AfterValidator(_zone)]


class Gravity(StrictModel):
    """Local gravity in m/s², its expanded uncertainty and its source."""

    value: Annotated[float, InUnit("m/s²", at_least=9.7, at_most=9.9)] = Field(description="at the height of the units")
    U: Annotated[float, InUnit("m/s²", at_least=0)] = Field(description="expanded uncertainty")
    k: CoverageFactor = Field(2.0, description="coverage factor of U")
    origin: Literal["measured", "model"] = Field(description="how the value was found")


class HostClock(StrictModel):
    """Uncertainty of the computer's clock, for example with NTP or PTP; time base of data without a device clock."""

    U: Annotated[Ratio, InUnit("", at_least=0)] = Field(description="expanded uncertainty, such as 4 ppm")
    k: CoverageFactor = Field(2.0, description="coverage factor of U")


class Site(StrictModel):
    """Location of the bench."""

    latitude: Annotated[float, InUnit("°", at_least=-90, at_most=90)] = Field(description="north of the equator")
    height: Annotated[float, InUnit("m", at_least=-500, at_most=9000)] = Field(description="above sea level")
    gravity: Gravity
    time_zone: TimeZone = Field("UTC", description="of the times in reports, such as Europe/Berlin")
    ambient: tuple[Name, ...] = Field((), description="the readings of the room's conditions, for reports")
    host_clock: HostClock | None = None


class TemperatureWindow(Range):
    """Permitted range of a reading, from `min` to `max`; outside is an error of the bench."""

    min: Celsius
    max: Celsius


class ReadingEntry(StrictModel):
    """Named reading: `DEVICE.CHANNEL`."""

    from_: Annotated[str, TextLike(r"[a-z][a-z0-9_]*\.[\w.]+", "DEVICE.CHANNEL")] = Field(
        alias="from", description="the device above, and what its driver calls the reading"
    )
    limits: TemperatureWindow | None = None
    stale_after: PositiveSeconds = Field(10.0, description="an older value is invalid")
    steepest: CelsiusPerMinute | None = Field(
        None, description="a temperature that changes faster, by more than 5 °C, is rejected; default 60 °C/min"
    )
    changes_within: PositiveSeconds | None = Field(
        None,
        description="a constant value for longer is a fault, however often it is read; default 1 h for a "
        "temperature with a resolution of 0.02 °C or finer",
    )
    calibration: ThermometerCalibration | None = None

    @property
    def device(self) -> str:
        """Role of the device."""
        return self.from_.partition(".")[0]

    @property
    def channel(self) -> str:
        """Name of the reading in the driver."""
        return self.from_.partition(".")[2]


class Monitor(StrictModel):
    """Polling intervals during a run: of devices with named readings, and of all others."""

    period: PositiveSeconds = Field(
        1.0, description="of the devices with named readings; devices that send frames are read as these arrive"
    )
    devices: PositiveSeconds = Field(10.0, description="of all other devices")


class AlertEntry(StrictModel):
    """Program that alerts a person at the end of a run."""

    exec: Annotated[tuple[Text, ...], NOT_EMPTY] = Field(
        description="a program and its first arguments; it is given a title as its last argument, and a text on its "
        "standard input"
    )


class ResumeEntry(StrictModel):
    """Limits within which an interrupted run continues without a person after a start of the computer."""

    attempts: Annotated[WholeNumber, Field(ge=1, le=10)] = Field(2, description="how often one run at most")
    within: PositiveSeconds = Field(7200.0, description="the longest time since it was interrupted")


class BenchFile(StrictModel):
    """Bench file, `config/*.yaml`."""

    schema_: Literal["itb-bench/1"] = Field(alias="schema", description="version of the file format")
    title: Text = Field(description="the name of the bench in reports")
    site: Site
    devices: Annotated[Mapping[Name, DeviceEntry], NOT_EMPTY]
    readings: Mapping[Name, ReadingEntry] = {}
    together: Mapping[Name, Annotated[tuple[Name, ...], NOT_EMPTY]] = Field(
        {},
        description="one name for several supplies, current sources or readings, such as one for each unit: a sequence "
        "that sets it sets each, and one that waits for it waits for all; in a run it is those of the units there",
    )
    interlocks: Mapping[Name, InterlockEntry] = {}
    fixture: FixtureEntry
    places: Annotated[Mapping[Name, PlaceEntry], NOT_EMPTY]
    monitor: Monitor = Monitor()
    alert: AlertEntry | None = None
    power: PowerEntry | None = None
    resume: ResumeEntry | None = None
    simulation: Simulation = Simulation()

    def members(self, name: str) -> tuple[str, ...]:
        """Return the devices or readings of a group name; for any other name itself alone."""
        return self.together.get(name, (name,))

    def current_range(self, supply: str) -> tuple[float, float]:
        """Return the least and greatest permitted total current of the units on a supply in A; ±∞ without windows."""
        windows = [place.supply_current for place in self.places.values() if place.supply == supply]
        return total_current(windows) if any(windows) else (-math.inf, math.inf)

    def with_units_in(self, places: Collection[str]) -> BenchFile:
        """Return the bench for a run with units in these places only.

        Group names no longer include devices and readings that belong only to other places.
        """
        kept = {name: entry for name, entry in self.places.items() if name in places}
        ours = {each for entry in kept.values() for each in entry.dependencies}
        gone = {each for entry in self.places.values() for each in entry.dependencies} - ours
        left = {name: tuple(each for each in members if each not in gone) for name, members in self.together.items()}
        return self.model_copy(
            update={"places": kept, "together": {name: members for name, members in left.items() if members}}
        )

    def all_simulated(self) -> BenchFile:
        """Return the bench with a simulator behind every address."""
        devices = {
            name: entry.model_copy(update={"connection": entry.connection.as_simulated()})
            for name, entry in self.devices.items()
        }
        return self.model_copy(update={"devices": devices})

    def with_capability(self, *capabilities: str) -> list[str]:
        """Return the roles of devices with one of these capabilities, in the order of the file."""
        return [
            role for role, entry in self.devices.items() if entry.description.capabilities & frozenset(capabilities)
        ]

    @property
    def axes(self) -> Mapping[str, Vector]:
        """Directions of the table axes at axis angles 0°, by driving device, outermost first.

        In the level frame: east, north, up.
        """
        fixture = self.fixture
        if fixture.input_axis is None:
            return {axis.device: DIRECTIONS[axis.points] for axis in fixture.axes}
        return dict.fromkeys(self.with_capability("positioner")[:1], DIRECTIONS[fixture.input_axis.points])

    def output_unit(self, place: str) -> str:
        """Return the unit of the output of the unit in a place; for an inertial unit that of its accelerometers."""
        entry = self.places[place]
        sample = self.sample_of(entry)
        if sample is not None:
            return sample.unit
        return Counted.unit if entry.voltmeter is None else "V"

    def gyro_output_unit(self, place: str) -> str:
        """Return the unit of the gyro outputs of an inertial unit; for any other unit that of its output."""
        sent = self.sent_units(self.places[place])
        return self.output_unit(place) if self.places[place].channels is None else sent.get("gyro_x", Counted.unit)

    def circuit_unit(self, place: str) -> str | None:
        """Return the unit of the temperature circuit of the unit in a place; None without one."""
        circuit = self.places[place].circuit
        reading = None if circuit is None else self.readings.get(circuit.output)
        device = None if reading is None else self.devices.get(reading.device)
        return None if reading is None or device is None else device.channels.get(reading.channel)

    def sample_of(self, entry: PlaceEntry) -> Sampled | None:
        """Return the telemetry channel on which a unit sends its output, or None.

        For an inertial unit that of its first accelerometer.
        """
        return self._sample_on(entry.telemetry if entry.channels is None else entry.channels.acc_x)

    def sent_units(self, entry: PlaceEntry) -> Mapping[str, str]:
        """Return the units of the telemetry channels of an inertial unit, by acc_x to gyro_z."""
        if entry.channels is None:
            return {}
        units = {
            channel: output.unit
            for device in reversed([*self.devices.values()])  # of two devices with a channel, the first counts
            for channel, output in device.outputs.items()
            if isinstance(output, Sampled)
        }
        return {name: units[channel] for name, channel in entry.channels if channel in units}

    def sampled_together(self, entry: PlaceEntry, latched_with: Collection[str]) -> bool:
        """True if one device samples all channels of an inertial unit at once, one of them in `latched_with`."""
        wanted = set(entry.measured_by.values())
        for each in self.devices.values():
            found = [each.outputs[channel] for channel in wanted if channel in each.outputs]
            if len(found) == len(wanted) and all(isinstance(output, Sampled) for output in found):
                return len({(o.period_s, o.tick_period_s) for o in found}) == 1 and bool(wanted & set(latched_with))
        return False

    def _sample_on(self, channel: str | None) -> Sampled | None:
        found = (each.outputs.get(channel) for each in self.devices.values() if channel is not None)
        return next((output for output in found if isinstance(output, Sampled)), None)

    @property
    def output_units(self) -> Mapping[str, str]:
        """Return the units of the outputs that devices send, by DEVICE.CHANNEL."""
        return {
            f"{role}.{name}": output.unit
            for role, entry in self.devices.items()
            for name, output in entry.outputs.items()
        }

    def nominal_per_g(self, place: str) -> float | None:
        """Return the nominal change of a unit's output for 1 g, in its unit; None if not stated."""
        entry = self.places[place]
        nominal = entry.nominal
        if nominal is None:
            return None
        if self.sample_of(entry) is not None:
            return None if nominal.output is None else nominal.output.to(f"{self.output_unit(place)}/g")
        converter = nominal.S if entry.voltmeter is None else nominal.resistor
        return None if converter is None or nominal.K1 is None else nominal.K1 * converter

    def acquired_from(self, role: str) -> tuple[str, ...]:
        """Return the devices recorded by an acquisition of `role`: it alone, or all that measure outputs of units.

        Also those that latch the encoder of a table, and those that measure the current that feeds a unit.
        """
        if role in self.devices:
            return (role,)
        measuring = {each for place in self.places.values() for each in self.measuring(place)}
        measuring |= {place.ammeter for place in self.places.values() if place.ammeter is not None}
        return tuple(name for name, entry in self.devices.items() if name in measuring or entry.encoders)

    def measuring(self, entry: PlaceEntry) -> tuple[str, ...]:
        """Return the devices that measure the output of the unit in a place."""
        if entry.voltmeter is not None:
            return (entry.voltmeter,)
        kinds = Counted | Sampled if entry.channels is not None else Counted if entry.telemetry is None else Sampled
        wanted = set(entry.measured_by.values())
        return tuple(
            name
            for name, device in self.devices.items()
            if any(channel in wanted and isinstance(output, kinds) for channel, output in device.outputs.items())
        )

    def measured_by(self, place: str) -> str:
        """Return the device that measures the output of the unit in a place."""
        return self.measuring(self.places[place])[0]

    def in_series(self, ammeter: str) -> str | None:
        """Return the current source whose cable an ammeter is in, or None."""
        return next((entry.source for entry in self.places.values() if entry.ammeter == ammeter), None)

    def burden_ohm(self, source: str) -> float:
        """Return the total burden of the ammeters in the cable of a current source, in Ω."""
        meters = {entry.ammeter for entry in self.places.values() if entry.source == source and entry.ammeter}
        return math.fsum(getattr(self.devices[meter].options, "burden_ohm", 0.0) for meter in sorted(meters))

    def past_due(self, day: dt.date) -> dict[str, dt.date]:
        """Return the devices and readings whose calibration has expired on a day, with the due dates."""
        certified: dict[str, DeviceEntry | ReadingEntry] = {**self.devices, **self.readings}
        return {
            name: entry.calibration.due
            for name, entry in certified.items()
            if entry.calibration is not None and entry.calibration.due < day
        }

    @property
    def certificates(self) -> Iterator[CertificateFile]:
        """Yield the certificates that are files, of devices and readings."""
        for device in self.devices.values():
            if device.calibration is not None and device.calibration.dcc is not None:
                yield device.calibration.dcc
        for reading in self.readings.values():
            if reading.calibration is not None and reading.calibration.dcc is not None:
                yield reading.calibration.dcc

    @property
    def is_simulated(self) -> bool:
        """True if every instrument is simulated or recorded, so that time may be virtual."""
        wires = [entry.connection for entry in self.devices.values()]
        return all(wire.simulated or wire.is_recording for wire in wires)

    @property
    def needs_simulators(self) -> bool:
        """True if any instrument is simulated."""
        return any(entry.connection.simulated for entry in self.devices.values())
