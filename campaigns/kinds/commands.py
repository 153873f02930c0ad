"""Commands of the campaigns as tasks of `bench campaign`: each is done by one worker, in one process."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence

from bench.campaign.program import ROOT
from bench.campaign.tasks import Known, Task
from campaigns.night import ENVIRONMENT

KEPT_LINES = 400  # of what a command prints


def task_of(name: str, words: str) -> Task:
    """The task of a command, "truth.imu --seeds 40"."""
    return Task(f"command {name}", "campaigns.kinds.commands:run", {"words": words.split()}, sort=name)


def run(words: Sequence[str]) -> Mapping[str, object]:
    """Run a command; its exit status, 0 or 1, and what it printed. RuntimeError when it could not come to that."""
    module, *options = words
    done = subprocess.run(
        [sys.executable, "-m", f"campaigns.{module}", *options], cwd=ROOT, text=True, check=False,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
        env={**os.environ, **ENVIRONMENT, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    printed = done.stdout.splitlines()[-KEPT_LINES:]
    if done.returncode not in (0, 1) or any(line.startswith("Traceback ") for line in printed):
        raise RuntimeError(f"ended with {done.returncode}: {' '.join(printed[-3:])}")
    return {"status": done.returncode, "printed": printed}


def lines(tasks: Sequence[Task], known: Known) -> Iterator[str]:
    """What the commands printed."""
    for task in tasks:
        result = known(task)
        if result is not None and result.is_finished:
            yield from (
                "",
                f"{task.key}: {'ok' if result.content['status'] == 0 else 'FAILED'}",
                *result.content["printed"],
            )


def failed(tasks: Sequence[Task], known: Known) -> bool:
    """True if one has failed."""
    found = [result for task in tasks if (result := known(task)) is not None and result.is_finished]
    return any(result.content["status"] != 0 for result in found)
