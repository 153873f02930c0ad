"""A bench with an instrument of every driver at once: what a sequence does not use keeps nothing from its work."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bench.app.rehearse import rehearse
from bench.app.request import RunRequest, prepare
from bench.config.bench import load_bench
from bench.reduce.stored_run import open_run
from bench.report.course import _lines
from bench.runner.quiet import Quiet
from drivers.description import known_drivers
from tests.support.runs import ROOT

pytestmark = pytest.mark.slow

BENCH = ROOT / "config/every_dialect.yaml"
SHORT = {  # sequence: where its units are, and how the preset `quick` is made shorter still
    "imu_24_position": ("b", ["offsets=[0 °C]", "warm_up=0 s", "dwell=10 s"]),
    "channel_full": (
        "a", ["low=25 °C", "high=31 °C", "levels=[1 g]", "warm_up=0 s", "source_warm_up=1 min", "point=10 s"],
    ),
}  # fmt: skip


def test_every_driver_is_there() -> None:
    there = {entry.driver for entry in load_bench(BENCH).bench.devices.values()}
    missing = known_drivers().keys() - there
    assert not missing, f"{BENCH.name} has no {', '.join(sorted(missing))}; add a device"


@pytest.mark.parametrize("sequence", list(SHORT))
def test_it_is_rehearsed_with_every_instrument_connected_asked_and_made_safe(sequence: str, tmp_path: Path) -> None:
    place, settings = SHORT[sequence]
    options = RunRequest(sequence, bench=str(BENCH), preset="quick", settings=tuple(settings), runs=tmp_path)
    rehearsal = rehearse(prepare(options), Quiet())
    assert rehearsal.result.outcome.how == "completed", rehearsal.result.problems
    assert rehearsal.unsafe == {}
    assert rehearsal.lost == ()
    with open_run(rehearsal.result.path) as run:
        assert list(run.serials) == [place]
        unasked = {"telemetry", "by_hand"}  # it sends; nobody has turned that one
        asked = set(run.manifest["instruments"]) - unasked
        assert all(message["maker"] or message["serial"] for message in run.manifest["instruments"].values())
        named = {reading.from_: name for name, reading in run.bench.readings.items()}
        of_devices = {
            role: {named.get(f"{role}.{each}", f"{role}.{each}") for each in run.bench.devices[role].channels}
            for role in asked
        }
        assert asked | unasked == run.bench.devices.keys()
        for name in set().union(*of_devices.values()):
            at_s = run.reader.series(name).at_s
            assert at_s[0] < 60, name
            assert at_s[-1] > rehearsal.result.bench_s - 60, name
            assert np.diff(at_s).max() < 60, name
        assert np.abs(run.reader.series("dvm.voltage").values).max() < 1e-3  # no unit is connected to it
        for role in run.bench.with_capability("thermal_chamber"):
            air_c = run.reader.series(f"{role}.process_value").values
            assert (np.ptp(air_c) > 4) == (role == "chamber"), f"{role}: only the units' own chamber was ramped"
        assert {line.name.partition(":")[0] for line in _lines(run) if ":" in line.name} == {"chamber"}
