"""Gates of one second on a computer that is idle and on one that is busy: counts between time stamps of the device.

The pulses of the counter are known: so many from latch to latch, and its clock is the one of its frames. So the error
of a rate is that of its gate. This program takes gate and counts from the same frames; the loop beside it takes its
gate from the clock of the host. Both also read a chamber each second, by Modbus TCP from `bench simulate`.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from importlib.metadata import version
from pathlib import Path

from bench.config.load import load_file
from bench.config.models import BenchFile
from bench.metrology.acquisition import Counts
from bench.metrology.pulse_counts import mean_rate
from bench.store.decoder import Decoder
from bench.store.reader import RunReader
from benchmarks.bus import FRAMES_OF_A_LATCH, PULSES, sending
from benchmarks.compared import Row, Side
from tests.support.served import on_real_wires, simulating

LATCH_S = 0.01
TRUE_PPS = PULSES["AxisX"] / LATCH_S
DIGITS = 6  # of an error in ppm; floating-point numbers have not many more
PEER = Path(__file__).parents[1] / "peers" / "host_clock_loop.py"
HOGS = os.cpu_count() or 1
WHOLE, SLICE = 300, 10
BEFORE_S = 20.0  # for which the bus sends longer than it is read
SEQUENCE = """\
schema: itb-sequence/1
title: Gates of one second
needs: {{chamber: thermal_chamber, counter: pulse_counter}}
steps:
  - repeat: {count}
    steps:
      - {{acquire: counter, for: 1 s, label: gate}}
"""


def measure(whole: bool) -> Iterator[Row]:
    """A row on an idle computer, and one on a busy one."""
    count = WHOLE if whole else SLICE
    with tempfile.TemporaryDirectory() as name:
        bench = on_real_wires(Path(name))
        with simulating(bench):
            yield _row("", *_both(bench, Path(name) / "idle", count))
            with _hogs():
                beside = f", beside {HOGS} processes that never wait"
                yield _row(beside, *_both(bench, Path(name) / "busy", count))


Gates = tuple[Sequence[float], Sequence[float]]
"""Rates in pulse/s, and durations by the clock of the host in s."""


def _both(bench: Path, folder: Path, count: int) -> tuple[Gates, Gates]:
    folder.mkdir()
    with _counter(count) as line:
        ours = _ours(bench, folder, line, count)
    with _counter(count) as line:
        theirs = _theirs(bench, line, count)
    return ours, theirs


def _counter(count: int) -> AbstractContextManager[str]:
    """A counter that sends latches at a fixed rate by a serial line; its device."""
    return sending("slcan", FRAMES_OF_A_LATCH / LATCH_S, count * 1.5 + BEFORE_S)


@contextmanager
def _hogs() -> Iterator[None]:
    hogs = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(HOGS)]
    try:
        yield
    finally:
        for each in hogs:
            each.kill()
            each.wait()


def _ours(bench: Path, folder: Path, line: str, count: int) -> Gates:
    """Gates of a run whose counter is at the end of a serial line."""
    sequence, file = folder / "gates.yaml", bench.with_name(f"{folder.name}.yaml")
    sequence.write_text(SEQUENCE.format(count=count), "utf-8")
    text = re.sub(r"slcan:\S+", f"slcan://{line}?bitrate=1000000", bench.read_text("utf-8"))
    file.write_text(text.replace("period: 100 ms", f"period: {LATCH_S * 1e3:g} ms"), "utf-8")
    given = ["--bench", str(file), "--runs", str(folder / "runs"), "--uut", "QF-0001", "--no-report"]
    done = subprocess.run(
        [sys.executable, "-m", "bench", "run", str(sequence), *given], capture_output=True, text=True, check=False
    )
    runs = list((folder / "runs").glob("*/"))
    if len(runs) != 1:
        raise RuntimeError(done.stderr)
    decoder, rates = Decoder(load_file(file, BenchFile).devices["counter"]), []
    with RunReader(runs[0]) as reader:
        for frames in reader.frames_by_step().values():
            counts = decoder.outputs(frames["counter"])["x"]
            if isinstance(counts, Counts):
                rates.append(mean_rate(counts).net_pps)
        ends = [each.data for each in reader.events("step_ended") if "begin_s" in each.data]
    if len(rates) != count:
        raise RuntimeError(done.stderr)
    return rates, [each["end_s"] - each["begin_s"] for each in ends]


def _theirs(bench: Path, line: str, count: int) -> Gates:
    address = load_file(bench, BenchFile).devices["chamber"].connection
    done = subprocess.run(
        [sys.executable, PEER, line, f"{address.port}", f"{count}"], capture_output=True, text=True, check=True
    )
    found = json.loads(done.stdout.splitlines()[-1])
    return found["rates"], found["gates_s"]


def _row(where: str, ours: Gates, theirs: Gates) -> Row:
    loop = f"asyncio with pymodbus {version('pymodbus')} and pyserial {version('pyserial')}, gates of the host's clock"
    mine = _side(f"inertial-test-bench {version('inertial-test-bench')}", ours, "each step on the disk")
    return Row(
        "P9", f"error of the rate in a gate of 1 s{where}", "ppm", mine, (_side(loop, theirs, "none"),),
        "0: the frames have the clock of the counter", "0 from jitter of the host", not any(mine.values),
    )  # fmt: skip


def _side(name: str, gates: Gates, durability: str) -> Side:
    rates, durations_s = gates
    errors = [round(abs(each / TRUE_PPS - 1) * 1e6, DIGITS) for each in rates]
    late_ms = max(abs(each - 1) for each in durations_s) * 1e3
    extremes = f"at most {max(errors):.3g} ppm; seconds of the host off by up to {late_ms:.3g} ms"
    return Side(name, f"{durability}; {extremes}", tuple(errors))
