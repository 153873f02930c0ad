"""Commands to a run whose control sockets are flooded: by who polls, who says nothing, and who says it byte by byte."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bench.errors import InputError
from bench.runner.tell import send_command
from bench.store.reader import RunReader
from campaigns.trials.rows import Row
from tests.support.runs import ROOT
from tests.support.under_way import bench_run, wait_until

POLLING, IDLE, SLOW = 50, 300, 5
LIMIT_S = 1.0
FLOOD = """
import json, pathlib, socket, sys, threading, time
names = json.loads((pathlib.Path(sys.argv[1]) / "runner.json").read_text())
polling, idle, slow = map(int, sys.argv[2:])

def connected(key):
    while True:
        client = socket.socket(socket.AF_UNIX)
        try:
            client.connect(names[key].replace("@", chr(0), 1))
            return client
        except BlockingIOError:
            client.close()
            time.sleep(0.01)

def poll():
    while True:
        try:
            with connected("socket") as client:
                client.sendall(b'{"command": "status"}\\n')
                while client.recv(65536):
                    pass
        except OSError:
            time.sleep(0.01)

def trickle():
    while True:
        try:
            with connected("socket") as client:
                while True:
                    client.send(b" ")
                    time.sleep(0.5)
        except OSError:
            pass

silent = [connected(("socket", "stop")[number % 2]) for number in range(idle)]
for number in range(polling + slow):
    threading.Thread(target=poll if number < polling else trickle, daemon=True).start()
time.sleep(1.0)
print("flooded", flush=True)
time.sleep(600)
"""


def trials(scale: float) -> Iterator[Row]:
    """Each kind of flood, and all of them together; how long an abort takes, and what becomes of slow bytes."""
    times = max(1, round(5 * scale))
    for line, polling, idle, slow in (
        (f"abort while {POLLING} poll", POLLING, 0, 0),
        (f"abort while {IDLE} say nothing", 0, IDLE, 0),
        (f"abort while {POLLING} poll, {IDLE} say nothing, {SLOW} trickle", POLLING, IDLE, SLOW),
    ):
        took_s = [one_abort(polling, idle, slow) for _ in range(times)]
        yield Row(line, times, f"at most {max(took_s):.2f} s", max(took_s) < LIMIT_S)
    ended_s = [one_trickle() for _ in range(times)]
    yield Row("a byte every 0.5 s", times, f"ended after at most {max(ended_s):.1f} s", max(ended_s) < 3.0)


@contextmanager
def flooded(path: Path, polling: int, idle: int, slow: int) -> Iterator[None]:
    """While inside, another process floods the sockets of a run."""
    words = [sys.executable, "-c", FLOOD, str(path), str(polling), str(idle), str(slow)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        assert process.stdout is not None
        try:
            assert process.stdout.readline() == "flooded\n"
            yield
        finally:
            process.kill()


def one_abort(polling: int, idle: int, slow: int) -> float:
    """Seconds until an abort is answered; infinite when it is refused, or the journal does not have it."""
    with tempfile.TemporaryDirectory() as folder:
        with bench_run(Path(folder), "smoke", "--speed", "20", "--set", "soak=1 h") as run:
            wait_until(lambda: run.begun("soak"))
            with flooded(run.path, polling, idle, slow):
                began_s = time.monotonic()
                try:
                    send_command(run.path, "abort")
                except InputError as problem:
                    sys.stderr.write(f"{problem}\n")
                    return float("inf")
                took_s = time.monotonic() - began_s
            code, _ = run.finish()
            with RunReader(run.path) as reader:
                aborted = [event.data.get("command") for event in reader.events("command")] == ["abort"]
        return took_s if code == 4 and aborted else float("inf")


def one_trickle() -> float:
    """Seconds until somebody who says a byte every half second is answered."""
    with (
        tempfile.TemporaryDirectory() as folder,
        bench_run(Path(folder), "smoke", "--speed", "20", "--set", "soak=1 h") as run,
        socket.socket(socket.AF_UNIX) as client,
    ):
        name = json.loads((run.path / "runner.json").read_text("utf-8"))["socket"]
        client.connect(name.replace("@", "\0", 1))
        client.settimeout(0.5)
        began_s = time.monotonic()
        while time.monotonic() - began_s < 20:
            try:
                client.send(b" ")
                client.recv(4096)
                return time.monotonic() - began_s
            except TimeoutError:
                continue
    return float("inf")
