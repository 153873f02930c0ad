"""A worker of a cluster of one computer, as a program; it ends with the process that has started it."""

from __future__ import annotations

import asyncio
import gc
import json
import logging
import os
import signal
import sys
import threading
from collections.abc import Mapping
from typing import Any


def main() -> None:
    """Work for the scheduler in the JSON line on standard input until that is closed."""
    given = json.loads(sys.stdin.readline())
    threading.Thread(target=_end_with_starter, daemon=True).start()
    asyncio.run(_work(given))


async def _work(given: Mapping[str, Any]) -> None:
    import dask

    import bench.campaign.work  # noqa: F401  imported while the worker starts, not during its first task
    from bench.campaign.cluster import dask_distributed

    distributed = dask_distributed()
    logging.disable(logging.ERROR)  # the campaign tells what has happened
    gc.freeze()
    with dask.config.set(given["config"]):
        async with distributed.Worker(
            given["scheduler"], name=given["name"], nthreads=1, memory_limit=0, host="127.0.0.1", protocol="tls://",
            security=distributed.Security(**given["security"]), local_directory=given["folder"], dashboard=False,
            dashboard_address="127.0.0.1:0",
        ) as worker:  # fmt: skip
            await worker.finished()


def _end_with_starter() -> None:
    sys.stdin.buffer.read()
    os.killpg(0, signal.SIGKILL)  # with the processes of its task


if __name__ == "__main__":
    main()
