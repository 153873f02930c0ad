"""What an hour of a long run costs in virtual time, beside a bare loop that wakes up as often, at 10 and at 100 Hz.

Six channels; an hour in which nothing is recorded, one recorded at rest, one recorded while the table turns. The times
are processor time of all threads, which other programs on the machine change less than the time on the wall.
"""

from __future__ import annotations

import asyncio
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any
from unittest.mock import patch

from bench import loop as virtual
from bench.loop import AS_FAST_AS_POSSIBLE
from bench.store.reader import RunReader
from bench.store.runs import find_run
from benchmarks.cost import peak_mb
from benchmarks.timed_run import CONFIG, timed_run

HOUR_S = 3600.0
NEEDS = "needs: {outer: rate_table, counter: pulse_counter}"
WAITING = "  - wait: 1 h"
AT_REST = "  - {acquire: counter, for: 1 h, label: hour}"
TURNING = """\
  - rotate: outer
    at: 5 °/s
    during:
      - {acquire: counter, turns: 50, of: outer, label: hour}"""


def run_hour(folder: Path, bench: Path, title: str, steps: str) -> tuple[float, int]:
    """Processor seconds and turns of the loop of a run, without its start and its report."""
    path = folder / f"{title.replace(' ', '_')}.yaml"
    path.write_text(f"schema: itb-sequence/1\ntitle: An hour {title}\n{NEEDS}\nsteps:\n{steps}\n", "utf-8")
    selector = virtual._VirtualSelector  # noqa: SLF001  whose every call is a turn of the loop
    plain_select, turns = selector.select, 0

    def counted(*given: Any, **named: Any) -> Any:
        nonlocal turns
        turns += 1
        return plain_select(*given, **named)

    with patch.object(selector, "select", counted):
        return timed_run(path, bench, folder / "runs").cpu_s, turns


def bare_s(turns: int) -> float:
    """Processor seconds of a loop that does nothing but wake up, two turns each time."""

    async def main() -> None:
        for _ in range(turns // 2):
            await asyncio.sleep(1.0)

    began_s = time.process_time()
    virtual.run(main(), AS_FAST_AS_POSSIBLE)
    return time.process_time() - began_s


def read_back_s(runs: Path) -> tuple[float, int]:
    """Processor seconds in which the frames of the last run are read and unpacked, and how many there are."""
    with RunReader(find_run("last", runs)) as reader:
        began_s = time.process_time()
        frames = sum(len(block) for _, _, block in reader.blocks())
        return time.process_time() - began_s, frames


def main() -> None:
    """A line for each kind of hour at each rate."""
    print(f"{'an hour':<20}{'CPU s':>8}{'times real':>12}{'turns/s':>9}{'bare CPU s':>12}{'ratio':>7}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(CONFIG, folder / "config")
        for period, rate in (("100 ms", "10 Hz"), ("10 ms", "100 Hz")):
            bench = folder / "config" / f"at_{rate.partition(' ')[0]}.yaml"
            bench.write_text((CONFIG / "imu.yaml").read_text("utf-8").replace("period: 100 ms", f"period: {period}"))
            empty_s, few = run_hour(folder, bench, "of nothing", "  - note: Nothing.")
            for title, steps in (("waiting", WAITING), ("at rest", AT_REST), ("turning", TURNING)):
                whole_s, turns = run_hour(folder, bench, title, steps)
                cpu_s, turns = whole_s - empty_s, turns - few
                bare = bare_s(turns)
                print(
                    f"{f'{title}, {rate}':<20}{cpu_s:>8.2f}{HOUR_S / cpu_s:>12.0f}{turns / HOUR_S:>9.1f}"
                    f"{bare:>12.2f}{cpu_s / bare:>7.1f}"
                )
        unpack_s, frames = read_back_s(folder / "runs")
    print(f"its frames are read back at {frames / unpack_s / 1e6:.1f} million a CPU second")
    print(f"peak memory {peak_mb():.0f} MB")


if __name__ == "__main__":
    main()
