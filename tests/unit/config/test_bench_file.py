"""Bench files: what the shipped one says, and what a technician reads of one slip in it or of many."""

from __future__ import annotations

import copy
import datetime as dt
import shutil
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.config.bench import LoadedBench, load_bench, load_kept_bench, misfits
from bench.config.document import Document, parse_document
from bench.config.fixture import InputAxis
from bench.config.load import find, load, load_file
from bench.config.models import BenchFile, ReadingEntry
from bench.errors import InputError
from drivers.description import known_drivers
from drivers.transport.address import Address

ROOT = Path(__file__).parents[3]
CONFIG = ROOT / "config"
SHIPPED = (CONFIG / "simulated.yaml").read_text(encoding="utf-8")
A_NAME = "a name: at most 32 lower-case letters, digits and _, a letter first"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with everything that the shipped bench file names."""
    return Path(shutil.copytree(CONFIG, tmp_path_factory.mktemp("bench") / "config"))


@pytest.fixture(scope="module")
def shipped() -> BenchFile:
    return load_bench(CONFIG / "simulated.yaml").bench


def changed(*changes: tuple[str, str]) -> str:
    text = SHIPPED
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def loaded(folder: Path, text: str) -> LoadedBench:
    (folder / "b.yaml").write_text(text, encoding="utf-8")
    return load_bench(folder / "b.yaml")


def problems(folder: Path, text: str) -> list[str]:
    with pytest.raises(InputError) as caught:
        loaded(folder, text)
    return [problem.removeprefix(f"{folder}/") for problem in caught.value.problems]


def place_of(text: str, part: str) -> str:
    """`b.yaml:line:column` of the one place where `part` stands."""
    assert text.count(part) == 1, part
    before = text[: text.index(part)]
    return f"b.yaml:{before.count(chr(10)) + 1}:{len(before) - before.rfind(chr(10))}"


def check(folder: Path, old: str, new: str, at: str, problem: str) -> None:
    text = changed((old, new))
    assert problems(folder, text) == [f"{place_of(text, at)}: {problem}"]


# What is in it


def test_the_shipped_bench_is_what_it_says(shipped):
    assert (shipped.site.latitude, shipped.site.height, shipped.site.gravity.value) == (34.25, 420.0, 9.79541)
    assert list(shipped.devices) == ["chamber", "head", "counter", "supply", "source"]
    chamber = shipped.devices["chamber"]
    assert chamber.connection == Address("tcp", host="127.0.0.1", port=1502, simulated=True)
    assert (chamber.options.unit_id, chamber.options.poll) == (1, 1.0)
    assert (chamber.limits.temperature.min, chamber.limits.ramp_rate.max, chamber.safe.temperature) == (-50, 3, 25)
    head = shipped.devices["head"]
    assert head.calibration.U.harmonics == (2, 2, 2, 2)
    assert head.calibration.due == dt.date(2030, 12, 31)
    assert shipped.devices["counter"].options.dbc == CONFIG / "if_counter.dbc"
    assert shipped.devices["counter"].calibration.U.time_base == 1e-6
    assert shipped.devices["source"].options.range == 0.02
    assert shipped.readings["unit_temperature"].calibration.U.gain == 0.002
    assert shipped.places["a"].supply_current.max == 0.11
    assert shipped.monitor.devices == 10.0
    assert shipped.simulation.start == dt.datetime(2026, 1, 1, tzinfo=dt.UTC)
    assert shipped.simulation.units == {"a": CONFIG / "uut" / "quartz_flexure.yaml"}


def test_a_bench_comes_with_the_document_it_was_read_from(folder):
    bench = loaded(folder, SHIPPED)
    assert bench.document.text == SHIPPED
    assert bench.document.path == folder / "b.yaml"


def test_every_shipped_bench_file_fits_together():
    files = sorted(CONFIG.glob("*.yaml"))
    assert [path.stem for path in files if not load_bench(path).bench.is_simulated] == ["simulated_wires"]


def test_a_bench_is_simulated_when_no_instrument_is_real(folder, shipped):
    wires = load_bench(CONFIG / "simulated_wires.yaml").bench
    mixed = loaded(folder, changed(("sim+tcp://127.0.0.1:5025", "tcp://127.0.0.1:5025"))).bench
    found = [(bench.is_simulated, bench.needs_simulators) for bench in (shipped, mixed, wires)]
    assert found == [(True, True), (False, True), (False, False)]
    assert wires.all_simulated().is_simulated
    assert wires.all_simulated().devices == shipped.devices


def test_a_reading_names_a_device_and_its_channel():
    reading = ReadingEntry.model_validate({"from": "counter.Temperatures.Unit"})
    assert (reading.device, reading.channel) == ("counter", "Temperatures.Unit")


@pytest.mark.parametrize(
    ("at_0", "at_90", "sense", "offset_deg"),
    [("level", "up", 1, 0.0), ("level", "down", -1, 0.0), ("up", "level", -1, 90.0), ("down", "level", 1, -90.0)],
)
def test_an_input_axis_rises_or_falls_as_the_head_turns(at_0, at_90, sense, offset_deg):
    axis = InputAxis.model_validate({"at_0": at_0, "at_90": at_90})
    assert (axis.sense, axis.offset_deg) == (sense, offset_deg)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("    safe: {temperature: 25 °C}\n", ""),
        ("safe: {temperature: 25 °C}", "safe: {temperature: 100 °C}"),
        ("safe: {temperature: 25 °C}", "safe: {temperature: -50 °C}"),
        ("rate: 20 °/s", "rate: 30 °/s"),
        ("{serial: SIM-F4T-01}", "{serial: 510}"),
        ("    options: {unit_id: 1, loop: 1, word_order: low_first}\n", ""),
        ("U: {time_base: 1 ppm}", "U: {}"),
        (", k: 2, U: {time_base: 1 ppm}", ""),
        ("monitor:\n  period: 1 s\n", ""),
        ("title: Simulated accelerometer bench", "title: Prüfstand 2 — °C"),
        ("seed: 1", "faults: [{device: head, kind: silent, at: 5 min}]"),
        ("seed: 1", "seed: 9223372036854775807"),
    ],
)
def test_what_may_be_left_out_or_stands_at_a_bound_is_taken(folder, old, new):
    assert loaded(folder, changed((old, new))).bench.site.height == 420.0


# One slip


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("devices:\n  chamber", "devises:\n  chamber", "devises: unknown key; did you mean 'devices'?"),
        ("latitude:", "latitud:", "latitud: unknown key; did you mean 'latitude'?"),
        ("origin:", "orgin:", "orgin: unknown key; did you mean 'origin'?"),
        ("driver: watlow_f4t", "drivr: watlow_f4t", "drivr: unknown key; did you mean 'driver'?"),
        ("unit_id:", "unitid:", "unitid: unknown key; did you mean 'unit_id'?"),
        ("serial: SIM-F4T-01", "seral: SIM-F4T-01", "seral: unknown key; did you mean 'serial'?"),
        ("ramp_rate:", "ramprate:", "ramprate: unknown key; did you mean 'ramp_rate'?"),
        ("max: 3 °C/min", "mix: 3 °C/min", "mix: unknown key; did you mean 'max'?"),
        ("band: 1", "bnd: 1", "bnd: unknown key; did you mean 'band'?"),
        ("zero: 10", "zro: 10", "zro: unknown key; did you mean 'zero'?"),
        ("time_base:", "timebase:", "timebase: unknown key; did you mean 'time_base'?"),
        ("tick_period:", "tickperiod:", "tickperiod: unknown key; did you mean 'tick_period'?"),
        ("stale_after:", "stale:", "stale: unknown key; did you mean 'stale_after'?"),
        ("offset:", "ofset:", "ofset: unknown key; did you mean 'offset'?"),
        ("at_90:", "at90:", "at90: unknown key; did you mean 'at_90'?"),
        ("mount_angle:", "mount_angel:", "mount_angel: unknown key; did you mean 'mount_angle'?"),
        ("seed:", "sed:", "sed: unknown key; did you mean 'seed'?"),
        ("backlash:", "back_lash:", "back_lash: unknown key; did you mean 'backlash'?"),
    ],
)
def test_a_misspelt_key_at_any_level_is_told_the_key_that_is_meant(folder, old, new, problem):
    check(folder, old, new, new, problem)


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("limits:\n      voltage", "options: {zzz: 1}\n    limits:\n      voltage", "expected answers or watchdog"),
        ("limits:\n      voltage", "safe: {zzz: 1}\n    limits:\n      voltage", "none is known here"),
        (
            "driver: watlow_f4t",
            "driver: watlow_f4t\n    zzz: 1",
            "expected driver, connection, options, identity, limits, safe or calibration",
        ),
    ],
)
def test_a_key_like_no_other_is_told_those_that_are_known(folder, old, new, problem):
    check(folder, old, new, "zzz: 1", f"zzz: unknown key; {problem}")


@pytest.mark.parametrize(
    ("old", "new", "at", "key"),
    [
        ("schema: itb-bench/1\n", "", "title: Sim", "schema"),
        ("title: Simulated accelerometer bench\n", "", "schema:", "title"),
        ("  latitude: 34.25°\n", "", "site:", "latitude"),
        ("U: 0.0004 m/s², ", "", "gravity:", "U"),
        ("    driver: watlow_f4t\n", "", "chamber:\n    connection", "driver"),
        ("    connection: sim+tcp://127.0.0.1:1502\n", "", "chamber:\n    driver", "connection"),
        (
            "    limits:\n      voltage: {max: 16 V}\n      current: {max: 200 mA}\n",
            "",
            "supply:\n    driver",
            "limits",
        ),
        ("    options: {range: 20 mA, compliance: 10 V}\n", "", "source:\n    driver", "options"),
        ("{min: -50 °C, max: 100 °C}", "{min: -50 °C}", "temperature: {min: -50 °C}", "max"),
        (", hold: 1 s}", "}", "settle:", "hold"),
        ("certificate: SIM-2026-0101, ", "", "calibration:\n      {laboratory", "certificate"),
        ("      period: 100 ms\n", "", "options:\n      dbc", "period"),
        ("    from: counter.Temperatures.Unit\n", "", "unit_temperature:\n", "from"),
        ("at_0: level, ", "", "input_axis:", "at_0"),
        ("seed: 1", "faults: [{device: head, kind: cut}]", "{device: head", "at"),
    ],
)
def test_a_missing_key_is_named_where_it_belongs(folder, old, new, at, key):
    check(folder, old, new, at, f"the key '{key}' is missing")


*OTHERS, LAST = sorted(known_drivers())
DRIVERS = f"{', '.join(OTHERS)} or {LAST}"


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("driver: watlow_f4t", "driver: watlow_f4tt", "there is no driver 'watlow_f4tt'; did you mean 'watlow_f4t'?"),
        ("driver: watlow_f4t", "driver: xyz", f"there is no driver 'xyz'; expected {DRIVERS}"),
        ("driver: watlow_f4t", "driver: 5", "is 5, expected text; put it in quotes"),
        ("driver: watlow_f4t", "driver: [a]", "is a list, expected text"),
        ("driver: watlow_f4t", "driver: # none", "is empty, expected text"),
        (
            "connection: sim+tcp://127.0.0.1:1502",
            "connection: sim+slcan:///dev/ttyS0",
            "watlow_f4t is reached by serial or socket or tcp, not by slcan",
        ),
        (
            "connection: sim+slcan:///tmp/itb/can?bitrate=500000",
            "connection: tcp://h:5",
            "can_counter is reached by can or log or slcan or socketcand, not by tcp",
        ),
        (
            "connection: sim+tcp://127.0.0.1:1502",
            "connection: 127.0.0.1:1502",
            "'127.0.0.1:1502' is not an address; "
            "expected one like tcp://192.168.1.10:502 or serial:///dev/ttyUSB0?baud=9600",
        ),
        (
            "connection: sim+tcp://127.0.0.1:1502",
            "connection: 1502",
            "is 1502, expected an address like tcp://192.168.1.10:502",
        ),
        ("serial: SIM-F4T-01", "serial: 5.10", "put it in quotes, so that it is kept as it is written"),
        ("unit_id: 1", "unit_id: 248", "is 248, expected at most 247"),
        ("unit_id: 1", "unit_id: 1.0", "is 1.0, expected a whole number"),
        ("unit_id: 1", "poll: 1 min", "is 60 s, expected at most 30 s"),
        ("unit_id: 1", "block_reads: off", "is 'off', expected true or false"),
        ("word_order: low_first", "word_order: low", "is 'low', expected 'low_first' or 'high_first'"),
        ("options: {unit_id: 1, loop: 1, word_order: low_first}", "options: 5", "is 5, expected a mapping"),
        ("options: {unit_id: 1, loop: 1, word_order: low_first}", "options: # none", "is empty, expected a mapping"),
        ("axis: X", "axis: X Y", "is 'X Y', expected the name of an axis such as X"),
        ("band: 1 arcsec", "band: 0 arcsec", "is 0 arcsec, expected more than 0 arcsec"),
        ("band: 1 arcsec", "band: 1 mm", "is in m, expected a quantity in arcsec"),
        ("axis: X", "approach_distance: 31°", "is 31 °, expected at most 30 °"),
        ("harmonics: [2 arcsec, 2 arcsec, 2 arcsec, 2 arcsec]", "harmonics: 2 arcsec",
         "is '2 arcsec', expected a list"),
        ("dbc: if_counter.dbc", "dbc: if_countr.dbc",
         "there is no file 'if_countr.dbc' beside this one; a copied file needs what it names as well"),
        ("dbc: if_counter.dbc", "dbc: ../if_counter.dbc", "'../if_counter.dbc' leaves the folder of this file"),
        ("dbc: if_counter.dbc", "dbc: /etc/hostname", "'/etc/hostname' leaves the folder of this file"),
        ("tick: Latch.Tick", "tick: Latch.Tik",
         "if_counter.dbc has no signal 'Latch.Tik'; did you mean 'Latch.Tick'?"),
        ("tick: Latch.Tick", "tick: Latch", "is 'Latch', expected Message.Signal of the DBC"),
        ("positive: AxisX.Positive", "positive: AxisW.Positive",
         "if_counter.dbc has no signal 'AxisW.Positive'; did you mean 'AxisZ.Positive'?"),
        ("max_rate: 256 kHz", "max_rate: 256", "256 has no unit, write it like '256 Hz'"),
        ("max_rate: 256 kHz", "max_rate: 256 khz", "'khz' is not a known unit; write kHz; expected a quantity in Hz"),
        ("range: 20 mA", "range: 30 mA", "is 0.03 A, expected one of 2 nA to 20 mA in decades, or 100 mA"),
        ("compliance: 10 V", "compliance: 106 V", "is 106 V, expected at most 105 V"),
        ("max: 16 V", "max: 0 V", "is 0 V, expected more than 0 V"),
        ("time_base: 1 ppm", "time_base: -1 ppm", "is -1e-06, expected at least 0"),
        ("U: {time_base: 1 ppm}", "U: 5", "is 5, expected a mapping"),
        ("identity: {model: SIM-PSU, serial: SIM-PSU-01}", "calibration: 5", "is 5, expected a mapping"),
        ("due: 2030-12-31, k: 2, U: {t", "due: 31.12.2030, k: 2, U: {t",
         "is '31.12.2030', expected a date like 2026-01-31"),
        ("certificate: SIM-2026-0102", "certificate: 102", "is 102, expected text; put it in quotes"),
    ],
)  # fmt: skip
def test_a_wrong_value_in_a_device_is_told_under_its_key(folder, old, new, problem):
    check(folder, old, new, new, f"{new.partition(':')[0]}: {problem}")


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("schema: itb-bench/1", "schema: itb-bench/2", "is 'itb-bench/2', expected 'itb-bench/1'"),
        ("title: Simulated accelerometer bench", "title:", "is empty, expected text"),
        ("title: Simulated accelerometer bench", "title: 5", "is 5, expected text; put it in quotes"),
        ("title: Simulated accelerometer bench", f"title: {'x' * 201}",
         f"is '{'x' * 27}...{'x' * 28}', expected at most 200 characters"),
        ("latitude: 34.25°", "latitude: 34.25", "34.25 has no unit, write it like '34.25 °'"),
        ("latitude: 34.25°", "latitude: 90.5°", "is 90.5 °, expected at most 90 °"),
        ("latitude: 34.25°", "latitude: 34°75'", "has 60 or more minutes or seconds of arc; expected a quantity in °"),
        ("height: 420 m", "height: 10 km", "is 10000 m, expected at most 9000 m"),
        ("value: 9.79541 m/s²", "value: 1 g", "is in g, expected a quantity in m/s²"),
        ("value: 9.79541 m/s²", "value: 9.6 m/s²", "is 9.6 m/s², expected at least 9.7 m/s²"),
        ("k: 2, origin", "k: 0, origin", "is 0, expected more than 0"),
        ("k: 2, origin", "k: 5, origin", "is 5, expected at most 4"),
        ("k: 2, origin", "k: two, origin", "is 'two', expected a number"),
        ("origin: model", "origin: guess", "is 'guess', expected 'measured' or 'model'"),
        ("time_zone: Asia/Shanghai", "time_zone: Asia/Shangai",
         "is 'Asia/Shangai', expected a time zone like Europe/Berlin or UTC"),
        ("time_zone: Asia/Shanghai", "time_zone: ../../etc/passwd",
         "is '../../etc/passwd', expected a time zone like Europe/Berlin or UTC"),
        ("time_zone: Asia/Shanghai", "time_zone: ''", "is empty, expected a time zone like Europe/Berlin or UTC"),
        ("from: counter.Temperatures.Unit", "from: counter", "is 'counter', expected DEVICE.CHANNEL"),
        ("stale_after: 5 s", "stale_after: 0 s", "is 0 s, expected more than 0 s"),
        ("offset: 0.6 °C", "offset: -0.6 °C", "is -0.6 °C, expected at least 0 °C"),
        ("offset: 0.6 °C", "offset: 0.6 K",
         "kelvin is refused: write °C, for a difference too; expected a quantity in °C"),
        ("at_90: up", "at_90: north", "is 'north', expected 'level', 'up' or 'down'"),
        ("serial: SIM-CUBE-01", "serial: # none", "is empty, expected text"),
        ("value: 0 arcsec", "value: 0", "0 has no unit, write it like '0 arcsec'"),
        ("channel: x", "channel: 1", "is 1, expected text; put it in quotes"),
        ("channel: x", "channel:", "is empty, expected text"),
        ("period: 1 s", "period: 0 s", "is 0 s, expected more than 0 s"),
        ("seed: 1", "seed: -1", "is -1, expected at least 0"),
        ("seed: 1", "seed: 9223372036854775808", "is 9223372036854775808, expected less than 9.22337203685e+18"),
        ("start: 2026-01-01T00:00:00Z", "start: 2026-01-01",
         "is '2026-01-01', expected a time with its zone like 2026-01-31T08:00:00Z"),
        ("a: uut/quartz_flexure.yaml", "a: uut/quartz.yaml",
         "there is no file 'uut/quartz.yaml' beside this one; a copied file needs what it names as well"),
        ("units: {a: uut/quartz_flexure.yaml}", "units: [a]", "is a list, expected a mapping"),
        ("damping: 0.5", "damping: 6", "is 6, expected at most 5"),
        ("host_clock: 20 ppm", "host_clock: 20 s", "is in s, expected a number without a unit"),
        ("seed: 1", "faults: {device: head}", "is a mapping, expected a list"),
    ],
)  # fmt: skip
def test_a_wrong_value_elsewhere_is_told_under_its_key(folder, old, new, problem):
    check(folder, old, new, new, f"{new.partition(':')[0]}: {problem}")


@pytest.mark.parametrize(
    ("old", "new", "at", "problem"),
    [
        ("temperature: {min: -50 °C, max: 100 °C}", "temperature: {min: 100 °C, max: -50 °C}",
         "temperature: {min: 100 °C", "temperature: min is not below max"),
        ("current: {min: -20 mA, max: 20 mA}", "current: {min: 20 mA, max: 20 mA}", "current: {min: 20",
         "current: min is not below max"),
        ("angle: {min: -5°, max: 365°}", "angle: {min: 365°, max: -5°}", "angle: {min: 365",
         "angle: min is not below max"),
        ("limits: {min: -55 °C, max: 105 °C}", "limits: {min: 105 °C, max: -55 °C}", "limits: {min: 105",
         "limits: min is not below max"),
        ("{min: 30 mA, max: 110 mA}", "{min: 110 mA, max: 30 mA}", "supply_current:",
         "supply_current: min is not below max"),
        ("rate: {max: 30 °/s}", "rate: {max: 10 °/s}", "rate: 20", "rate: is above the max of limits.rate"),
        ("rate: {max: 30 °/s}", "rate: {max: 1001 °/s}", "limits:\n      angle",
         "limits: making it safe (at rest where it is) could take 30.025 s, at most 30 s are allowed; raise "
         "options.acceleration or lower limits.rate"),
        ("identity: {model: SIM-PSU, serial: SIM-PSU-01}\n", "options: {watchdog: 29 s}\n", "watchdog: 29 s",
         "watchdog: is less than 3 polling periods of 10 s; give 30 s or more"),
        ("safe: {temperature: 25 °C}", "safe: {temperature: 101 °C}", "temperature: 101",
         "temperature: is above the max of limits.temperature"),
        ("safe: {temperature: 25 °C}", "safe: {temperature: -51 °C}", "temperature: -51",
         "temperature: is below the min of limits.temperature"),
        ("due: 2030-12-31, k: 2, U: {time", "due: 2026-01-01, k: 2, U: {time",
         "calibration:\n      {certificate: SIM-2026-0102",
         "calibration: is due on 2026-01-01, which is not after its date 2026-01-01"),
        ("at_90: up", "at_90: level", "input_axis:",
         "input_axis: of at_0 and at_90 one is level and the other up or down: the axis turns in a vertical plane"),
        ("  input_axis: {at_0: level, at_90: up}\n", "", "fixture:",
         "fixture: give the orientation of the units: input_axis on a head with a level axis, else body (and axes)"),
        ("input_axis: {at_0: level, at_90: up}", "body: {x: east, z: west}", "body:",
         "body: x and z are parallel; they must be at right angles"),
        ("input_axis: {at_0: level, at_90: up}", "body: {x: east, z: up}\n  axes: [{device: chamber, points: up}]",
         "device: chamber, points", "'chamber' is neither a head nor a rate table; expected head"),
        ("upright: 0°", "upright: {roll: 0°, tilt: 1°}", "tilt: 1°",
         "tilt: unknown key; expected angle, roll or clock"),
        ("[2 arcsec, 2 arcsec, 2 arcsec, 2 arcsec]", "[2 arcsec, 7]", "7]", "7 has no unit, write it like '7 arcsec'"),
        ("chamber:\n    driver", "Chamber:\n    driver", "Chamber:", f"Chamber: is 'Chamber', expected {A_NAME}"),
        ("unit_temperature:", "unit temperature:", "unit temperature:",
         f"unit temperature: is 'unit temperature', expected {A_NAME}"),
        ("devices:\n", "devices:\n  x: 5\n", "x: 5", "x: is 5, expected a mapping"),
        ("seed: 1", "faults: [{device: head, kind: broken, at: 5 s}]", "kind: broken",
         "kind: is 'broken', expected 'silent', 'cut', 'delay', 'late', 'duplicate', 'garbage', 'cut_short', 'split', "
         "'flip', 'echo', 'half_open', 'slow_close', 'frozen', 'stuck', 'lag', 'restart', 'door_open', "
         "'emergency_stop', 'front_panel', 'program', 'interlock', 'compliance', 'tripped', 'alarm', 'open_sensor', "
         "'lost_frames', 'lost_bursts', 'doubled_frames', 'late_frames', 'foreign_frames', 'short_frames', "
         "'swapped_frames', 'error_frames', 'bus_off', 'stuck_count', 'cleared_count', 'heater_dead', "
         "'cooling_dead', 'runaway', 'detached_sensor', 'slow', 'dead', 'open_thermometer', "
         "'current' or 'detached_thermometer'"),
        ("seed: 1", "faults: [{device: head, kind: dead, at: 5 s}]", "{device: head",
         "kind is 'dead', a device can be silent, cut, delay, late, duplicate, garbage, cut_short, split, flip, echo, "
         "half_open, slow_close, frozen, stuck, lag, restart, door_open, emergency_stop, front_panel, program, "
         "interlock, compliance, tripped, alarm, open_sensor, lost_frames, lost_bursts, doubled_frames, late_frames, "
         "foreign_frames, short_frames, swapped_frames, error_frames, bus_off, stuck_count, cleared_count, "
         "heater_dead, cooling_dead, runaway, detached_sensor, slow"),
        ("seed: 1", "faults: [{unit: a, device: head, kind: silent, at: 5 s}]", "{unit: a",
         "give either device or unit"),
        ("seed: 1", "faults: [{unit: x, kind: dead, at: 5 s}]", "unit: x", "there is no place 'x'; expected a"),
        ("\nfixture:\n", "\ntogether:\n  source: [supply]\n\nfixture:\n", "source: [supply]",
         "'source' is a device or a reading already; a group needs a name of its own"),
        ("\nfixture:\n", "\ntogether:\n  all: [supply, source]\n\nfixture:\n", "all: [",
         "members of different kinds: current sources and power supplies"),
        ("\nfixture:\n", "\ntogether:\n  all: [supply, head]\n\nfixture:\n", "head]",
         "there is no supply, current source or reading 'head'; expected unit_temperature, supply or source"),
        ("\nfixture:\n", "\ntogether:\n  all: [supply, supply]\n\nfixture:\n", "all: [", "names a member twice"),
    ],
)  # fmt: skip
def test_values_that_contradict_each_other_are_told_at_the_part_that_holds_them(folder, old, new, at, problem):
    check(folder, old, new, at, problem)


@pytest.mark.parametrize("safe", ["", "    safe: {}\n"])
def test_limits_without_the_default_safe_temperature_ask_for_one(folder, safe):
    text = changed(
        ("    safe: {temperature: 25 °C}\n", safe), ("{min: -50 °C, max: 100 °C}", "{min: 50 °C, max: 100 °C}")
    )
    problem = "temperature: does not include the default of safe.temperature; give safe.temperature as well"
    assert problems(folder, text) == [f"{place_of(text, 'temperature: {min: 50')}: {problem}"]


@pytest.mark.parametrize(
    ("old", "new", "at", "problem"),
    [
        ("from: counter.Temperatures.Unit", "from: countr.Temperatures.Unit", "from:",
         "there is no device 'countr'; did you mean 'counter'?"),
        ("from: counter.Temperatures.Unit", "from: counter.Temperatures.Unt", "from:",
         "counter has no channel 'Temperatures.Unt'; did you mean 'Temperatures.Unit'?"),
        ("from: counter.Temperatures.Unit", "from: source.voltage", "from:",
         "source has no channel 'voltage'; expected current"),
        ("unit_temperature:\n    from", "chamber: {from: chamber.process_value}\n  unit_temperature:\n    from",
         "chamber: {from", "'chamber' is a device already; a reading needs a name of its own"),
        ("channel: x", "channel: w", "channel: w", "no counter has a channel 'w'; expected x, y or z"),
        ("monitor:\n", "  b: {channel: x, temperature: unit_temperature, supply: supply}\nmonitor:\n", "channel: x, ",
         "'x' counts place 'a' already"),
        ("channel: x", "voltmeter: head", "voltmeter: head", "'head' is not a voltmeter; none is known here"),
        ("temperature: unit_temperature", "temperature: unit_temprature", "temperature: unit_temprature",
         "there is no reading 'unit_temprature'; did you mean 'unit_temperature'?"),
        ("    supply: supply\n", "    supply: suply\n", "supply: suply",
         "'suply' is not a power supply; did you mean 'supply'?"),
        ("    supply: supply\n", "    supply: head\n", "supply: head", "'head' is not a power supply; expected supply"),
        ("units: {a: uut", "units: {b: uut", "b: uut", "there is no place 'b'; expected a"),
        ("seed: 1", "faults: [{device: chambre, kind: silent, at: 5 s}]", "device: chambre",
         "there is no device 'chambre'; did you mean 'chamber'?"),
    ],
)  # fmt: skip
def test_a_name_that_another_part_does_not_have_is_told_those_it_has(folder, old, new, at, problem):
    check(folder, old, new, at, problem)


def test_a_reading_may_be_in_any_unit_but_then_it_is_no_temperature(folder):
    text = SHIPPED.replace("from: counter.Temperatures.Unit", "from: supply.current")
    calibration = place_of(text, "calibration:\n      {certificate: SIM-2026-0103")
    assert problems(folder, text) == [
        f"{place_of(text, 'limits: {min: -55 °C')}: is for a temperature, supply.current is in A",
        f"{calibration}: is for a temperature, supply.current is in A",
        f"{place_of(text, 'temperature: unit_temperature')}: 'unit_temperature' is not a temperature",
    ]


def test_readings_may_be_left_out_but_not_where_a_place_needs_one(folder):
    begin, end = SHIPPED.index("# Named readings"), SHIPPED.index("fixture:")
    text = SHIPPED[:begin] + SHIPPED[end:]
    problem = "there is no reading 'unit_temperature'; none is known here"
    assert problems(folder, text) == [f"{place_of(text, 'temperature: unit_temperature')}: {problem}"]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("", ["1:1: is empty, expected a mapping"]),
        ("- a\n", ["1:1: is a list, expected a mapping"]),
        ("bench\n", ["1:1: is 'bench', expected a mapping"]),
        (
            "{}",
            [f"1:1: the key '{key}' is missing" for key in ("devices", "fixture", "places", "schema", "site", "title")],
        ),
    ],
)
def test_a_file_that_is_no_bench_at_all_is_told_so(folder, text, found):
    assert problems(folder, text) == [f"b.yaml:{problem}" for problem in found]


@pytest.mark.parametrize(("key", "end"), [("devices", "# Named"), ("places", "monitor:")])
def test_a_bench_has_devices_and_places(folder, key, end):
    text = SHIPPED.replace(SHIPPED[SHIPPED.index(f"\n{key}:") : SHIPPED.index(end)], f"\n{key}: {{}}\n")
    assert f"{place_of(text, f'{key}: {{}}')}: {key}: is empty, expected at least one" in problems(folder, text)


# Many slips


def test_all_slips_are_told_at_once_in_the_order_of_the_file(folder):
    text = changed(
        ("title:", "titel:"),
        ("height: 420 m", "height: 420"),
        ("driver: watlow_f4t", "drivr: watlow_f4t"),
        ("axis: X", "axs: X"),
        ("rate: {max: 30 °/s}", "rate: {max: 10 °/s}"),
        ("due: 2030-12-31, k: 2, U: {time", "due: 2020-12-31, k: 2, U: {tim"),
        ("identity: {model: SIM-PSU, serial: SIM-PSU-01}", "identity: 5"),
        ("compliance: 10 V", "compliance: 10 A"),
        ("at_90: up", "at_90: level"),
        ("    channel: x\n", ""),
        ("seed: 1", "seed: one"),
    )
    assert problems(folder, text) == [
        "b.yaml:8:1: titel: unknown key; did you mean 'title'?",
        "b.yaml:12:3: height: 420 has no unit, write it like '420 m'",
        "b.yaml:18:5: drivr: unknown key; did you mean 'driver'?",
        "b.yaml:30:15: axs: unknown key; did you mean 'axis'?",
        "b.yaml:52:5: calibration: is due on 2020-12-31, which is not after its date 2026-01-01",
        "b.yaml:53:99: tim_base: unknown key; did you mean 'time_base'?",
        "b.yaml:58:5: identity: is 5, expected a mapping",
        "b.yaml:66:29: compliance: is in A, expected a quantity in V",
        "b.yaml:83:3: input_axis: of at_0 and at_90 one is level and the other up or down: "
        "the axis turns in a vertical plane",
        "b.yaml:89:3: a: needs channel, channels, voltmeter or telemetry, which measures the output of the unit; "
        "it has none of them",
        "b.yaml:102:3: seed: is 'one', expected a whole number",
    ]


def test_all_names_that_do_not_fit_are_told_at_once_in_the_order_of_the_file(folder):
    text = changed(
        ("from: counter.Temperatures.Unit", "from: countr.Temperatures.Unit"),
        ("channel: x", "channel: w"),
        ("temperature: unit_temperature", "temperature: unit_temp"),
        ("    supply: supply\n", "    supply: suply\n"),
        ("seed: 1", "faults: [{device: chambre, kind: silent, at: 5 s}]"),
        ("units: {a: uut", "units: {b: uut"),
    )
    assert problems(folder, text) == [
        "b.yaml:74:5: there is no device 'countr'; did you mean 'counter'?",
        "b.yaml:90:5: no counter has a channel 'w'; expected x, y or z",
        "b.yaml:92:5: there is no reading 'unit_temp'; did you mean 'unit_temperature'?",
        "b.yaml:93:5: 'suply' is not a power supply; did you mean 'supply'?",
        "b.yaml:103:13: there is no device 'chambre'; did you mean 'chamber'?",
        "b.yaml:105:11: there is no place 'b'; expected a",
    ]


# The bench file that a run has kept


def test_a_kept_bench_file_outlives_the_files_that_it_names(tmp_path):
    kept = tmp_path / "bench.yaml"
    kept.write_text(SHIPPED, encoding="utf-8")
    assert load_kept_bench(kept).devices["counter"].options.dbc == tmp_path / "if_counter.dbc"
    with pytest.raises(InputError) as caught:
        load_bench(kept)
    advice = "a copied file needs what it names as well"
    assert caught.value.problems == (
        f"{kept}:43:7: dbc: there is no file 'if_counter.dbc' beside this one; {advice}",
        f"{kept}:105:11: a: there is no file 'uut/quartz_flexure.yaml' beside this one; {advice}",
    )


# Where files are looked for


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "config").mkdir()
    (tmp_path / "sequences").mkdir()
    return tmp_path


def lost(name: str, kind) -> str:
    with pytest.raises(InputError) as caught:
        find(name, kind)
    return str(caught.value)


def test_a_file_is_looked_for_as_it_is_named_then_here_then_in_what_is_shipped(here):
    assert find("simulated", "config") == CONFIG / "simulated.yaml"
    assert find("simulated.yaml", "config") == CONFIG / "simulated.yaml"
    (here / "config" / "simulated.yaml").touch()
    assert find("simulated", "config") == Path("config/simulated.yaml")
    (here / "simulated.yaml").touch()
    assert find("simulated", "config") == Path("simulated.yaml")
    assert find("config/simulated", "config") == Path("config/simulated.yaml")
    assert find(str(here / "simulated.yaml"), "config") == here / "simulated.yaml"


def test_a_folder_of_that_name_does_not_hide_a_file_but_is_found_where_there_is_none(here):
    (here / "simulated").mkdir()
    (here / "elsewhere").mkdir()
    assert find("simulated", "config") == CONFIG / "simulated.yaml"
    assert find("elsewhere", "config") == Path("elsewhere")


def test_a_file_that_is_nowhere_is_told_the_nearest_that_is_known(here):
    (here / "sequences" / "my_dwell.yaml").touch()
    assert lost("simulatd", "config") == "simulatd: there is no such bench; did you mean 'simulated'?"
    assert lost("my_dwel", "sequences") == "my_dwel: there is no such sequence; did you mean 'my_dwell'?"
    *others, last = sorted(path.stem for path in CONFIG.glob("*.yaml"))
    assert lost("zzz", "config") == f"zzz: there is no such bench; expected {', '.join(others)} or {last}"
    assert lost("zzz.yaml", "config") == "zzz.yaml: there is no such file"
    assert lost("lab/zzz", "config") == "lab/zzz: there is no such file"


def test_a_name_that_no_file_can_have_is_refused(here):
    assert lost("x" * 300, "config").startswith(f"{'x' * 300}: cannot be read (")


def test_a_file_becomes_a_model(folder):
    (folder / "b.yaml").write_text(SHIPPED, encoding="utf-8")
    assert load_file(folder / "b.yaml", BenchFile).title == "Simulated accelerometer bench"


# Any change of the shipped file


VALUE = parse_document(SHIPPED, CONFIG / "simulated.yaml").value
SCRAPS = st.sampled_from(
    [None, True, 0, -1, 5, 10**18, 1.5, -0.0, 1e300, "", "x", "5", "5 V", "-300 °C", "0 s", "1e300 s", "${x}", "..",
     "a\tb", "counter.Temperatures.Unit", "2026-01-31", [], ["5 s", 5], {}, {"min": "5 °C"}, {"": None}, [[[]]]]
)  # fmt: skip
KEYS = st.sampled_from(["", "x", "min", "driver", "options", "limits", "calibration", "U", "from", "faults", "[key]"])


def nodes(value, place=()):
    yield place
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, child in children:
        yield from nodes(child, (*place, key))


PLACES = [place for place in nodes(VALUE) if place]


@st.composite
def other_values(draw):
    """The shipped bench with one to three parts replaced, left out, or put in."""
    value = copy.deepcopy(VALUE)
    for place in draw(st.lists(st.sampled_from(PLACES), min_size=1, max_size=3)):
        around = value
        for part in place[:-1]:
            held = isinstance(around, dict) and part in around
            around = around[part] if held or (isinstance(around, list) and part in range(len(around))) else None
        match draw(st.sampled_from(["replace", "leave out", "put in"])), around:
            case "put in", dict():
                around[draw(KEYS)] = draw(SCRAPS)
            case "put in", list():
                around.append(draw(SCRAPS))
            case "leave out", dict():
                around.pop(place[-1], None)
            case "replace", dict():
                around[place[-1]] = draw(SCRAPS)
    return value


@st.composite
def other_texts(draw):
    """The shipped text with a piece left out, replaced or put in; often a whole line."""
    ends = [0, *(index + 1 for index, char in enumerate(SHIPPED) if char == "\n")]
    at = draw(st.sampled_from(ends) | st.integers(0, len(SHIPPED)))
    after = min(len(SHIPPED), at + draw(st.sampled_from([0, 0, 1, 2, 20, 200])))
    begin = draw(st.integers(0, len(SHIPPED)))
    new = draw(st.just("") | st.text(max_size=4) | st.just(SHIPPED[begin : begin + 40]))
    return SHIPPED[:at] + new + SHIPPED[after:]


def reported(read) -> list[str]:
    """The problems that reading a bench raises, none where it is a bench."""
    try:
        assert isinstance(read(), BenchFile)
    except InputError as refused:
        return list(refused.problems)
    return []


@pytest.mark.lengthy
@settings(max_examples=300, deadline=None)
@given(other_values())
def test_a_bench_with_any_part_changed_is_a_bench_or_tells_its_problems(value):
    document = Document(CONFIG / "simulated.yaml", "", value, {})

    def read() -> BenchFile:
        bench = load(document, BenchFile)
        if found := document.located(misfits(bench)):
            raise InputError(*found)
        return bench

    found = reported(read)
    assert all(problem.startswith(f"{document.path}:1:1: ") for problem in found)
    assert not any("Input should" in problem for problem in found)


@settings(max_examples=80, deadline=None)
@given(text=other_texts())
def test_a_bench_with_any_piece_of_text_changed_is_a_bench_or_tells_its_problems(folder, text):
    (folder / "b.yaml").write_bytes(text.encode())
    found = reported(lambda: load_bench(folder / "b.yaml").bench)
    assert all(problem.startswith(f"{folder}/b.yaml:") for problem in found)
    assert not any("Input should" in problem for problem in found)


PAIR = """  tilt_pairs:
    - {along: %s, across: %s, skew: {value: 0 mrad, U: 1 mrad, date: 2026-01-01}}
"""


@pytest.mark.parametrize(
    ("along", "across", "said"),
    [
        ("a", "x", "there is no place 'x'; expected a, b or c"),
        ("b", "a", "place 'a' is at 270° from 'b' in the fixture, expected 90°, .* and whether they are exchanged"),
        ("a", "c", "place 'c' is at 180° from 'a' in the fixture, expected 90°"),
        ("a", "a", "place 'a' is at 0° from 'a' in the fixture"),
    ],
)
def test_a_pair_for_a_tilt_is_at_right_angles(tmp_path, along, across, said):
    shutil.copytree(CONFIG, tmp_path, dirs_exist_ok=True)
    path = tmp_path / "three_units.yaml"
    text = path.read_text("utf-8")
    begin, end = text.index("  tilt_pairs:"), text.index("  mounts:")
    assert len(load_bench(path).bench.fixture.tilt_pairs) == 1
    path.write_text(text[:begin] + PAIR % (along, across) + text[end:], "utf-8")
    with pytest.raises(InputError, match=said):
        load_bench(path)
