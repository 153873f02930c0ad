"""Entry point of `bench`: an import error must not exit with 1, which means that the unit failed."""

from __future__ import annotations

import gc
import sys
import traceback

from bench.cli.collection import uncollected
from bench.cli.exits import BENCH_ERROR


def run() -> None:
    """Run the command line."""
    try:
        with uncollected():
            from bench.cli.main import run as command
    except (Exception, SystemExit):  # noqa: BLE001  on any error: the unit has not failed
        traceback.print_exc()
        sys.exit(BENCH_ERROR)
    try:
        command()
    finally:
        gc.freeze()  # the interpreter would look for garbage once more, for up to 0.3 s
