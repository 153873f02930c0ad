"""A recorded bus in the place of a counter: the same counts and the same results, from a log of any kind."""

from __future__ import annotations

import asyncio
from pathlib import Path

import can
import numpy as np
import pytest

from bench.app.execute import RunResult
from bench.app.inspect import inspect_devices
from bench.app.tracing import read_trace_file
from bench.loop import AS_FAST_AS_POSSIBLE, run
from bench.store.reader import RunReader
from drivers.can.frame_block import ERROR, EXTENDED, FrameBlock
from drivers.dialects.can_counter.wire import Counts, decode_counts
from drivers.errors import CannotConnect, NoAnswer
from drivers.transport.address import Address
from drivers.transport.can import open_can
from drivers.transport.trace import OPENED, RECEIVED
from tests.support.laboratory import counter_form
from tests.support.runs import copy_bench, run_short

ENDINGS = ("asc", "blf", "log")  # Vector's two, and candump's
SIMULATED = "connection: sim+slcan:///tmp/itb/can?bitrate=500000"
STEPS = [f"steps/temperature=20/position={angle}/acquire" for angle in (0, 90, 180, 270)]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunResult, Path]:
    """A simulated run, and a folder with its bus as bus.asc, bus.blf and bus.log."""
    folder = tmp_path_factory.mktemp("recorded")
    trace = folder / "bus.trace"
    result = run_short(folder / "runs", sequence="smoke", trace=trace)
    passed = [each for each in read_trace_file(trace) if each.device == "counter"]
    messages = [message(0x7FF, b"", next(each.at_s for each in passed if each.sign == OPENED))]
    for each in passed:
        if each.sign == RECEIVED:
            name, _, data = each.text.partition("#")
            messages.append(message(int(name, 16), bytes.fromhex(data), each.at_s))
    for ending in ENDINGS:
        with can.Logger(folder / f"bus.{ending}") as logger:
            for each in messages:
                logger(each)
    return result, folder


def message(frame_id: int, data: bytes, at_s: float) -> can.Message:
    return can.Message(arbitration_id=frame_id, data=data, is_extended_id=False, timestamp=at_s + 1e9, channel=0)


def counted(result: RunResult) -> list[Counts]:
    with RunReader(result.path) as reader:
        blocks = reader.frames_by_step()
    return [decode_counts(counter_form(), "x", blocks[step]["counter"]) for step in STEPS]


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_run_from_a_log_has_the_counts_and_the_results_of_the_run_that_was_recorded(
    tmp_path: Path, recorded: tuple[RunResult, Path], ending: str
) -> None:
    original, folder = recorded
    bench = copy_bench(tmp_path / "config", (SIMULATED, f"connection: log:{folder}/bus.{ending}".replace(":/", ":///")))
    again = run_short(tmp_path / "runs", sequence="smoke", bench=bench)
    assert again.outcome.how == "completed", again.problems
    for before, after in zip(counted(original), counted(again), strict=True):
        for what in ("sequence", "tick", "positive", "negative"):
            assert np.array_equal(getattr(before, what), getattr(after, what)), what
        assert after.host_s == pytest.approx(before.host_s, abs=2e-6)
    values = [{f.quantity: f.value for f in each.results.units[0].findings} for each in (original, again)]
    assert values[1] == pytest.approx(values[0], rel=1e-12)


def test_a_log_beside_the_bench_file_is_looked_at(tmp_path: Path, recorded: tuple[RunResult, Path]) -> None:
    _, folder = recorded
    bench = copy_bench(tmp_path / "config", (SIMULATED, "connection: log:bus.blf"))
    (tmp_path / "config/bus.blf").write_bytes((folder / "bus.blf").read_bytes())
    found = {look.role: look for look in inspect_devices(str(bench))}
    assert not found["counter"].problem, found["counter"].text


def test_a_sequence_longer_than_the_log_is_told_that_it_has_ended(
    tmp_path: Path, recorded: tuple[RunResult, Path]
) -> None:
    _, folder = recorded
    bench = copy_bench(tmp_path / "config", (SIMULATED, f"connection: log://{folder}/bus.blf"))
    result = run_short(tmp_path / "runs", sequence="smoke", bench=bench, settings=("gate=60 s",))
    assert result.outcome.how == "error"
    assert "counter: the log bus.blf has ended, 7" in result.problems[0]
    assert "Record for longer" in result.problems[0]


def test_a_log_that_is_not_there_ends_the_run_before_anything_moves(tmp_path: Path) -> None:
    bench = copy_bench(tmp_path / "config", (SIMULATED, "connection: log:no_such.blf"))
    result = run_short(tmp_path / "runs", sequence="smoke", bench=bench)
    assert result.outcome.how == "error"
    assert f"counter: cannot read the log {tmp_path}/config/no_such.blf" in result.problems[0]


# The link alone


def taken(path: Path, at_s: list[float]) -> list[FrameBlock]:
    """What is taken at some times after a log was opened, 10 s after the beginning."""

    async def main() -> list[FrameBlock]:
        await asyncio.sleep(10.0)
        link = await open_can("counter", Address.parse(f"log://{path}"))
        found = []
        for each_s in at_s:
            await asyncio.sleep(10.0 + each_s - asyncio.get_running_loop().time())
            found.append(link.take())
        link.close()
        return found

    return run(main(), AS_FAST_AS_POSSIBLE)


CANDUMP = """\
(1690000000.000000) can0 123#0A0B
(1690000000.500000) can0 1ABCDEF0#FF
(1690000001.000000) can0 20000080#0000000000000000
(1690000000.900000) can0 123#R
(1690000000.900000) can0 7FF#
"""


def test_frames_come_as_far_apart_as_they_were_recorded_and_never_back_in_time(tmp_path: Path) -> None:
    (tmp_path / "bus.log").write_text(CANDUMP, "ascii")
    first, second, third, none = taken(tmp_path / "bus.log", [0.0, 0.6, 1.0, 1.9])
    assert (first.ids.tolist(), first.at_s.tolist(), first.data[0, :2].tolist()) == ([0x123], [10.0], [10, 11])
    assert (second.ids.tolist(), second.at_s.tolist()) == ([0x1ABCDEF0 | EXTENDED], [10.5])
    assert (third.ids.tolist(), third.at_s.tolist()) == ([ERROR, 0x7FF], [11.0, 11.0])
    assert len(none) == 0
    with pytest.raises(NoAnswer, match=r"counter: the log bus.log has ended, 1 s after its first frame\. Record for"):
        taken(tmp_path / "bus.log", [1.0, 2.1])


@pytest.mark.parametrize(("name", "text"), [("bus.log", "nonsense\n"), ("bus.xyz", "?"), ("bus.log", "")])
def test_a_file_that_is_no_log_is_told(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text, "ascii")
    with pytest.raises(
        CannotConnect, match=rf"counter: (cannot read the log .*{name}: \w|the log .*{name} has no frame)"
    ):
        taken(tmp_path / name, [])
