"""The supervising core: it waits for the death or the silence of a run's process. Nothing but the standard library.

Silence counts in ticks of this process: on a computer that stands still, or has too much else to do, the guardian does
not tick either, and nobody is taken for dead.
"""

from __future__ import annotations

import select
import signal
import socket
from contextlib import suppress

TICK_S = 0.25
LEASE_S = 10.0  # of silence, after which the run's process is killed
DIE_WITHIN_S = 5.0
LONGEST = 4096  # bytes of a message

ARMED, CANNOT, BEAT, OVER = b"armed", b"cannot ", b"beat", b"over"


def watch(link: socket.socket, runner: int, lease_s: float = LEASE_S) -> str | None:
    """Return why the bench must be made safe, as soon as it must; None when the run has said that it is over.

    `link` receives messages of the run; `runner` is the pidfd of its process, which is killed after `lease_s` without
    a message.
    """
    silent_s = 0.0
    while silent_s < lease_s:
        ready, _, _ = select.select([link.fileno(), runner], [], [], TICK_S)
        if link.fileno() in ready:
            message = _received(link)
            if message == OVER:
                return None
            if not message:
                return _gone(runner)
            silent_s = 0.0
        elif runner in ready:
            return "the process of the run has died"
        else:
            silent_s += TICK_S
    with suppress(ProcessLookupError):
        signal.pidfd_send_signal(runner, signal.SIGKILL)
    dead, _, _ = select.select([runner], [], [], DIE_WITHIN_S)
    was = f"the process of the run stood still for {lease_s:g} s and was killed"
    return was if dead else f"{was}, but does not end: it may still write"


def _received(link: socket.socket) -> bytes:
    try:
        return link.recv(LONGEST)
    except OSError:
        return b""


def _gone(runner: int) -> str:
    """Why a run's end of the link is closed: the kernel closes it some time before a process has ended."""
    ended, _, _ = select.select([runner], [], [], DIE_WITHIN_S)
    return (
        "the process of the run has died"
        if ended
        else "the run has closed the link to its guardian, and its process goes on"
    )
