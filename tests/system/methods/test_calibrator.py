"""A run on a bench whose current source is a Fluke calibrator: it warms up, settles, and ends in standby."""

import pytest

from bench.store.reader import RunReader
from tests.support.runs import copy_bench, read_json, run_short

SEQUENCE = """\
schema: itb-sequence/1
title: A current from a calibrator that has warmed up

needs: {source: current_source}

steps:
  - {wait_until: source.on_time, above: 2 h, give_up_after: 3 h}
  - {set: source, current: 1.2 mA, compliance: 10 V, output: on}
  - {wait: 30 s}

teardown:
  - {set: source, output: off}
  - {wait: 20 s}
"""
CALIBRATOR = (
    ("driver: keithley_6220", "driver: fluke_5700a"),
    ("range: 20 mA, compliance: 10 V", "range: 22 mA, compliance: 10 V"),
    ("source?baud=19200", "source?baud=9600&flow=xonxoff"),
    ("{model: MODEL 6220, serial: SIM-6220-01}", "{model: 5730A, serial: SIM-5730A-07}"),
)


@pytest.fixture(scope="module")
def warmed_up(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    sequence = folder / "calibrator.yaml"
    sequence.write_text(SEQUENCE, "utf-8")
    return run_short(folder, bench=copy_bench(folder / "config", *CALIBRATOR), sequence=str(sequence))


def test_it_completes_with_the_calibrator_of_the_bench_file(warmed_up):
    assert (warmed_up.outcome.how, warmed_up.problems) == ("completed", [])
    source = read_json(warmed_up, "manifest.json")["instruments"]["source"]
    assert (source["model"], source["serial"], source["serial_verified"]) == ("5730A", "SIM-5730A-07", True)


def test_the_current_flows_after_two_hours_and_settled_until_it_goes_to_standby(warmed_up):
    with RunReader(warmed_up.path) as reader:
        current, settled, on_time = (reader.series(f"source.{name}") for name in ("current", "settled", "on_time"))
    flowing = current.values == 0.0012
    assert flowing.any()
    assert set(current.values) == {0.0, 0.0012}
    assert on_time.values[flowing].min() > 7200
    assert settled.values[flowing][-1] == 1
    assert (current.values[-1], settled.values[~flowing].max()) == (0, 0)
