"""Duration of motions of the axes, from rates and accelerations in the bench file."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, Literal

from bench.sequence.steps.stimulus import Oscillate, Rotate
from drivers.capabilities import Approach

SEEN_AFTER_S = 0.1  # from the arrival of an axis until it is detected
USUAL_RATE_DPS, USUAL_ACCELERATION_DPS2 = 20.0, 40.0  # for an axis whose driver has no such options
REST_S = 0.6  # before a table rotates or oscillates after another motion
SINE_GROWS_S, SINE_GROWS_PERIODS = 2.0, 4.0  # until a sine reaches its amplitude: the longer of both
Side = Literal["below", "above", "stood"]
"""Side from which an axis comes; none if nothing moves it."""
_SIDES = {"direct": 0.0, "from_below": -1.0, "from_above": 1.0}


def travel_s(way_deg: float, rate_dps: float, acceleration_dps2: float) -> float:
    """Time of a movement from rest to rest: trapezoidal rate profile, triangular for short distances."""
    ramp_s = min(rate_dps / acceleration_dps2, math.sqrt(abs(way_deg) / acceleration_dps2))
    return abs(way_deg) / (ramp_s * acceleration_dps2) + ramp_s if way_deg else 0.0


def way_s(approach: Approach, from_deg: float, target_deg: float, options: Any) -> float:
    """Time for an axis with these driver options to settle at an angle.

    An approach overshoots the angle only if the axis does not already come from that side. An axis turned by hand takes
    its `turn_time`, unless it is there already.
    """
    if (hand_s := getattr(options, "turn_time", None)) is not None:
        return float(hand_s) if approach != "direct" or from_deg != target_deg else 0.0
    legs_deg = [there - here for here, there in pairwise(corners_deg(approach, from_deg, target_deg, options))]
    return math.fsum(_leg_s(leg_deg, options) for leg_deg in legs_deg) + _hold_s(options)


def corners_deg(approach: Approach, from_deg: float, target_deg: float, options: Any) -> list[float]:
    """Angles at which the path of an axis begins, reverses and ends."""
    side = _SIDES[approach]
    begin_deg = target_deg + side * getattr(options, "approach_distance", 0.0)
    return [from_deg, begin_deg, target_deg] if (from_deg - begin_deg) * side < 0 else [from_deg, target_deg]


def came_from(approach: Approach, from_deg: float | None, target_deg: float) -> Side | None:
    """Side from which an axis comes to its angle; None if its start is unknown."""
    if approach != "direct":
        return "below" if approach == "from_below" else "above"
    if from_deg is None:
        return None
    if from_deg == target_deg:
        return "stood"
    return "below" if from_deg < target_deg else "above"


def rate_change_s(step: Rotate, options: Any) -> float:
    """Time for a table to reach the rate of a step, and to stop."""
    return abs(step.rate_dps) / (step.acceleration_dps2 or _acceleration_dps2(options))


def oscillation_s(step: Oscillate, options: Any) -> float:
    """Duration of an oscillation of an axis with these driver options.

    Each frequency of a sweep begins with a rest and a growing sine; the table returns in between.
    """
    growing_s = math.fsum(REST_S + max(SINE_GROWS_S, SINE_GROWS_PERIODS / each) for each in step.frequencies_hz)
    back_s = REST_S + _leg_s(step.amplitude_deg, options) + _hold_s(options)
    returns = len(step.frequencies_hz) - 1
    return step.least_s + growing_s + (returns * back_s if returns else 0.0)


def _leg_s(way_deg: float, options: Any) -> float:
    return travel_s(way_deg, getattr(options, "rate", USUAL_RATE_DPS), _acceleration_dps2(options)) + SEEN_AFTER_S


def _hold_s(options: Any) -> float:
    """Time for which an axis must be at rest to count as settled."""
    hold_s: float = getattr(getattr(options, "settle", None), "hold", 0.0)
    return hold_s


def _acceleration_dps2(options: Any) -> float:
    acceleration_dps2: float = getattr(options, "acceleration", USUAL_ACCELERATION_DPS2)
    return acceleration_dps2
