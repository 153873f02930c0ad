"""Where the time of a simulated bench second goes: `make profile`.

Runs a sequence twice, the quick tumble unless another is named, once to take the time and once under the profiler,
whose shares are then put on the time taken. Categories by file: physics (the world), wires (drivers, simulated
instruments, transports, pymodbus), store, loop (asyncio), engine (everything else).
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import tempfile
import time
from collections import defaultdict
from pathlib import Path

from bench.app import execute as executing
from bench.app.request import RunRequest, prepare
from bench.runner.quiet import Quiet
from benchmarks.cost import peak_mb

PHYSICS = (
    "simulators/world", "simulators/thermal", "simulators/uut", "simulators/motion", "simulators/can_counter",
    "simulators/imu", "simulators/gyro", "simulators/attitude",
)  # fmt: skip
WIRES = ("drivers/", "simulators/", "pymodbus/", "bench/app/laboratory", "struct")
STORE = ("bench/store", "sqlite", "zlib", "threading")
LOOP = ("asyncio/", "bench/loop", "selectors", "heapq", "_asyncio", "_contextvars")
BUDGET_US = {"physics": 110, "wires": 90, "store": 30, "engine": 80}


def category(place: tuple[str, int, str]) -> str:
    name = f"{place[0]} {place[2]}".replace("\\", "/")
    for label, marks in (("physics", PHYSICS), ("wires", WIRES), ("store", STORE), ("loop", LOOP)):
        if any(mark in name for mark in marks):
            return label
    return "numpy" if "numpy" in name or "ufunc" in name else "engine"


def run_once(request: RunRequest, profiler: cProfile.Profile | None = None) -> tuple[float, float]:
    """Bench seconds and real seconds of the run itself, without start-up and report."""
    measured = {}
    plain = executing.run_loop

    def timed(main, *how):
        began = time.perf_counter()
        if profiler is not None:
            profiler.enable()
        try:
            return plain(main, *how)
        finally:
            if profiler is not None:
                profiler.disable()
            measured["wall_s"] = time.perf_counter() - began

    executing.run_loop = timed
    try:
        result = executing.execute(prepare(request), Quiet())
    finally:
        executing.run_loop = plain
    return result.bench_s, measured["wall_s"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sequence", nargs="?", default="tumble_static")
    parser.add_argument("--bench", default=None)
    parser.add_argument("--preset", default="quick")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        request = RunRequest(given.sequence, bench=given.bench, preset=given.preset or None, runs=Path(folder))
        bench_s, wall_s = run_once(request)
        profiler = cProfile.Profile()
        run_once(request, profiler)
    own: dict[str, float] = defaultdict(float)
    for place, (_, _, own_s, _, _) in pstats.Stats(profiler).stats.items():
        own[category(place)] += own_s
    total = sum(own.values())
    print(f"{bench_s:.0f} s of bench time in {wall_s:.1f} s: {bench_s / wall_s:.0f} times real time")
    print(f"{'a bench second costs':<22}{1e6 * wall_s / bench_s:>8.0f} µs   (budget {sum(BUDGET_US.values())} µs)")
    for label, seconds in sorted(own.items(), key=lambda item: -item[1]):
        budget = f"   (budget {BUDGET_US[label]} µs)" if label in BUDGET_US else ""
        print(f"  {label:<20}{1e6 * wall_s / bench_s * seconds / total:>8.0f} µs{budget}")
    print(f"peak memory {peak_mb():.0f} MB")


if __name__ == "__main__":
    main()
