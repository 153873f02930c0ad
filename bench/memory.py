"""Memory of large arrays: kept by the C library for the next ones."""

from __future__ import annotations

KEPT_BYTES = 8 << 20  # far more than an array of a minute of frames


def keep_freed_memory() -> None:
    """Let the C library keep freed memory of this size in this process, instead of returning it to the system.

    The GNU C library keeps what is not larger than any mapping that was freed before (the dynamic threshold of
    mallopt(3)). Otherwise the system clears the pages of arrays of 0.3 MB each time: a tenth of a long night in virtual
    time, a third of its reduction.
    """
    bytes(KEPT_BYTES)  # freed at once, and never touched
