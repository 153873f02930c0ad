"""What passes on the wires of a bench is recorded, and a recording answers as the instruments did."""

import asyncio
import re
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
from simulators.replay import ReplayedInstrument
from simulators.serve import protocol_factory
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
    done = invoked("run", "smoke", "--runs", str(tmp_path), "--trace", str(path))
    assert done.exit_code == 0, done
    assert {each.sign for each in read_trace_file(path)} == {OPENED, CLOSED, SENT, RECEIVED}
    again = invoked("run", "smoke", "--runs", str(tmp_path), "--trace", str(path))
    assert again.exit_code == 2
    assert "cannot be written: File exists" in again.stderr


def test_a_bench_is_looked_at_and_recorded(tmp_path: Path) -> None:
    path = tmp_path / "look.trace"
    done = invoked("trace", "--out", str(path), "--for", "3")
    assert done.exit_code == 0
    assert f"lines in {path}" in done.stdout
