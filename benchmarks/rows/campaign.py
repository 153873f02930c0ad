"""P11: what a campaign costs, beside processes that do the same nights without one."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from bench.campaign.carry_out import carry_out, workers_of
from bench.campaign.cluster import here
from bench.campaign.ledger import opened
from bench.campaign.nights import Faults, night_of
from bench.campaign.program import digest_of, identity
from bench.campaign.tasks import Task
from benchmarks.compared import Row, Side, in_turn
from tests.support.campaign_tasks import Given

ROOT = Path(__file__).parents[2]
WORKERS = 2
EMPTY = 500
SHARE = 0.95
DURABLE = "each result synced"
OWN = """
import sys
from bench.campaign.nights import Faults, night_of, play
tasks = Faults(night_of("smoke", "simulated", None, ()), range({first}, {end}, {workers})).tasks(None)
play(**tasks[0].arguments)
print("ready", flush=True)
sys.stdin.readline()
for task in tasks:
    play(**task.arguments)
print("done", flush=True)
"""


def measure(whole: bool) -> Iterator[Row]:
    """Milliseconds of a task without work, and seconds of nights with faults."""
    with here(1) as client:
        waited_for(client, 1)
        empty = [Task(f"{number}", "tests.support.campaign_tasks:nothing", {}) for number in range(EMPTY)]
        by_campaign_s(empty[:50], client)
        each_ms = tuple(took_s / EMPTY * 1e3 for took_s in repeated(partial(by_campaign_s, empty, client)))
    side = Side("this program", DURABLE, each_ms)
    yield Row("P11", "a task without work, kept on the disk", "ms", side, (), "", "≤ 5 ms", side.value <= 5)
    count = 1000 if whole else 160
    nights = Faults(night_of("smoke", "simulated", None, ()), range(1, count + 1)).tasks(lambda _: None)
    with here(WORKERS) as client:
        waited_for(client, WORKERS)
        by_campaign_s(nights[:4], client)
        sides: dict[str, Callable[[], float]] = {
            "campaign": partial(by_campaign_s, nights, client),
            "processes": partial(by_processes_s, count),
        }
        found = in_turn(sides)
    peer = Side(f"{WORKERS} processes without a campaign", "nothing is kept", found["processes"])
    what = f"{count} rehearsed nights with faults, by {WORKERS} workers"
    row = Row("P11", what, "s", Side("this program", DURABLE, found["campaign"]), (peer,), "", f"≥ {SHARE} ×", False)
    yield Row(**{**vars(row), "is_met": row.ratio(peer) >= SHARE})


def repeated(measured: Callable[[], float]) -> tuple[float, ...]:
    """The figure of each round, of one side alone."""
    return in_turn({"": measured})[""]


def by_campaign_s(tasks: Sequence[Task], client: Any) -> float:
    """Seconds for tasks in a new folder."""
    with tempfile.TemporaryDirectory() as folder, opened(Path(folder), digest_of(identity())) as ledger:
        began_s = time.perf_counter()
        carry_out(Given(tasks), ledger, client, lambda _: None)
        took_s = time.perf_counter() - began_s
        assert all(found is not None and found.is_finished for found in map(ledger.known, tasks))
    return took_s


def by_processes_s(nights: int) -> float:
    """Seconds for as many nights by two processes, from when both are ready to the last end."""
    words = [OWN.format(first=first, end=nights + 1, workers=WORKERS) for first in range(1, WORKERS + 1)]
    pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True, "cwd": ROOT}
    processes = [subprocess.Popen([sys.executable, "-c", each], **pipes) for each in words]
    for each in processes:
        assert line_of(each) == "ready\n"
    began_s = time.perf_counter()
    for each in processes:
        assert each.stdin is not None
        each.stdin.write("\n")
        each.stdin.flush()
    for each in processes:
        assert line_of(each) == "done\n"
    took_s = time.perf_counter() - began_s
    for each in processes:
        each.communicate()
    return took_s


def line_of(process: subprocess.Popen[str]) -> str:
    """The next line that a process prints."""
    assert process.stdout is not None
    return process.stdout.readline()


def waited_for(client: Any, count: int) -> None:
    """Wait until so many workers are there."""
    while len(workers_of(client)) < count:
        time.sleep(0.1)
