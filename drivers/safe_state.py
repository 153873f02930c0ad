"""Description of making a device safe, with its time limit; known without importing the driver."""

from __future__ import annotations

from typing import NamedTuple

DIALOGUE_S = 5.0  # for reconnecting, identifying, commanding, and reading back
LONGEST_S = 30.0  # limit for the bench file


class SafeState(NamedTuple):
    """Description of `make_safe`, and the time limit (s) on a connected device.

    Empty `words` mean that there is nothing to make safe. `alone_after_s` is the time after which the device becomes
    safe by itself without communication; None if it does not. `hold_s` is the time for which a guardian may delay it
    after a failed run.
    """

    words: str
    within_s: float
    alone_after_s: float | None = None
    hold_s: float = 0.0


NOTHING = SafeState("", DIALOGUE_S)
ZERO_THEN_OFF = SafeState("0 A, then off", DIALOGUE_S)
NOT_DESCRIBED = SafeState("as its driver does it", 2 * DIALOGUE_S)


def at_rest(fastest_dps: float, deceleration_dps2: float) -> SafeState:
    """Safe state of an axis that stops, from its maximum rate, and holds."""
    return SafeState("at rest where it is", fastest_dps / deceleration_dps2 + DIALOGUE_S)
