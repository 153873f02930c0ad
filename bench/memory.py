"""Memory of large arrays: kept by the C library for the next ones."""

from __future__ import annotations

KEPT_BYTES = 8 << 20  # far more than an array of a minute of frames


def keep_freed_memory() -> None:
    """Let the C library keep freed memory of this size in this process, instead of returning it to the system.

    The GNU C library returns freed arrays above a threshold, and raises the threshold to the size of each that it
    returns (mallopt(3), "dynamic mmap threshold"). Without this, every array of 0.3 MB gets new pages that the system
    has to clear: a tenth of the time of a long night in virtual time, a third of that of its reduction.
    """
    bytes(KEPT_BYTES)  # freed at once, and never touched
