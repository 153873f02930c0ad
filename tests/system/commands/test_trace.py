"""What passes on the wires of a bench is recorded, and a recording answers as the instruments did."""

import asyncio
import re
from itertools import pairwise
from pathlib import Path

import pytest

from bench.app.request import load_bench_named
from bench.app.tracing import read_trace_file, trace_bench
from bench.errors import InputError
from bench.loop import AS_FAST_AS_POSSIBLE, BenchLoop, run
from drivers.description import Setup, make_driver
from drivers.errors import NoAnswer
from drivers.transport.memory import Line
from drivers.transport.trace import CLOSED, HEAD, OPENED, RECEIVED, SENT, Passed, read_trace, spelled
from drivers.transport.wires import RealWires
from simulators.serving.replay import ReplayedInstrument
from simulators.serving.serve import protocol_factory
from tests.support.commands import invoked


@pytest.fixture(scope="module")
def trace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("trace") / "bench.trace"
    lines, problems = trace_bench(None, path, 5.0)
    assert problems == []
    assert lines == len(path.read_text("utf-8").splitlines()) - 1
    return path


def test_everything_that_passes_is_recorded_with_its_time(trace: Path) -> None:
    passed = read_trace_file(trace)
    assert {each.device for each in passed} == set(load_bench_named(None).bench.devices)
    chamber = [each for each in passed if each.device == "chamber"]
    assert chamber[0] == Passed(0.002, "chamber", OPENED, "sim+tcp://127.0.0.1:1502")
    assert chamber[1] == Passed(0.002, "chamber", SENT, "00 01 00 00 00 06 01 03 1a 4a 00 01")
    assert chamber[2] == Passed(0.004, "chamber", RECEIVED, "00 01 00 00 00 05 01 03 02 00 0f")
    assert chamber[-1].sign == CLOSED
    assert [each.at_s for each in passed if each.sign == SENT] == sorted(
        each.at_s for each in passed if each.sign == SENT
    )
    supply = next(each for each in passed if each.device == "supply" and each.sign == SENT)
    assert (supply.text, supply.data) == (r'"*IDN?\n"', b"*IDN?\n")
    frames = [each for each in passed if each.device == "counter" and each.sign == RECEIVED]
    assert frames[0].text.startswith("100#")


@pytest.mark.parametrize("data", [b"*IDN?\r\n", b'"quoted"', b"\x00\x01", b"\x81\xc1", b" "])
def test_bytes_are_read_as_they_were_written(data: bytes) -> None:
    line = Passed(1.5, "supply", SENT, spelled(data)).line()
    assert next(read_trace([HEAD, line])).data == data


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", ""),
        ("hello", "line 1 is 'hello', a trace begins with"),
        (f"{HEAD}\n1.0 chamber ? 00", "line 2 is no line of a trace: '1.0 chamber"),
        (f"{HEAD}\n\nsoon chamber > 00", "line 3 is no line of a trace"),
    ],
)
def test_what_is_no_trace_is_told(tmp_path: Path, text: str, problem: str) -> None:
    path = tmp_path / "bad.trace"
    path.write_text(text, "utf-8")
    if not problem:
        assert read_trace_file(path) == []
        return
    with pytest.raises(InputError, match=re.escape(problem)):
        read_trace_file(path)


def from_trace(trace: Path, role: str, complaints: list[str], **options: object):
    """A driver whose instrument is the recording."""
    bench = load_bench_named(None).bench
    entry = bench.devices[role]
    loop = asyncio.get_running_loop()
    assert isinstance(loop, BenchLoop)
    instrument = ReplayedInstrument(role, read_trace_file(trace), complaints.append)
    address = entry.connection
    loop.serve_in_memory(address.host, address.port, protocol_factory(instrument), Line())
    changed = entry.options.model_copy(update=options)
    return make_driver(
        entry.description, Setup(role, address, RealWires(), changed, entry.limits, entry.safe, entry.identity)
    )


@pytest.mark.parametrize("role", ["chamber", "head", "supply"])
def test_a_recording_answers_as_the_instrument_did(trace: Path, role: str) -> None:
    complaints: list[str] = []

    async def main() -> None:
        async with from_trace(trace, role, complaints) as driver:
            await driver.identify()
            for _ in range(3):
                assert await driver.poll()
                await asyncio.sleep(1.0)

    run(main(), AS_FAST_AS_POSSIBLE)
    assert complaints == []


def test_another_request_than_the_recorded_one_is_told_and_not_answered(trace: Path) -> None:
    complaints: list[str] = []

    async def main() -> None:
        with pytest.raises(NoAnswer):
            await from_trace(trace, "chamber", complaints, unit_id=2).__aenter__()

    run(main(), AS_FAST_AS_POSSIBLE)
    assert complaints[0] == (
        "chamber: the trace has 00 01 00 00 00 06 01 03 1a 4a 00 01, not 00 01 00 00 00 06 02 03 1a 4a 00 01"
    )


def test_a_run_is_recorded(tmp_path: Path) -> None:
    path = tmp_path / "smoke.trace"
    done = invoked("run", "smoke", "--runs", str(tmp_path), "--no-report", "--trace", str(path))
    assert done.returncode == 0, done
    assert {each.sign for each in read_trace_file(path)} == {OPENED, CLOSED, SENT, RECEIVED}
    again = invoked("run", "smoke", "--runs", str(tmp_path), "--no-report", "--trace", str(path))
    assert again.returncode == 2
    assert "cannot be written: File exists" in again.stderr


@pytest.fixture(scope="module")
def traced(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A run that acquires, and its trace."""
    folder = tmp_path_factory.mktemp("traced")
    path = folder / "smoke.trace"
    assert invoked("run", "smoke", "--runs", str(folder / "runs"), "--no-report", "--trace", str(path)).returncode == 0
    (run,) = (folder / "runs").iterdir()
    return run, path


def logged(path: Path) -> list[tuple[float, str]]:
    """Times and frames in a log of candump."""
    lines = [line.split() for line in path.read_text("ascii").splitlines()]
    return [(float(at[1:-1]), frame) for at, _, frame in lines]


def test_all_frames_of_a_traced_run_are_exported(traced: tuple[Path, Path], tmp_path: Path) -> None:
    run, path = traced
    some = invoked("export", str(run), "--format", "candump", "--out", str(tmp_path / "some"))
    every = invoked("export", str(run), "--format", "candump", "--all", str(path), "--out", str(tmp_path / "all"))
    assert (some.returncode, every.returncode) == (0, 0), every
    acquired, whole = (logged(tmp_path / name / "counter.log") for name in ("some", "all"))
    near = {(round(at_s * 1e5) + by, frame) for at_s, frame in whole for by in (-1, 0, 1)}
    assert {(round(at_s * 1e5), frame) for at_s, frame in acquired} <= near
    assert len(acquired) < len(whole)
    assert len(whole) == sum(each.device == "counter" and each.sign == RECEIVED for each in read_trace_file(path))
    assert max(after - before for (before, _), (after, _) in pairwise(whole)) < 0.1  # none in between is missing
    assert path.name in (tmp_path / "all" / "candump.txt").read_text("utf-8")
    assert sorted(each.name for each in (tmp_path / "all").iterdir()) == ["candump.txt", "counter.log"]


@pytest.mark.parametrize(
    ("head", "options", "problem"),
    [
        (f"{HEAD}\n", ("candump",), "is not the trace of a run. Give the file that --trace of run"),
        ("", ("candump",), "is not the trace of a run"),
        (f"{HEAD}\n# run another\n", ("candump",), "is the trace of run another. Give the file that --trace of run"),
        (f"{HEAD}\n# run {{run}}\n1.0 ../out < 101#00\n", ("candump",), "the run has no device '../out'"),
        (f"{HEAD}\n# run {{run}}\nhello\n", ("candump",), "line 3 is no line of a trace: 'hello'"),
        (f"{HEAD}\n# run {{run}}\n", ("csv",), "--all is for --format candump"),
        (None, ("candump",), "cannot be read: No such file or directory"),
    ],
)
def test_what_is_no_trace_of_the_run_is_refused(
    traced: tuple[Path, Path], tmp_path: Path, head: str | None, options: tuple[str], problem: str
) -> None:
    run, path = traced[0], tmp_path / "given.trace"
    if head is not None:
        path.write_text(head.replace("{run}", run.name), "utf-8")
    done = invoked("export", str(run), "--format", *options, "--all", str(path), "--out", str(tmp_path / "out"))
    assert done.returncode == 2
    assert problem in done.stderr
    assert not list(tmp_path.rglob("*.log"))


def test_a_bench_is_looked_at_and_recorded(tmp_path: Path) -> None:
    path = tmp_path / "look.trace"
    done = invoked("trace", "--out", str(path), "--for", "3")
    assert done.returncode == 0
    assert f"lines in {path}" in done.stdout
