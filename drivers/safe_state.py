"""What making a device safe does, in words, and how long it may take; known without importing the driver."""

from __future__ import annotations

from typing import NamedTuple

DIALOGUE_S = 5.0  # to open a line anew, identify, command, and read back
LONGEST_S = 30.0  # no bench file may give a device longer


class SafeState(NamedTuple):
    """What `make_safe` does, in words, and the time (s) within which it ends on a connected device.

    Without words there is nothing to make safe. `alone_after_s` is when it becomes safe by itself if nothing is said to
    it any more; None where it does not. `hold_s` is for how long a guardian may keep it as it is before, after a run
    that failed.
    """

    words: str
    within_s: float
    alone_after_s: float | None = None
    hold_s: float = 0.0


NOTHING = SafeState("", DIALOGUE_S)
ZERO_THEN_OFF = SafeState("0 A, then off", DIALOGUE_S)
NOT_DESCRIBED = SafeState("as its driver does it", 2 * DIALOGUE_S)


def at_rest(fastest_dps: float, deceleration_dps2: float) -> SafeState:
    """Of an axis that stops, from its fastest rate, and stays where it is."""
    return SafeState("at rest where it is", fastest_dps / deceleration_dps2 + DIALOGUE_S)
