"""What a run shows its guardian in every beat."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field


def _no() -> bool:
    return False


@dataclass
class Pulse:
    """How often each device was polled, while it is; whether chambers may be held if the process is lost now.

    `may_be_held` are the chambers for which the bench file and the guardian allow that. The run fills in the rest.
    """

    may_be_held: Collection[str] = ()
    polls: Mapping[str, int] = field(default_factory=dict)
    may_hold: Callable[[], bool] = _no
