"""State of a run sent to its guardian in every heartbeat, and whether the guardian takes them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

NO_GUARDIAN, GUARDIAN_OK, GUARDIAN_LATE = "none", "ok", "late"


def _no() -> bool:
    return False


@dataclass
class Pulse:
    """Heartbeat data: poll count of each polled device, and whether chambers may be held if the process is lost now.

    `may_be_held` are the chambers for which the bench file and the guardian permit it. The run sets the other fields.
    `guardian` is NO_GUARDIAN, ok, or late while it takes no heartbeat.
    """

    may_be_held: Collection[str] = ()
    polls: Mapping[str, int] = field(default_factory=dict)
    may_hold: Callable[[], bool] = _no
    guardian: str = NO_GUARDIAN
