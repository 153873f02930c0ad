"""A charge-balancing converter: from charge to counts of + and - pulses (equations 8.5)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Counts = NDArray[np.int64]
TURNS_OF_EXTREME = 8


class Integrator:
    """A signed charge integrator with + and - thresholds; fractions of a pulse are carried exactly."""

    def __init__(self, residue: float, positive: int, negative: int) -> None:
        self._residue = residue
        self.positive, self.negative = positive, negative

    def count(self, pulses: Array) -> tuple[Counts, Counts]:
        """Cumulative + and - counts after each of the consecutive increments of charge (n,), in pulses."""
        if not len(pulses):
            return np.empty(0, np.int64), np.empty(0, np.int64)
        charge = pulses.cumsum()
        charge += self._residue
        up, down = _fired(pulses, charge)
        self._residue = float(charge[-1]) - int(up[-1] - down[-1])
        up += self.positive
        down += self.negative
        self.positive, self.negative = int(up[-1]), int(down[-1])
        return up, down

    def count_through_turns(self, pulses: Array) -> tuple[Counts, Counts]:
        """The same for increments (n,) over equal times between which the charge may reverse.

        It first goes to its extreme, found by the quartic through five latches.
        """
        into, first = _extremes(pulses)
        single = np.flatnonzero(np.diff(into, prepend=-1) > 0)
        into, first = into[single], first[single]
        rest = pulses.copy()
        rest[into] -= first
        latches = np.arange(len(pulses)) + np.searchsorted(into, np.arange(len(pulses)), side="right")
        positive, negative = self.count(np.insert(rest, into, first))
        return positive[latches], negative[latches]


def _extremes(pulses: Array) -> tuple[Counts, Array]:
    """Increments, of (n,), with a reversal of the charge, and the extreme reached in each.

    From the quartic through the five latches around each reversal: a parabola through three would have an error of 4e-4
    for a sine of ten latches per period. Beyond both ends constant increments are assumed.
    """
    if len(pulses) < 2:
        return np.empty(0, np.int64), np.empty(0)
    turns = np.flatnonzero(pulses[:-1] * pulses[1:] < 0)
    ends = 2 * pulses[0] - pulses[1], 2 * pulses[-1] - pulses[-2]
    one, two, three, four = (np.concatenate([ends[:1], pulses, ends[1:]])[turns + k] for k in range(4))
    slope, bend = (7 * (two + three) - one - four) / 12, (15 * (three - two) - (four - one)) / 24
    cubic, quartic = (one + four - two - three) / 12, (four - one - 3 * (three - two)) / 24
    at = np.zeros_like(two)  # position of the extreme, from the middle latch, in intervals
    for _ in range(TURNS_OF_EXTREME):
        speed = slope + at * (2 * bend + at * (3 * cubic + at * 4 * quartic))
        at = np.clip(at + speed / (two - three), -1.0, 1.0)
    extreme = at * (slope + at * (bend + at * (cubic + at * quartic)))
    later = at > 0
    return turns + later, np.where(later, extreme, two + extreme)


def _fired(pulses: Array, charge: Array) -> tuple[Counts, Counts]:
    """+ and - counts after each of the increments of a charge (n,); initially no pulses."""
    if pulses.min() >= 0:
        return np.maximum(np.floor(charge), 0.0).astype(np.int64), np.zeros(len(charge), np.int64)
    if pulses.max() <= 0:
        return np.zeros(len(charge), np.int64), np.maximum(np.floor(-charge), 0.0).astype(np.int64)
    net, times = _net(charge)
    up = net.copy()
    up[1:] -= net[:-1]
    up = np.maximum(up, 0).cumsum()
    return up.repeat(times), (up - net).repeat(times)


def _net(charge: Array) -> tuple[Counts, Counts]:
    """Successive net counts after a charge (n,), which may reverse, and how long each lasts; initially no pulses.

    A pulse is fired when charge and net count differ by a whole pulse: the net count is limited to the integers below
    and above the charge, and changes when one of these limits passes it.
    """
    low, high = np.floor(charge), np.ceil(charge)
    rises, changes = low[1:] > low[:-1], np.ones(len(charge) + 1, np.bool_)
    np.logical_or(rises, high[1:] < high[:-1], out=changes[1:-1])
    at = np.flatnonzero(changes)
    later = at[1:-1]
    net = np.empty(len(at) - 1, np.int64)
    net[0] = min(max(0.0, low[0]), high[0])
    net[1:] = np.where(rises.take(later - 1), low.take(later), high.take(later))
    return net, at[1:] - at[:-1]
