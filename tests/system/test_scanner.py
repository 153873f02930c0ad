"""A run whose thermometers are on a scanner, and whose current comes from a GS200."""

import pytest

from bench.store.reader import RunReader
from tests.support.runs import copy_bench, read_json, run_short

SEQUENCE = """\
schema: itb-sequence/1
title: A current and a temperature

needs: {source: current_source, unit_temperature: thermometer}

steps:
  - {set: source, current: 1.2 mA, compliance: 10 V, output: on}
  - {wait_until: unit_temperature, above: 10 °C, give_up_after: 1 min}
  - {wait: 30 s}

teardown:
  - {set: source, output: off}
"""
SCANNER = """\
  scanner:
    driver: agilent_34970a
    connection: sim+serial:///tmp/itb/scanner?baud=57600&flow=xonxoff
    options: {channels: {a: {channel: 101, sensor: frtd}, air: {channel: 102, sensor: tc, type: K}}}
    identity: {model: 34970A, serial: MY41001234}

readings:
"""
BENCH = (
    ("readings:\n", SCANNER),
    ("from: counter.Temperatures.Unit", "from: scanner.a"),
    ("driver: keithley_6220", "driver: yokogawa_gs200"),
    ("range: 20 mA, compliance: 10 V", "range: 10 mA, compliance: 10 V"),
    ("sim+serial:///tmp/itb/source?baud=19200", "sim+tcp://127.0.0.1:7655"),
    ("{model: MODEL 6220, serial: SIM-6220-01}", "{model: GS210, serial: SIM-GS200-01}"),
    ("{min: -20 mA, max: 20 mA}", "{min: -12 mA, max: 12 mA}"),
)


def ran(folder, faults=""):
    sequence = folder / "scanner.yaml"
    sequence.write_text(SEQUENCE, "utf-8")
    return run_short(folder, bench=copy_bench(folder / "config", *BENCH, faults=faults), sequence=str(sequence))


@pytest.fixture(scope="module")
def scanned(tmp_path_factory):
    return ran(tmp_path_factory.mktemp("runs"))


def test_it_completes_with_the_instruments_of_the_bench_file(scanned):
    assert (scanned.outcome.how, scanned.problems) == ("completed", [])
    instruments = read_json(scanned, "manifest.json")["instruments"]
    assert (instruments["source"]["model"], instruments["source"]["serial_verified"]) == ("GS210", True)
    assert (instruments["scanner"]["serial"], instruments["scanner"]["serial_verified"]) == ("MY41001234", False)


def test_readings_of_both_sensors_and_the_current_are_recorded(scanned):
    with RunReader(scanned.path) as reader:
        unit, air, current = (reader.series(name) for name in ("unit_temperature", "scanner.air", "source.current"))
    assert len(unit.values) == len(air.values) > 25
    assert set(current.values) == {0.0, 0.0012}
    assert unit.values == pytest.approx(20.0, abs=1.0)
    assert (air.at_s - unit.at_s) == pytest.approx(0.2, abs=1e-3)


def test_a_thermometer_that_opens_ends_the_run_when_its_reading_is_stale(tmp_path):
    result = ran(tmp_path, "[{unit: a, kind: open_thermometer, at: 10 s}]")
    assert result.outcome.how != "completed"
    assert any("unit_temperature: the last reading is" in problem for problem in result.problems)
