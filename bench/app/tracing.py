"""Recording of the traffic on the wires of a bench, and of a bench that is only read."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from bench.app.devices import open_devices
from bench.app.faults import laboratory_of
from bench.app.request import load_bench_named
from bench.errors import InputError
from bench.files import make_folder, sync_folder
from bench.loop import AS_FAST_AS_POSSIBLE, REAL_TIME
from bench.loop import run as run_loop
from bench.rig import Rig
from bench.runner.held import address_lock, real_addresses
from drivers.errors import DriverError
from drivers.schema.bounded import read_bounded
from drivers.transport.trace import Passed, head_of, read_trace

TRACE_LIMIT_BYTES = 2**30
Keep = Callable[[Passed], object]


@contextmanager
def recording(path: Path, run: str | None = None) -> Iterator[Keep]:
    """Yield a sink for traffic, written to a new file that names the run. Raises InputError if it cannot be created.

    Lines are written as they arrive, and are durable at the end. A disk error meanwhile ends only the trace.
    """
    try:
        make_folder(path.parent)
        file = path.open("x", encoding="utf-8", buffering=1)
        file.write(head_of(run))
        sync_folder(path.parent)
    except OSError as problem:
        raise InputError(f"the trace {path} cannot be written: {problem.strerror}") from problem
    failed: OSError | None = None

    def keep(passed: Passed) -> None:
        nonlocal failed
        try:
            if failed is None:
                file.write(f"{passed.line()}\n")
        except OSError as problem:
            failed = problem

    try:
        yield keep
    finally:
        try:
            os.fsync(file.fileno())
            file.close()
        except OSError as problem:
            failed = failed or problem
        if failed is not None:
            sys.stderr.write(f"the trace {path} is incomplete: {failed.strerror}\n")


def read_trace_file(path: Path) -> list[Passed]:
    """Read the lines of a trace. Raises InputError."""
    try:
        return list(read_trace(read_bounded(path, TRACE_LIMIT_BYTES).decode("utf-8").splitlines()))
    except ValueError as problem:
        raise InputError(f"{path}: {problem}") from problem


def trace_bench(name: str | None, path: Path, for_s: float, *, simulate: bool = False) -> tuple[int, list[str]]:
    """Open a bench, read every instrument each second for `for_s`, and record all bytes.

    Return the number of lines, and the problems. Raises OpenError, InputError, and InUseError while another program
    talks to an instrument.
    """
    bench = load_bench_named(name, simulate=simulate).bench
    lines, problems = 0, []

    async def main(keep: Keep) -> None:
        async with Rig(open_devices(bench, laboratory_of(bench), keep)) as rig:
            loop = asyncio.get_running_loop()
            end_s = loop.time() + for_s
            while loop.time() < end_s:
                for device in rig.devices.values():
                    try:
                        await device.poll()
                    except DriverError as problem:
                        problems.append(str(problem))
                await asyncio.sleep(bench.monitor.period)

    with address_lock(real_addresses(bench).values(), "a trace"), recording(path) as keep:

        def counted(passed: Passed) -> None:
            nonlocal lines
            lines += 1
            keep(passed)

        run_loop(main(counted), AS_FAST_AS_POSSIBLE if bench.is_simulated else REAL_TIME)
    return lines, problems
