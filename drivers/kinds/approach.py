"""Approach of an angle from one side, and hold time; no I/O."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.values import Approach

ARCSEC_PER_DEG = 3600
DEVIATION_BANDS = 10  # a larger deviation, in bands, is no scatter: there was an interference
FAR_AWAY_POLL_S = 0.5  # interval of polls while the end of a move is far away
_SIDES: Mapping[Approach, int] = {"direct": 0, "from_below": -1, "from_above": 1}


def begin_of(target_deg: float, approach: Approach, distance_deg: float) -> float:
    """Angle where an approach begins: the target itself for a direct one."""
    return target_deg + _SIDES[approach] * distance_deg


def legs(start_deg: float, begin_deg: float, target_deg: float, hold_s: float) -> list[tuple[float, float]]:
    """Angles of the legs with their hold times: first the beginning of the approach, unless it is on the way."""
    detour = (start_deg - begin_deg) * (target_deg - begin_deg) > 0
    return [(begin_deg, 0.0)] * detour + [(target_deg, hold_s)]


def pause_s(poll_s: float, left_s: float) -> float:
    """Pause before the next poll of a move with about `left_s` to go; never less than `poll_s`."""
    return max(poll_s, min(left_s / 2, FAR_AWAY_POLL_S))


class Hold:
    """Timer of a hold condition, from poll to poll."""

    def __init__(self, hold_s: float) -> None:
        self._hold_s = hold_s
        self._since_s: float | None = None

    def is_over(self, at_s: float, *, fulfilled: bool) -> bool:
        """Return whether the condition has held for the required time, given its value at a time."""
        if not fulfilled:
            self._since_s = None
            return False
        if self._since_s is None:
            self._since_s = at_s
        return at_s - self._since_s >= self._hold_s
