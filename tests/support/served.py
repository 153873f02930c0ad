"""The demonstration bench over real wires of this machine, and `bench simulate` at their other end."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.support.runs import ROOT, copy_bench


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def on_real_wires(folder: Path) -> Path:
    """The bench on free ports, and pseudo-terminals below a folder; its head a little faster, its set point at once."""
    edits = [(f"127.0.0.1:{port}\n", f"127.0.0.1:{free_port()}\n") for port in (1502, 8000, 5025)]
    edits += [("sim+", ""), ("/tmp/itb", str(folder / "itb")), ("rate: 20 °/s", "rate: 30 °/s")]
    edits += [("ramp_rate: {max: 3 °C/min}", "ramp_rate: {max: 1200 °C/min}")]
    return copy_bench(folder / "config", *edits)


@contextmanager
def simulating(bench: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    """`bench simulate` until the block ends."""
    process = subprocess.Popen(
        [sys.executable, "-m", "bench", "simulate", "--bench", str(bench), *options],
        stderr=subprocess.PIPE, text=True, cwd=ROOT,
    )  # fmt: skip
    try:
        assert process.stderr is not None
        lines = []
        for line in process.stderr:
            lines.append(line)
            if line == "ready\n":
                break
        assert lines[-1:] == ["ready\n"], lines
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=10)
