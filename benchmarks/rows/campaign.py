"""P11: what a campaign costs, beside processes that do the same nights without one."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
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
from campaigns.kinds import truth
from campaigns.truth.cells import RECORDS
from tests.support.campaign_tasks import Given

ROOT = Path(__file__).parents[2]
WORKERS = 2
EMPTY = 500
SHARE = 0.95
DURABLE = "each result synced"
OWN = """
import json, sys
from drivers.installed import loaded
for line in sys.stdin:
    for does, arguments in json.loads(line):
        loaded(does)(**arguments)
    print("done", flush=True)
"""
SEEDS_OF_A_TASK = 5


def measure(whole: bool) -> Iterator[Row]:
    """Milliseconds of a task without work, and seconds of nights compared with their truth, and of rehearsals."""
    with here(1) as client:
        waited_for(client, 1)
        empty = [Task(f"{number}", "tests.support.campaign_tasks:nothing", {}) for number in range(EMPTY)]
        by_campaign_s(empty[:50], client)
        each_ms = tuple(took_s / EMPTY * 1e3 for took_s in repeated(partial(by_campaign_s, empty, client)))
    side = Side("this program", DURABLE, each_ms)
    yield Row("P11", "a task without work, kept on the disk", "ms", side, (), "", "≤ 5 ms", side.value <= 5)
    nights, rehearsals = (1000, 1000) if whole else (40, 160)
    what = f"{nights} nights of M4a by seed, compared with their truth, by {WORKERS} workers"
    beside = _beside(nights_of_truth(nights), what)
    yield replace(beside, goal=f"≥ {SHARE} ×", is_met=beside.ratio(beside.peers[0]) >= SHARE)
    small = Faults(night_of("smoke", "simulated", None, ()), range(WORKERS + rehearsals)).tasks(lambda _: None)
    yield _beside(small, f"{rehearsals} rehearsals with faults, of 0.1 s each, by {WORKERS} workers")


def nights_of_truth(count: int) -> list[Task]:
    """So many nights by seed in tasks of a few, and one for each worker to begin with, which records a night first."""
    campaign = truth.campaign(
        parts=[truth.CELLS], methods=["M4a"], kinds=["as shipped"], forms=["normal"], levels=[RECORDS],
        seeds=count + WORKERS * SEEDS_OF_A_TASK, decide=0, block=SEEDS_OF_A_TASK, figures=False,
    )  # fmt: skip
    return list(campaign.tasks(lambda _: None))


def _beside(tasks: Sequence[Task], what: str) -> Row:
    """The first task of each worker done, then the others, by a campaign and by processes of their own."""
    first, others = tasks[:WORKERS], tasks[WORKERS:]
    with here(WORKERS) as client, own_processes() as processes:
        waited_for(client, WORKERS)
        by_campaign_s(first, client)
        by_processes_s(first, processes)
        sides: dict[str, Callable[[], float]] = {
            "campaign": partial(by_campaign_s, others, client),
            "processes": partial(by_processes_s, others, processes),
        }
        found = in_turn(sides)
    peer = Side(f"{WORKERS} processes without a campaign", "nothing is kept", found["processes"])
    return Row("P11", what, "s", Side("this program", DURABLE, found["campaign"]), (peer,), "", "", True)


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


@contextmanager
def own_processes() -> Iterator[Sequence[subprocess.Popen[str]]]:
    """Processes that do tasks given as lines."""
    pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True, "cwd": ROOT}
    processes = [subprocess.Popen([sys.executable, "-c", OWN], **pipes) for _ in range(WORKERS)]
    try:
        yield processes
    finally:
        for each in processes:
            each.communicate()


def by_processes_s(tasks: Sequence[Task], processes: Sequence[subprocess.Popen[str]]) -> float:
    """Seconds for tasks by processes that divide them, until the last end."""
    began_s = time.perf_counter()
    for number, each in enumerate(processes):
        assert each.stdin is not None
        share = [(task.does, dict(task.arguments)) for task in tasks[number :: len(processes)]]
        each.stdin.write(f"{json.dumps(share)}\n")
        each.stdin.flush()
    for each in processes:
        assert each.stdout is not None
        assert each.stdout.readline() == "done\n"
    return time.perf_counter() - began_s


def waited_for(client: Any, count: int) -> None:
    """Wait until so many workers are there."""
    while len(workers_of(client)) < count:
        time.sleep(0.1)
