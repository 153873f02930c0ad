"""Reference evaluation of a counter's frames, computed frame by frame from the sent ones.

Nothing here unwraps a number or pairs frames by it: every frame says of which latch it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import accumulate, pairwise

from campaigns.can_faults.story import Counter, Sent
from drivers.can.encoder_frames import MAX_AHEAD
from drivers.can.sequence_numbers import MAX_LATE

AT_THE_LIMIT = "at the limit"  # of what is told: the last digits of a product decide
CAME_ROUND = "clock came round"
MAY_BE_TOLD = frozenset({AT_THE_LIMIT, CAME_ROUND})
Came = tuple[Sent | None, bool, str]
"""A frame that came, whether it was altered, and which message it seems to be; "" for none of the counter's."""


@dataclass
class Truth:
    """Of one axis: the latches that came whole, in order, what their frames say, and the first and last of each gap.

    `reasons` are why a mean must not be used without a word; `restarted` is that a latch of another power-on came, and
    `strays` are frames of the axis from one of which no latch did, or from before the first latch.
    """

    latches: list[int] = field(default_factory=list)
    ticks: list[int] = field(default_factory=list)
    positive: list[int] = field(default_factory=list)
    negative: list[int] = field(default_factory=list)
    gaps: list[tuple[int, int]] = field(default_factory=list)
    lost: int = 0
    dropped: int = 0
    strays: int = 0
    first: int = 0
    restarted: bool = False
    reasons: set[str] = field(default_factory=set)
    net_pps: float = float("nan")
    true_net_pps: float = float("nan")


def truth_of(counter: Counter, axis: str, came: Sequence[Came]) -> Truth:
    """Of an axis, from all frames that came in an acquisition."""
    truth = Truth()
    latches = [sent for sent, _, seems in came if sent is not None and seems == "latch"]
    truth.restarted = len({sent.era for sent in latches}) > 1
    if not latches:
        truth.reasons.add("too few")
        return truth
    all_own = [sent for sent, _, seems in came if sent is not None and seems == axis]
    own = [sent for sent in _tellable(counter, axis, came) if sent.era == latches[0].era]
    truth.strays = len(all_own) - len(own) + sum(sent.latch < latches[0].latch for sent in own)
    known, stale = _in_order(latches)
    with_counts, stale_counts = _in_order(own)
    truth.first, truth.dropped = latches[0].latch, stale + stale_counts
    truth.latches = sorted(known.keys() & with_counts.keys())
    last = max(known) if max(known) in truth.latches else max(known) - 1  # whose frames may have come after the end
    truth.gaps = _gaps(range(truth.first, last + 1), truth.latches)
    truth.lost = sum(last - first + 1 for first, last in truth.gaps)
    if _come_very_late(latches):
        truth.reasons.add("very late")
    if max((last - first for first, last in truth.gaps), default=0) >= MAX_AHEAD:
        truth.strays += len(all_own)  # of what comes late over such a gap nobody can tell whose it is
    truth.ticks = [known[latch].values["Tick"] for latch in truth.latches]
    truth.positive = [with_counts[latch].values["Positive"] for latch in truth.latches]
    truth.negative = [with_counts[latch].values["Negative"] for latch in truth.latches]
    _judge(counter, axis, truth)
    return truth


def _tellable(counter: Counter, axis: str, came: Sequence[Came]) -> list[Sent]:
    """The frames of an axis that do not come so late that half of the numbers have gone by."""
    half = 1 << (min(counter.layout.axis_number_bits, counter.layout.number_bits) - 1)
    newest, found = 0, []
    for sent, _, seems in came:
        if sent is not None and seems == "latch":
            newest = max(newest, sent.latch)
        elif sent is not None and seems == axis and newest - sent.latch < half:
            found.append(sent)
    return found


def truth_of_samples(came: Sequence[Came]) -> Truth:
    """Of the latches as samples, each with its own number and clock."""
    truth = Truth()
    latches = [sent for sent, _, seems in came if sent is not None and seems == "latch"]
    truth.restarted = len({sent.era for sent in latches}) > 1
    if not latches:
        return truth
    known, truth.dropped = _in_order(latches)
    truth.first, truth.latches = latches[0].latch, sorted(known)
    if _come_very_late(latches):
        truth.reasons.add("very late")
    truth.gaps = _gaps(range(truth.first, max(known) + 1), truth.latches)
    truth.lost = sum(last - first + 1 for first, last in truth.gaps)
    return truth


def _come_very_late(latches: Sequence[Sent]) -> bool:
    """Return whether one comes so much later than others as none does from a counter that has not begun anew."""
    newest = accumulate((sent.latch for sent in latches), max)
    return any(most - sent.latch > MAX_LATE for most, sent in zip(newest, latches, strict=True))


def _gaps(expected: range, found: Sequence[int]) -> list[tuple[int, int]]:
    """The first and the last of each row of latches that did not come."""
    gaps: list[tuple[int, int]] = []
    for latch in sorted(set(expected) - set(found)):
        if gaps and gaps[-1][1] == latch - 1:
            gaps[-1] = gaps[-1][0], latch
        else:
            gaps.append((latch, latch))
    return gaps


def _in_order(frames: Sequence[Sent]) -> tuple[dict[int, Sent], int]:
    """The frames of one message that are ahead of all before them, by latch, and how many are not."""
    taken: dict[int, Sent] = {}
    for frame in frames:
        if not taken or frame.latch > max(taken):
            taken[frame.latch] = frame
    return taken, len(frames) - len(taken)


def _judge(counter: Counter, axis: str, truth: Truth) -> None:
    """Return whether the mean may be used, and what it is: of what the frames say, and of what was really counted."""
    reasons, rows = truth.reasons, truth.latches
    if truth.restarted:
        reasons.add("restarted")
    if len(rows) < 2 or len(rows) < 0.5 * (len(rows) + truth.lost):
        reasons.add("too few")
    if len(rows) < 2:
        return
    modulus = 1 << counter.layout.counter_bits
    waits = [after - before for before, after in pairwise(rows)]
    waits_s = [wait * counter.period_s for wait in waits]
    steps = [[(b - a) % modulus for a, b in pairwise(counts)] for counts in (truth.positive, truth.negative)]
    if max(waits) * counter.period_ticks >= 1 << (counter.layout.tick_bits - 1):
        reasons.add(CAME_ROUND)
    reasons |= _of_steps(waits_s, [max(both) for both in zip(*steps, strict=True)], counter.max_rate_pps, modulus)
    span_s = (rows[-1] - rows[0]) * counter.period_s
    truth.net_pps = (sum(steps[0]) - sum(steps[1])) / span_s
    counted = [counter.counted(axis, rows[end]) for end in (0, -1)]
    truth.true_net_pps = ((counted[1][0] - counted[0][0]) - (counted[1][1] - counted[0][1])) / span_s
    due = _pulses_due(waits_s, [sum(both) for both in zip(*steps, strict=True)], abs(truth.net_pps))
    if due > 5 - 1e-6:
        reasons.add("standstill" if due > 5 + 1e-6 else AT_THE_LIMIT)


def _of_steps(waits_s: Sequence[float], most: Sequence[int], max_rate_pps: float, modulus: int) -> set[str]:
    """Objections to the larger steps of a counter, each after its wait."""
    reasons = set()
    rounds = max(waits_s) * max_rate_pps / modulus
    if rounds > 1 - 1e-9:
        reasons.add("ambiguous" if rounds > 1 + 1e-9 else AT_THE_LIMIT)
    if any(step > 1.05 * max_rate_pps * wait_s + 1 for step, wait_s in zip(most, waits_s, strict=True)):
        reasons.add("impossible")
    return reasons


def _pulses_due(waits_s: Sequence[float], pulses: Sequence[int], rate_pps: float) -> float:
    """Expected number of pulses in the longest time without one, of three latches or more."""
    longest_s = silent_s = 0.0
    count = 0
    for wait_s, fired in zip(waits_s, pulses, strict=True):
        silent_s, count = (0.0, 0) if fired else (silent_s + wait_s, count + 1)
        if count >= 3:
            longest_s = max(longest_s, silent_s)
    return math.inf if longest_s and not rate_pps else longest_s * rate_pps
