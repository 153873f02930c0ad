"""A frame source that a plug-in brings: acquired, stored, read back, watched for gaps and reduced like a shipped one.

The plug-in is what `bench new driver --kind pulse_counter` writes: big-endian frames without a DBC, with an own number.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from bench.app.execute import RunResult
from bench.app.new_package import write_driver
from bench.config.bench import load_bench
from bench.errors import InputError
from bench.reduce.reduced_again import reduced_again
from bench.reduce.stored_run import open_run
from bench.report.export.export import export_csv
from bench.store.reader import RunReader
from drivers.can.frame_block import FrameBlock
from drivers.description import known_drivers
from simulators.instruments.can_nodes.can_node import CanNode
from tests.support.runs import copy_bench, read_json, run_short

FRAME = 0x300
LOST_AT_S = 29.0  # in the second of four acquisitions
COUNTER = re.compile(r"^  counter:\n(?:    .*\n)+", re.MULTILINE)
ENTRY = """\
  counter:
    driver: my_counter
    connection: sim+can:socketcan/can0?bitrate=500000
    options: {period: 100 ms, max_rate: 256 kHz, inputs: {x: 0, y: 1}}
    identity: {serial: "0001"}
"""


@pytest.fixture(scope="module")
def plugin(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """An installed distribution with a driver of its own."""
    site = tmp_path_factory.mktemp("site")
    write_driver("my_counter", "pulse_counter", site / "source")
    (site / "source/my_counter/my_counter").rename(site / "my_counter")
    information = site / "my_counter-1.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: my-counter\nVersion: 1\n")
    (information / "entry_points.txt").write_text(
        "[inertial_test_bench.drivers]\nmy_counter = my_counter.description:DESCRIPTION\n"
    )
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.syspath_prepend(site)
        known_drivers.cache_clear()
        yield
    known_drivers.cache_clear()
    for module in [name for name in sys.modules if name.partition(".")[0] == "my_counter"]:
        del sys.modules[module]


def bench_with_the_plugin(folder: Path) -> Path:
    path = copy_bench(folder / "config", ("from: counter.Temperatures.Unit", "from: counter.temperature"))
    text, replaced = COUNTER.subn(ENTRY, path.read_text("utf-8"))
    assert replaced == 1
    path.write_text(text, "utf-8")
    return path


@pytest.fixture(scope="module")
def run(plugin: None, tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """The smoke test on the plug-in's counter, of whose frames one is lost."""
    right = CanNode._with_bus_faults

    def one_lost(self: CanNode, frames: FrameBlock) -> FrameBlock:
        came = right(self, frames)
        kept = (came.ids != FRAME) | (np.abs(came.at_s - LOST_AT_S) >= 0.05)
        return FrameBlock(came.ids[kept], came.at_s[kept], came.dlc[kept], came.data[kept])

    folder = tmp_path_factory.mktemp("run")
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(CanNode, "_with_bus_faults", one_lost)
        return run_short(folder / "runs", bench=bench_with_the_plugin(folder), sequence="smoke")


def test_it_is_acquired_and_a_method_reduces_it_like_what_a_shipped_counter_counts(run, smoke_run):
    assert (run.outcome.how, run.problems) == ("completed", [])
    found, expected = (
        {each.quantity: each.value for each in result.results.units[0].findings} for result in (run, smoke_run)
    )
    assert found.keys() == expected.keys()
    assert found["K1"] == pytest.approx(expected["K1"], rel=1e-4)
    assert found["K0"] == pytest.approx(expected["K0"], abs=20.0)  # µg


def test_counts_and_temperatures_are_stored_and_read_back(run):
    with open_run(run.path) as stored:
        acquisitions = stored.data("tumble").acquisitions
        assert len(acquisitions) == 4
        for acquisition in acquisitions:
            counts = acquisition.counts["x"]
            assert (counts.tick_period_s, counts.counter_bits, counts.max_rate_pps) == (1e-3, 20, 256_000)
            assert len(counts.sequence) + counts.lost in (49, 50)
            assert acquisition.temperatures_c["unit_temperature"] == pytest.approx(20.0, abs=3.0)
    with RunReader(run.path) as reader:
        assert {stream for stream, _, _ in reader.blocks()} == {"counter"}


def test_the_lost_frame_is_one_gap_of_one_channel_in_the_journal_the_results_and_a_new_reduction(run):
    with RunReader(run.path) as reader:
        (event,) = reader.events("gaps")
    assert (event.data["device"], event.data["channel"], event.data["what"]) == ("counter", "x", "latches")
    assert (event.data["gaps"], event.data["lost"]) == (1, 1)
    (gap,) = event.data["listed"]
    assert gap["first"] == gap["last"]
    assert gap["from_s"] < LOST_AT_S < gap["to_s"]
    assert gap["device_s"] == pytest.approx(0.2)
    (missed,) = read_json(run, "results.json")["missed"]
    assert {**missed, "step": event.step} == {"step": event.step, **event.data}
    with open_run(run.path) as stored:
        (again,) = stored.missed()
        assert (again.device, again.channel) == ("counter", "x")


def test_it_is_reduced_again_and_exported(run, tmp_path):
    with open_run(run.path) as stored:
        assert reduced_again(stored).changes == ()
        export_csv(stored, tmp_path)
    assert (tmp_path / "acquisitions.csv").read_text("utf-8").count(",x,") >= 190
    assert (tmp_path / "gaps.csv").read_text("utf-8").count("counter.x") == 1


def test_its_load_of_the_bus_is_checked(plugin, tmp_path):
    path = bench_with_the_plugin(tmp_path)
    path.write_text(path.read_text("utf-8").replace("period: 100 ms, max_rate", "period: 500 µs, max_rate"), "utf-8")
    with pytest.raises(InputError, match="its frames take up to 540000 bit/s, 108 % of the bus"):
        load_bench(path)
