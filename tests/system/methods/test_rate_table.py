"""A run on the shipped bench with a rate table: the pulses follow gravity as the table turns."""

import numpy as np
import pytest

from bench.config.bench import load_bench
from bench.reduce.acquisitions import run_data
from bench.store.reader import RunReader
from tests.support.runs import ROOT, read_json, run_short

SEQUENCE = """\
schema: itb-sequence/1
title: Turning and swinging

needs:
  table: rate_table
  counter: pulse_counter
  supply: power_supply

setup:
  - {set: supply, voltage: 15 V, current_limit: 120 mA, output: on}

steps:
  - rotate: table
    at: 30 °/s
    during:
      - {acquire: counter, turns: 2, of: table, label: turning}
  - {oscillate: table, amplitude: 1°, frequency: 0.5 Hz, for: 10 s}
  - {rotate: table, at: -400 °/s, turns: 5}
  - {wait: 3 s}

teardown:
  - {set: supply, output: off}
"""


BENCH = ROOT / "config" / "rate_table.yaml"
PULSES_PER_S_AND_G = 11_300  # 1.13 mA/g and 10 kHz/mA of the shipped unit


@pytest.fixture(scope="module")
def turned(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    sequence = folder / "turning.yaml"
    sequence.write_text(SEQUENCE, "utf-8")
    return run_short(folder, bench=BENCH, sequence=str(sequence))


def test_it_completes(turned):
    assert (turned.outcome.how, turned.problems) == ("completed", [])
    table = read_json(turned, "manifest.json")["instruments"]["table"]
    assert (table["model"], table["serial_verified"]) == ("Acutrol3000", False)


def test_the_table_did_what_the_sequence_says(turned):
    with RunReader(turned.path) as reader:
        rates_dps, angles_deg = reader.series("table.rate").values, reader.series("table.angle").values
    assert 30.0 in rates_dps
    assert (rates_dps.min(), rates_dps[-1]) == (-400.0, 0.0)
    assert angles_deg.max() > 2 * 360
    assert angles_deg[-1] < angles_deg.max() - 5 * 360


def test_the_pulses_follow_gravity_through_whole_turns(turned):
    with RunReader(turned.path) as reader:
        (acquired,) = run_data(reader, load_bench(BENCH).bench, {"a": "SIM-A"}, "turning").acquisitions
    counts = acquired.counts["x"]
    seconds = (counts.tick - counts.tick[0]) * counts.tick_period_s
    turns = (seconds[1:] + seconds[:-1]) / 2 * (30 / 360)
    one_turn = turns < 1
    net_pps = np.diff(counts.positive - counts.negative) / np.diff(seconds)
    gravity_pps = 2 * abs((np.exp(-2j * np.pi * turns) * net_pps)[one_turn].mean())
    assert seconds[-1] == pytest.approx(2 * 12, abs=0.5)
    assert gravity_pps == pytest.approx(PULSES_PER_S_AND_G, rel=0.01)
    assert net_pps[one_turn].mean() == pytest.approx(0, abs=0.005 * PULSES_PER_S_AND_G)
