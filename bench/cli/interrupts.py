"""Ctrl-C before a run: nothing is open yet, and the program ends at once.

Python may report and discard a KeyboardInterrupt, for example in a `__del__` or in a callback of an import; the run
would then start although a person wanted it to end. Ctrl-C during a run is handled by `bench.runner.signals`.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from bench.cli.exits import ABORTED


def end_at_once() -> None:
    """Install a handler of Ctrl-C that ends the program, unless Ctrl-C is ignored."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)


def raise_again() -> None:
    """Install a handler of Ctrl-C, unless ignored, that raises KeyboardInterrupt, so that open resources are closed."""
    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@contextmanager
def terminated_as_interrupted() -> Iterator[None]:
    """Let SIGTERM raise KeyboardInterrupt in the block, as Ctrl-C does; no effect outside the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _end(_number: int, _frame: FrameType | None) -> None:
    os.write(2, b"interrupted\n")
    os._exit(ABORTED)
