"""What a campaign costs a task, and how fast two workers are beside two processes without a campaign.

Tasks without work are done by one worker, each kept on the disk. Nights with faults are then done by two workers, and
by two processes that have half of them each, in turn: what else the computer does is the same for both.

    python -m benchmarks.campaign_overhead [--nights 60] [--rounds 3]
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

from bench.campaign.carry_out import carry_out, workers_of
from bench.campaign.cluster import here
from bench.campaign.ledger import opened
from bench.campaign.nights import Faults, night_of
from bench.campaign.program import digest_of, identity
from bench.campaign.tasks import Task
from tests.support.campaign_tasks import Given

ROOT = Path(__file__).parents[1]
EMPTY = 2000
OWN = """
import sys, time
from bench.campaign.nights import Faults, night_of, play
tasks = Faults(night_of("smoke", "simulated", None, ()), range({first}, {end}, 2)).tasks(None)
play(**tasks[0].arguments)
print("ready", flush=True)
sys.stdin.readline()
before_s = time.process_time()
for task in tasks:
    play(**task.arguments)
print(time.process_time() - before_s, flush=True)
"""


def by_campaign_s(tasks: Sequence[Task], client: Any) -> float:
    """Seconds for tasks in a new folder."""
    with tempfile.TemporaryDirectory() as folder, opened(Path(folder), digest_of(identity())) as ledger:
        began_s = time.perf_counter()
        carry_out(Given(tasks), ledger, client, lambda _: None)
        took_s = time.perf_counter() - began_s
        assert all(ledger.known(task).is_finished for task in tasks)
    return took_s


def with_cpu_s(tasks: Sequence[Task], client: Any) -> tuple[float, float]:
    """The same, and processor seconds of this process with its scheduler and of the workers."""
    before_s = cpu_s(client)
    took_s = by_campaign_s(tasks, client)
    return took_s, cpu_s(client) - before_s


def cpu_s(client: Any) -> float:
    of_workers = client.run(time.process_time)
    return time.process_time() + sum(of_workers.values())


def by_processes_s(nights: int) -> tuple[float, float]:
    """Seconds and processor seconds for as many nights by two processes, from when both are ready to the last end."""
    words = [[sys.executable, "-c", OWN.format(first=first, end=nights + 1)] for first in (1, 2)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True, "cwd": ROOT}
    both = [subprocess.Popen(each, **pipes) for each in words]
    for each in both:
        assert each.stdout.readline() == "ready\n"
    began_s = time.perf_counter()
    for each in both:
        each.stdin.write("\n")
        each.stdin.flush()
    used_s = sum(float(each.stdout.readline()) for each in both)
    took_s = time.perf_counter() - began_s
    for each in both:
        each.communicate()
    return took_s, used_s


def waited_for(client: Any, count: int) -> None:
    """Wait until so many workers are there."""
    while len(workers_of(client)) < count:
        time.sleep(0.1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nights", type=int, default=60)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    empty = [Task(f"{number}", "tests.support.campaign_tasks:nothing", {}) for number in range(EMPTY)]
    with here(1) as client:
        waited_for(client, 1)
        by_campaign_s(empty[:50], client)
        rounds = [with_cpu_s(empty, client) for _ in range(options.rounds)]
    each_s, cpu_s = (min(each) / EMPTY for each in zip(*rounds, strict=True))
    print(f"a task without work, kept on the disk: {1000 * each_s:.2f} ms, {1000 * cpu_s:.2f} ms of processor time")
    nights = Faults(night_of("smoke", "simulated", None, ()), range(1, options.nights + 1)).tasks(lambda _: None)
    rows = []
    with here(2) as client:
        waited_for(client, 2)
        by_campaign_s(nights[:4], client)
        for _ in range(options.rounds):
            rows.append((*with_cpu_s(nights, client), *by_processes_s(options.nights)))
            ours_s, our_cpu_s, own_s, own_cpu_s = rows[-1]
            print(
                f"{options.nights} nights: {ours_s:.2f} s by two workers, {own_s:.2f} s by two processes; processors "
                f"{our_cpu_s:.2f} s and {own_cpu_s:.2f} s",
                flush=True,
            )
    for what, at in (("speed", 0), ("processor time, inverse", 1)):
        print(f"two workers over two processes, {what}: {median(row[at + 2] / row[at] for row in rows):.3f}")


if __name__ == "__main__":
    main()
