"""A run whose thermometers are on a scanner, and whose current comes from a GS200."""

import pytest

from bench.store.reader import RunReader
from campaigns.line_faults.gain import one_take
from simulators.instruments.meters.agilent_34970a import SimulatedScanner
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
    assert any("unit_temperature has had no valid reading for" in problem for problem in result.problems)


def temperatures_with_one_answer_altered(folder, monkeypatch):
    """The unit's temperatures of a run in which a bit of one scan was turned on its way, and what drivers noted."""
    answers = []
    end_scan = SimulatedScanner.end_scan

    def altered(scanner):
        if reported := end_scan(scanner):  # nothing when the memory is asked once more
            answers.append(reported)
        return reported.replace("+1.9", "+1.6", 1) if reported and len(answers) == 20 else reported

    monkeypatch.setattr(SimulatedScanner, "end_scan", altered)
    result = ran(folder)
    assert result.outcome.how == "completed"
    assert answers[19].startswith("+1.9")
    with RunReader(result.path) as reader:
        return reader.series("unit_temperature").values, [event.data["text"] for event in reader.events("device_note")]


def test_an_answer_that_was_altered_on_the_line_is_asked_again_and_not_recorded(tmp_path, monkeypatch):
    temperatures_c, notes = temperatures_with_one_answer_altered(tmp_path, monkeypatch)
    assert temperatures_c == pytest.approx(20.0, abs=1.0)
    (note,) = notes
    assert note.startswith("a scan was reported as 101: 16.9")
    assert "°C; repeated: 101: 19.9" in note


def test_by_one_take_it_would_be_recorded(tmp_path, monkeypatch):
    with one_take():
        temperatures_c, notes = temperatures_with_one_answer_altered(tmp_path, monkeypatch)
    assert (temperatures_c < 18).sum() == 1
    assert notes == []
