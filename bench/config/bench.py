"""Loading of a bench file and checks between its parts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from bench.config.channels import period_s
from bench.config.checks_certificates import range_misfits
from bench.config.checks_circuits import circuit_misfits
from bench.config.checks_counters import counter_misfits
from bench.config.checks_interlocks import interlock_misfits
from bench.config.document import Document, Place, Problem, read_document
from bench.config.load import load
from bench.config.models import BenchFile, ReadingEntry
from bench.config.places import PlaceEntry
from bench.config.simulation import FaultSimulation
from bench.errors import InputError
from drivers.can.sent_frames import Counted, Sampled
from drivers.quantity.units import parse_unit
from drivers.schema.suggest import did_you_mean

LOOKS_WITHIN_A_WATCHDOG = 3
SQUARE_WITHIN_DEG = 1.0  # of the mount angles of two accelerometers at right angles


class LoadedBench(NamedTuple):
    """Bench and the document it was read from."""

    document: Document
    bench: BenchFile


def load_bench(path: Path, *, named: set[str] | None = None) -> LoadedBench:
    """Load a bench file. Raises InputError with the place of every problem.

    `named` collects the names of the files that the bench file refers to, as written there, relative to its folder.
    """
    document = read_document(path)
    bench = load(document, BenchFile, named=named)
    if found := document.located(misfits(bench)):
        raise InputError(*found)
    return LoadedBench(document, bench)


def load_kept_bench(path: Path) -> BenchFile:
    """Load the bench file kept by a run; it was valid when the run began, and files it refers to may be missing."""
    return load(read_document(path), BenchFile, files_needed=False)


def misfits(bench: BenchFile) -> Iterator[Problem]:
    """Yield references to names that another part of the file does not define, with their places."""
    for name, reading in bench.readings.items():
        yield from _reading(bench, name, reading)
    for name in bench.together:
        yield from _groups(bench, name)
    yield from _ambient(bench)
    yield from interlock_misfits(bench.interlocks, bench)
    for name, place in bench.places.items():
        yield from _place(bench, name, place)
    yield from counter_misfits(bench)
    yield from range_misfits(bench)
    yield from _watchdogs(bench)
    yield from _axes(bench)
    yield from _tilt_pairs(bench)
    yield from _simulation(bench)


def _watchdogs(bench: BenchFile) -> Iterator[Problem]:
    """Yield watchdogs that would expire between two polls, or after one repeated query."""
    for role, entry in bench.devices.items():
        alone_after_s, every_s = entry.safe_state.alone_after_s, period_s(role, bench)
        if alone_after_s is not None and alone_after_s < LOOKS_WITHIN_A_WATCHDOG * every_s:
            least_s = LOOKS_WITHIN_A_WATCHDOG * every_s
            problem = f"is less than {LOOKS_WITHIN_A_WATCHDOG} polling periods of {every_s:g} s"
            yield ("devices", role, "options", "watchdog"), f"watchdog: {problem}; give {least_s:g} s or more"


def _axes(bench: BenchFile) -> Iterator[Problem]:
    turning = bench.with_capability("positioner", "rate_table")
    for index, axis in enumerate(bench.fixture.axes):
        if axis.device not in turning:
            where: Place = ("fixture", "axes", index, "device")
            yield where, f"'{axis.device}' is neither a head nor a rate table{did_you_mean(axis.device, turning)}"


def _tilt_pairs(bench: BenchFile) -> Iterator[Problem]:
    """Yield pairs of places that cannot measure a tilt together."""
    for index, pair in enumerate(bench.fixture.tilt_pairs):
        where: Place = ("fixture", "tilt_pairs", index)
        missing = [key for key in ("along", "across") if getattr(pair, key) not in bench.places]
        for key in missing:
            name = getattr(pair, key)
            yield (*where, key), f"there is no place '{name}'{did_you_mean(name, bench.places)}"
        if missing:
            continue
        along, across = bench.places[pair.along], bench.places[pair.across]
        for key, place in (("along", along), ("across", across)):
            if place.kind != "channel":
                name = getattr(pair, key)
                yield (*where, key), f"place '{name}' is for an inertial unit; a pair has two units with one channel"
        if pair.along in [other.along for other in bench.fixture.tilt_pairs[:index]]:
            yield (*where, "along"), f"place '{pair.along}' is that of another pair already"
        apart_deg = (across.mount_angle - along.mount_angle) % 360
        if abs(apart_deg - 90) > SQUARE_WITHIN_DEG:
            yield (
                (*where, "across"),
                f"place '{pair.across}' is at {apart_deg:g}° from '{pair.along}' in the fixture, expected 90°, so that "
                "its input axis is up when the other is level; see their mount_angle, and whether they are exchanged",
            )


def _simulation(bench: BenchFile) -> Iterator[Problem]:
    for name in bench.simulation.units:
        if name not in bench.places:
            problem = f"there is no place '{name}'{did_you_mean(name, bench.places)}"
            yield ("simulation", "units", name), problem
    yield from _voltmeters(bench)
    sources, ammeters = bench.with_capability("current_source"), bench.with_capability("ammeter")
    for name in bench.simulation.sources:
        if name not in sources:
            yield ("simulation", "sources", name), f"'{name}' is not a current source{did_you_mean(name, sources)}"
    for name in bench.simulation.ammeters:
        if name not in ammeters:
            yield ("simulation", "ammeters", name), f"'{name}' is not an ammeter{did_you_mean(name, ammeters)}"
    yield from fault_misfits(bench.simulation.faults, bench, ("simulation", "faults"))


def fault_misfits(faults: Sequence[FaultSimulation], bench: BenchFile, where: Place) -> Iterator[Problem]:
    """Yield faults of devices and units that the bench does not have; `where` is their place in the document."""
    for index, fault in enumerate(faults):
        if fault.unit is not None and fault.unit not in bench.places:
            problem = f"there is no place '{fault.unit}'{did_you_mean(fault.unit, bench.places)}"
            yield (*where, index, "unit"), problem
        elif fault.device is not None and fault.device not in bench.devices:
            problem = f"there is no device '{fault.device}'{did_you_mean(fault.device, bench.devices)}"
            yield (*where, index, "device"), problem


def _groups(bench: BenchFile, name: str) -> Iterator[Problem]:
    """Yield group names that are in use already, and groups of unlike members."""
    where, members = ("together", name), bench.together[name]
    if name in bench.devices or name in bench.readings:
        yield where, f"'{name}' is a device or a reading already; a group needs a name of its own"
    kinds = {member: _kind_of(bench, member) for member in members}
    for index, (member, kind) in enumerate(kinds.items()):
        if kind is None:
            known = [*bench.readings, *(key for key in bench.devices if _kind_of(bench, key))]
            problem = f"there is no supply, current source or reading '{member}'{did_you_mean(member, known)}"
            yield (*where, index), problem
    if len(kinds) < len(members):
        yield where, "names a member twice"
    if len(found := {kind for kind in kinds.values() if kind is not None}) > 1:
        yield where, f"members of different kinds: {' and '.join(sorted(found))}"


def _kind_of(bench: BenchFile, member: str) -> str | None:
    """Return the kind of members of a group: supplies, current sources, or readings in one unit."""
    if member in bench.readings:
        reading = bench.readings[member]
        device = bench.devices.get(reading.device)
        unit = None if device is None else device.description.channels_of(device.options).get(reading.channel)
        return f"readings in {unit}"
    capabilities = bench.devices[member].description.capabilities if member in bench.devices else frozenset()
    return {"power_supply": "power supplies", "current_source": "current sources"}.get(
        next(iter(capabilities & {"power_supply", "current_source"}), "")
    )


def _voltmeters(bench: BenchFile) -> Iterator[Problem]:
    meters = [key for key, entry in bench.devices.items() if "voltmeter" in entry.description.capabilities]
    for name, connected in bench.simulation.voltmeters.items():
        where: Place = ("simulation", "voltmeters", name)
        if name not in meters:
            yield where, f"'{name}' is not a voltmeter{did_you_mean(name, meters)}"
        if connected.place is not None and connected.place not in bench.places:
            problem = f"there is no place '{connected.place}'{did_you_mean(connected.place, bench.places)}"
            yield (*where, "place"), problem
        for place, unit in bench.places.items():
            if unit.voltmeter == name and place != connected.place:
                found = "is missing" if connected.place is None else f"is '{connected.place}'"
                yield (*where, "place"), f"{found}, places.{place} says that it measures '{place}'"


def _reading(bench: BenchFile, name: str, reading: ReadingEntry) -> Iterator[Problem]:
    place: Place = ("readings", name, "from")
    device = bench.devices.get(reading.device)
    if device is None:
        yield place, f"there is no device '{reading.device}'{did_you_mean(reading.device, bench.devices)}"
        return
    channels = device.channels
    if reading.channel not in channels:
        yield place, f"{reading.device} has no channel '{reading.channel}'{did_you_mean(reading.channel, channels)}"
    elif (unit := channels[reading.channel]) != "°C":
        for key, given in (
            ("limits", reading.limits),
            ("calibration", reading.calibration),
            ("steepest", reading.steepest),
        ):
            if given is not None:
                yield ("readings", name, key), f"is for a temperature, {reading.from_} is in {unit}"
    if name in bench.devices:
        yield ("readings", name), f"'{name}' is a device already; a reading needs a name of its own"


def _ambient(bench: BenchFile) -> Iterator[Problem]:
    for index, name in enumerate(bench.site.ambient):
        if name not in bench.readings:
            where: Place = ("site", "ambient", index)
            yield where, f"there is no reading '{name}'{did_you_mean(name, bench.readings)}"


def _is_temperature(bench: BenchFile, reading: ReadingEntry) -> bool:
    """Return True if a reading is in °C; unknown devices are reported elsewhere."""
    device = bench.devices.get(reading.device)
    return device is None or device.channels.get(reading.channel, "°C") == "°C"


def _place(bench: BenchFile, name: str, place: PlaceEntry) -> Iterator[Problem]:
    where: Place = ("places", name)
    yield from _output(bench, name, place)
    for key, reading in place.read.items():
        if reading not in bench.readings:
            problem = f"there is no reading '{reading}'{did_you_mean(reading, bench.readings)}"
            yield (*where, *key.split(".")), problem
        elif not _is_temperature(bench, bench.readings[reading]):
            yield (*where, *key.split(".")), f"'{reading}' is not a temperature"
    yield from circuit_misfits(bench, name, place)
    supply = bench.devices.get(place.supply)
    if supply is None or "power_supply" not in supply.description.capabilities:
        supplies = [key for key, entry in bench.devices.items() if "power_supply" in entry.description.capabilities]
        yield (*where, "supply"), f"'{place.supply}' is not a power supply{did_you_mean(place.supply, supplies)}"
    source = bench.devices.get(place.source) if place.source is not None else None
    if place.source is not None and (source is None or "current_source" not in source.description.capabilities):
        sources = [key for key, entry in bench.devices.items() if "current_source" in entry.description.capabilities]
        yield (*where, "source"), f"'{place.source}' is not a current source{did_you_mean(place.source, sources)}"
    yield from _ammeter(bench, name, place)


def _ammeter(bench: BenchFile, name: str, place: PlaceEntry) -> Iterator[Problem]:
    """Yield ammeters that do not exist, or that are in the cable of another source."""
    where, meters = ("places", name, "ammeter"), bench.with_capability("ammeter")
    if place.ammeter is None:
        return
    if place.ammeter not in meters:
        yield where, f"'{place.ammeter}' is not an ammeter{did_you_mean(place.ammeter, meters)}"
    elif (first := bench.in_series(place.ammeter)) != place.source:
        yield where, f"'{place.ammeter}' is in the cable of '{first}' already"


def _output(bench: BenchFile, name: str, place: PlaceEntry) -> Iterator[Problem]:
    """Yield outputs of a unit that do not exist, or that measure another place already."""
    devices = bench.devices.items()
    counted, sent = (
        [channel for _, entry in devices for channel, output in entry.outputs.items() if isinstance(output, kind)]
        for kind in (Counted, Sampled)
    )
    meters = [role for role, entry in devices if "voltmeter" in entry.description.capabilities]
    for key, found in place.measured_by.items():
        where: Place = ("places", name, *key.split("."))
        if key == "voltmeter":
            if found not in meters:
                yield where, f"'{found}' is not a voltmeter{did_you_mean(found, meters)}"
        elif key == "telemetry":
            if found not in sent:
                yield where, f"no telemetry has a channel '{found}'{did_you_mean(found, sent)}"
        elif key == "channel":
            if found not in counted:
                yield where, f"no counter has a channel '{found}'{did_you_mean(found, counted)}"
        else:
            yield from ((where, problem) for problem in _inertial(found, counted, sent, meters))
        first = next(
            (other, by)
            for other, entry in bench.places.items()
            for by, measured in entry.measured_by.items()
            if measured == found and _verb(by, found, sent) == _verb(key, found, sent)
        )
        if first != (name, key):
            yield where, f"'{found}' {_verb(key, found, sent)} place '{first[0]}' already"
    yield from _mixed_units(bench, name, place)
    yield from _nominal_output(bench, name, place)


def _inertial(found: str, counted: Sequence[str], sent: Sequence[str], meters: Sequence[str]) -> Iterator[str]:
    """Yield the problems of a channel of an inertial unit."""
    if found in meters:
        yield f"'{found}' is a voltmeter, which reads one channel; those of an inertial unit are wanted all at once"
    elif found in counted and found in sent:
        yield f"'{found}' is a channel of a counter and of telemetry; give one of them another name"
    elif found not in (*counted, *sent):
        yield f"no counter and no telemetry has a channel '{found}'{did_you_mean(found, (*counted, *sent))}"


def _mixed_units(bench: BenchFile, name: str, place: PlaceEntry) -> Iterator[Problem]:
    """Yield triads of an inertial unit, accelerometers or gyros, with outputs in different units."""
    sent = bench.sent_units(place)
    for sensor, sensors in (("acc", "accelerometers"), ("gyro", "gyros")) if place.channels is not None else ():
        units = dict.fromkeys(sent.get(f"{sensor}_{axis}", Counted.unit) for axis in "xyz")
        if len(units) > 1:
            yield (
                ("places", name, "channels"),
                f"the outputs of the {sensors} are in {' and '.join(units)}; one is needed",
            )


def _verb(key: str, found: str, sent: Sequence[str]) -> str:
    """Return the verb for the device named by a key of a place."""
    if key.startswith("channels"):
        key = "telemetry" if found in sent else "channel"
    return {"voltmeter": "measures", "telemetry": "carries"}.get(key, "counts")


def _nominal_output(bench: BenchFile, name: str, place: PlaceEntry) -> Iterator[Problem]:
    """Yield nominal outputs per 1 g of units that send none, or in a wrong unit."""
    output = place.nominal.output if place.nominal is not None else None
    if output is None:
        return
    where: Place = ("places", name, "nominal", "output")
    unit = f"{bench.output_unit(name)}/g"
    if bench.sample_of(place) is None:
        yield where, "is for a unit that sends its output, on a channel of telemetry"
    elif output.dimension != parse_unit(unit).dimension:
        yield where, f"is {output}, expected a quantity in {unit}"
    elif output.base_value == 0:
        yield where, f"is {output}, expected a quantity other than 0"
