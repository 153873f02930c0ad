"""Ctrl-C before a run: nothing is open yet, and the program ends at once.

KeyboardInterrupt may come where Python reports it and goes on, such as in a `__del__` or in a callback of an import:
the run would begin as if nobody had wished it to end. What a run makes of Ctrl-C is in `bench.runner.signals`.
"""

from __future__ import annotations

import os
import signal
from types import FrameType

from bench.cli.exits import ABORTED


def end_at_once() -> None:
    """From now on Ctrl-C ends the program, unless it is ignored."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)


def raise_again() -> None:
    """From now on Ctrl-C raises KeyboardInterrupt, unless it is ignored: something is open that is to be closed."""
    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _end(_number: int, _frame: FrameType | None) -> None:
    os.write(2, b"interrupted\n")
    os._exit(ABORTED)
