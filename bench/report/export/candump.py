"""CAN frames of a run in the format of can-utils' `candump -l`: those of acquisitions, or all of a trace."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TextIO

from bench.errors import InputError
from bench.files import atomic_file
from bench.reduce.stored_run import StoredRun
from drivers.can.frame_block import EXTENDED, FrameBlock
from drivers.transport.trace import RECEIVED, read_trace, run_of

OF_ACQUISITIONS = """\
These logs are not the whole bus. The record of a run contains frames while a step acquires, and at no other time; of
these it contains what the devices of its bench file read. A run that is started with --trace FILE also records what
passes between acquisitions; bench export --format candump --all FILE writes it.
"""
OF_TRACE = """\
These logs contain every CAN frame in the trace {trace}: all that the adapters of the bench
received from when they were opened until they were closed.
"""


def export_candump(run: StoredRun, out: Path) -> list[Path]:
    """Write `STREAM.log` for each counter, with the frames of acquisitions; the DBC of the run decodes it.

    Times are seconds since 1970, counted from the beginning of the run. `candump.txt` beside the logs states what they
    do not contain.
    """
    streams: dict[str, list[FrameBlock]] = {}
    for stream, _, block in run.reader.blocks():
        streams.setdefault(stream, []).append(block)
    epoch_s, paths = _epoch_s(run), []
    for stream, blocks in streams.items():
        path = out / f"{stream}.log"
        with atomic_file(path) as draft, draft.open("w", encoding="ascii") as file:
            for block in blocks:
                file.writelines(_lines(block, epoch_s))
        paths.append(path)
    return [*paths, _described(out, OF_ACQUISITIONS)]


def export_trace(run: StoredRun, trace: Path, out: Path) -> list[Path]:
    """Write `DEVICE.log` for each device with CAN frames in the trace of a run; times as in `export_candump`.

    Raises InputError for a file that is not a trace of this run.
    """
    epoch_s = _epoch_s(run)
    files: dict[str, TextIO] = {}
    try:
        _expect_trace_of(run, trace)
        with trace.open(encoding="utf-8") as lines, ExitStack() as stack:
            for device, at_s, frame in _frames(lines):
                if device not in files:
                    if device not in run.bench.devices:
                        raise InputError(f"{trace}: the run has no device {device!r}")
                    draft = stack.enter_context(atomic_file(out / f"{device}.log"))
                    files[device] = stack.enter_context(draft.open("w", encoding="ascii"))
                files[device].write(f"({at_s + epoch_s:.6f}) can0 {frame}\n")
    except OSError as problem:
        raise InputError(f"the trace {trace} cannot be read: {problem.strerror}") from problem
    except ValueError as problem:
        raise InputError(f"{trace}: {problem}") from problem
    return [*(out / f"{device}.log" for device in files), _described(out, OF_TRACE.format(trace=trace.name))]


def _expect_trace_of(run: StoredRun, trace: Path) -> None:
    with trace.open(encoding="utf-8") as lines:
        of = run_of(lines)
    if of != run.folder.name:
        other = f"the trace of run {of}" if of else "not the trace of a run"
        raise InputError(f"{trace} is {other}. Give the file that --trace of run {run.folder.name} has written.")


def _frames(lines: TextIO) -> Iterator[tuple[str, float, str]]:
    """Device, bench time and text of each CAN frame; bytes of other devices have no bare `#`."""
    for passed in read_trace(lines):
        if passed.sign == RECEIVED and "#" in passed.text and not passed.text.startswith('"'):
            yield passed.device, passed.at_s, passed.text


def _epoch_s(run: StoredRun) -> float:
    """Seconds from 1970 to the zero of bench time."""
    began = next(run.reader.events("run_begins"), None)
    return run.began.timestamp() - (began.at_s if began else 0.0)


def _described(out: Path, text: str) -> Path:
    path = out / "candump.txt"
    with atomic_file(path) as draft:
        draft.write_text(text, encoding="utf-8")
    return path


def _lines(block: FrameBlock, epoch_s: float) -> Iterator[str]:
    columns = (block.ids.tolist(), (block.at_s + epoch_s).tolist(), block.dlc.tolist(), block.data)
    for frame_id, at_s, length, data in zip(*columns, strict=True):
        name = f"{frame_id & ~EXTENDED:08X}" if frame_id & EXTENDED else f"{frame_id:03X}"
        yield f"({at_s:.6f}) can0 {name}#{data[:length].tobytes().hex().upper()}\n"
