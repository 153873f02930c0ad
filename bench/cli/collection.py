"""When garbage is collected: not while a command loads its modules and files, almost all of which stay."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def uncollected() -> Iterator[None]:
    """Disable garbage collection in the block; it would take a fifth of the time of a short command."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()  # exclude these objects from later collections, at the latest that at exit
        gc.enable()
