"""Ending programs that hold the instruments of a bench, so that it can be made safe.

A process is addressed by its pidfd, so that a reused process number cannot hit another process.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial

from bench.rig import CLOSE_S, GRACE_S
from bench.runner.held import LOOKS, Kind, Owner, owners
from drivers.timing.awake import succeeded_within
from drivers.transport.address import Address

END_BEYOND_S = CLOSE_S + 3 * GRACE_S  # beyond the time in which a run that is ended makes its bench safe
DIE_WITHIN_S = 2.0
RELIEVED_WITHIN_S = 3.0  # time for a responsive guardian
_pause = threading.Event().wait


def take_over(addresses: Sequence[Address], notice: Callable[[str], object], end_within_s: float) -> None:
    """End the owners of the addresses with SIGTERM, on which a run makes its bench safe and records the reason.

    SIGKILL follows after `end_within_s`. A program of another user, or one that does not die, is left with a notice.
    Short readings of a chamber end by themselves.
    """
    for owner in owners(addresses):
        if owner.kind is Kind.VISIT:
            continue
        if owner.process in (0, os.getpid()):
            notice(f"{owner} has instruments of this bench and cannot be ended.")
            continue
        try:
            process = os.pidfd_open(owner.process)
        except ProcessLookupError:
            continue
        try:
            # still the owner, so the pidfd is of the right process
            if any(each.process == owner.process for each in owners(addresses)):
                _end(process, owner, partial(_has, addresses, owner), notice, end_within_s)
        except PermissionError:
            notice(
                f"{owner} has instruments of this bench and can still command them. This user may not end it: end it."
            )
        finally:
            os.close(process)


def end_supervision(addresses: Sequence[Address], notice: Callable[[str], object]) -> None:
    """End supervision of chambers at the addresses by other programs, on behalf of the run that now holds them."""
    for owner in owners(addresses, LOOKS):
        with suppress(ProcessLookupError, PermissionError):
            process = os.pidfd_open(owner.process)
            try:
                if owner in owners(addresses, LOOKS):
                    signal.pidfd_send_signal(process, signal.SIGTERM)
                    notice(f"{owner.words} hands the bench over.")
            finally:
                os.close(process)
    succeeded_within(lambda limit_s: not owners(addresses, LOOKS) or bool(_pause(limit_s)), RELIEVED_WITHIN_S)


def _end(
    process: int, owner: Owner, has: Callable[[], bool], notice: Callable[[str], object], end_within_s: float
) -> None:
    notice(f"Ending {owner}, which has instruments of this bench.")
    with suppress(ProcessLookupError):
        signal.pidfd_send_signal(process, signal.SIGTERM)
        if succeeded_within(lambda limit_s: _released(has, limit_s), end_within_s):
            return
        notice(f"{owner} did not release them within {end_within_s:g} s and is killed.")
        signal.pidfd_send_signal(process, signal.SIGKILL)
    if not succeeded_within(lambda limit_s: _released(has, limit_s), DIE_WITHIN_S):
        notice(f"{owner} does not end. It may still send commands to instruments of this bench.")


def _released(has: Callable[[], bool], limit_s: float) -> bool:
    return not has() or bool(_pause(limit_s))


def _has(addresses: Sequence[Address], owner: Owner) -> bool:
    return any(each.process == owner.process for each in owners(addresses))
