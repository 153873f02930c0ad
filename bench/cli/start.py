"""The entry point of `bench`: a program that cannot be imported does not end as a unit that failed, with 1."""

from __future__ import annotations

import sys
import traceback

from bench.cli.exits import BENCH_ERROR


def run() -> None:
    """Run the command line."""
    try:
        from bench.cli.main import run as command
    except (Exception, SystemExit):  # noqa: BLE001  whatever it is, the unit has not failed
        traceback.print_exc()
        sys.exit(BENCH_ERROR)
    command()
