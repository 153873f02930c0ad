"""Tasks of a campaign for tests, done by its workers."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from bench.app.request import RunRequest, prepare
from bench.campaign.ledger import RESULTS
from bench.campaign.local_cluster import MODULE
from bench.campaign.tasks import Result, Task
from bench.store.machine_state import machine_folder
from bench.store.user_state import state_folder
from tests.support.runs import copy_bench


@dataclass
class Given:
    """A campaign of given tasks."""

    given: Sequence[Task]
    name: str = "given"
    lines: list[str] = field(default_factory=list)

    def tasks(self, known):
        return self.given

    def told(self, known, out):
        return self.lines

    def exit_code(self, known):
        return 0


def squares(count, **more):
    """Tasks that square numbers."""
    return [task("squared", number=number, **more) for number in range(count)]


def task(function, **arguments):
    """A task of this module."""
    key = f"{function} {' '.join(map(str, arguments.values()))}".strip()
    return Task(key, f"tests.support.campaign_tasks:{function}", arguments)


def lines_in(folder: Path) -> list[Result]:
    """The results in a folder, one for each line of its file."""
    found = [Result.of_line(line) for line in (folder / RESULTS).read_text("utf-8").splitlines()]
    assert None not in found
    return found


def workers_under(parent: int) -> list[int]:
    """Processes of the workers that a campaign has started."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            of = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            if of == parent and MODULE.encode() in (folder / "cmdline").read_bytes():
                found.append(int(folder.name))
    return found


def squared(number, after_s=0.0):
    """The square of a number, after some time."""
    time.sleep(after_s)
    return {"number": number, "square": number**2}


def nothing():
    """No work."""


def raised(text):
    """Raise an error."""
    raise ValueError(text)


def killed():
    """Kill the worker."""
    os.kill(os.getpid(), signal.SIGKILL)


def killed_once(mark):
    """Kill the worker, the first time."""
    if not Path(mark).exists():
        Path(mark).touch()
        killed()
    return "the second time"


def started(mark):
    """Start another process, and wait for it; the second time return its number."""
    if Path(mark).exists():
        return int(Path(mark).read_text())
    child = subprocess.Popen(["sleep", "600"])
    Path(mark).write_text(str(child.pid))
    os.kill(os.getpid(), signal.SIGKILL)
    return 0


def drawn():
    """Another content each time, as a task must not have."""
    return os.urandom(8).hex()


def worker():
    """Process, folder of records, and shared folder of the worker that does this."""
    return {"pid": os.getpid(), "state": str(state_folder()), "machine": str(machine_folder())}


def connected(folder, port):
    """Run a bench with a chamber at a real port."""
    from bench.app.execute import execute
    from bench.runner.quiet import Quiet

    path = copy_bench(Path(folder), ("sim+tcp://127.0.0.1:1502", f"tcp://127.0.0.1:{port}"))
    result = execute(prepare(RunRequest("smoke", str(path), runs=Path(folder) / "runs", units=("a=A",))), Quiet())
    return result.problems
