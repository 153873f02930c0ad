"""Work in a child, in a namespace of processes that ends with it: tests of a mutant may kill or leave any process."""

from __future__ import annotations

import ctypes
import os
import select
import signal
import sys
import traceback
from collections.abc import Callable

NEW_PROCESSES, NEW_MOUNTS = 0x20000000, 0x00020000
PRIVATE = 0x44000  # MS_REC | MS_PRIVATE
TIMED_OUT, BROKEN = 124, 125
_libc = ctypes.CDLL(None, use_errno=True)


def contained(work: Callable[[], int], limit_s: float) -> int:
    """Return what `work` returns, at most 123; TIMED_OUT if it does not end, BROKEN if it raises or cannot begin."""
    return _in_child(lambda: _hold(work, limit_s))


def _hold(work: Callable[[], int], limit_s: float) -> int:
    if _libc.unshare(NEW_PROCESSES | NEW_MOUNTS):
        return BROKEN
    if not (init := os.fork()):
        _libc.mount(b"none", b"/", None, PRIVATE, None)
        _libc.mount(b"proc", b"/proc", b"proc", 0, None)
        os._exit(_in_child(work))  # the end of the first process is that of all
    ended, _, _ = select.select([os.pidfd_open(init)], [], [], limit_s)
    if not ended:
        os.kill(init, signal.SIGKILL)
    _, status = os.waitpid(init, 0)
    return os.waitstatus_to_exitcode(status) if ended else TIMED_OUT


def _in_child(work: Callable[[], int]) -> int:
    """Return the result of `work` in a child; orphans that the first process of a namespace adopts are reaped."""
    if not (child := os.fork()):
        status = BROKEN
        try:
            status = work()
        except BaseException:  # noqa: BLE001  the child has no caller
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(status)
    while True:
        ended, status = os.wait()
        if ended == child:
            return os.waitstatus_to_exitcode(status) % 256
