"""A charge-balancing converter: from charge to counts of + and - pulses (equations 8.5)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Counts = NDArray[np.int64]
TURNS_OF_EXTREME = 8


class Integrator:
    """Signed charge integrators with + and - thresholds; fractions of a pulse are carried exactly.

    One integrator with increments of charge (n,), or several with (c, n), whose initial values are columns (c, 1).
    """

    def __init__(self, residue: Array | float, positive: Counts | int, negative: Counts | int) -> None:
        self._residue = residue
        self.positive, self.negative = positive, negative

    def count(self, pulses: Array) -> tuple[Counts, Counts]:
        """Cumulative + and - counts after each of the consecutive increments of charge, in pulses."""
        if not pulses.size:
            return np.empty(pulses.shape, np.int64), np.empty(pulses.shape, np.int64)
        charge = self._residue + pulses.cumsum(-1)
        net, fired_up = np.empty_like(charge), np.empty_like(charge)
        for row in np.ndindex(charge.shape[:-1]):
            net[row], fired_up[row] = _fired(pulses[row], charge[row])
        self._residue = charge[..., -1:] - net[..., -1:]
        positive, negative = fired_up.astype(np.int64), (fired_up - net).astype(np.int64)
        positive += self.positive
        negative += self.negative
        self.positive, self.negative = positive[..., -1:], negative[..., -1:]
        return positive, negative

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


def _fired(pulses: Array, charge: Array) -> tuple[Array, Array]:
    """Net and + counts after each of the increments of a charge (n,); initially no pulses."""
    if pulses.min() >= 0:
        net = np.maximum(np.floor(charge), 0.0)
        return net, net
    if pulses.max() <= 0:
        return np.minimum(np.ceil(charge), 0.0), np.zeros_like(charge)
    net = _net(charge)
    steps = np.diff(net, prepend=0.0)
    return net, np.maximum(steps, 0.0, out=steps).cumsum()


def _net(charge: Array) -> Array:
    """Net counts after a charge (n,), which may reverse; initially no pulses.

    A pulse is fired when charge and net count differ by a whole pulse: the net count is limited to the integers below
    and above the charge, and changes when one of these limits passes it.
    """
    low, fired = np.floor(charge), np.ceil(charge)
    up, changes = low[1:] > low[:-1], np.ones(len(charge), np.bool_)
    np.logical_or(up, fired[1:] < fired[:-1], out=changes[1:])
    fired[0] = min(max(0.0, low[0]), fired[0])
    np.copyto(fired[1:], low[1:], where=up)
    at = np.flatnonzero(changes)
    return fired[at].repeat(np.diff(at, append=len(charge)))
