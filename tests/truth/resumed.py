"""Runs that were killed and resumed against the simulated truth: `python -m tests.truth.resumed --seeds 40`.

They are killed at a moment drawn from their seed, and meet the bars of runs that nobody disturbs.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
from multiprocessing import Pool
from pathlib import Path

from bench.app.request import RunRequest, prepare
from tests.support.killed import interrupted, resumed
from tests.truth import judge
from tests.truth.campaign import compare, full_bench

SEQUENCE, PRESET = "tumble_static", "quick"


def killed_and_resumed(folder: Path, seed: int) -> Path:
    """The directory of a run that came to its end after an interruption."""
    bench = full_bench(folder / f"config{seed}")
    request = RunRequest(SEQUENCE, bench=str(bench), preset=PRESET, seed=seed)
    at_s = random.Random(seed).random() * prepare(request).expected.total_s
    path = interrupted(folder / f"runs{seed}", at_s, SEQUENCE, bench, preset=PRESET, seed=seed)
    result = resumed(path)
    assert result.outcome.how == "completed", result.problems
    return path


def main() -> int:
    """Exit status 1 when a bar is not met."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary, Pool(options.processes, maxtasksperchild=4) as pool:
        wishes = [(Path(temporary), seed) for seed in range(1, options.seeds + 1)]
        comparisons = compare(pool.starmap(killed_and_resumed, wishes, chunksize=1))
    print("\n".join(judge.table(comparisons)))
    problems = list(judge.beyond(judge.by_quantity(comparisons), "full"))
    for problem in problems:
        print(problem)
    print("resumed runs: " + ("FAILED" if problems else "ok"))
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
