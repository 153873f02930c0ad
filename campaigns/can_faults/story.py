"""Counts and frames of a counter, latch by latch, and the effect of its bus on them: drawn from a seed and a number."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache

import numpy as np

from campaigns.can_faults.layout import AXES, AXIS_ID, LATCH_ID, Layout
from drivers.can.frame_block import FrameBlock
from simulators.faults.frame_faults import FrameFault, apply_fault

ERROR_ID = 1 << 29 | 0x008  # a protocol violation, as SocketCAN tells it
LEAD_IN = 6  # latches that nothing happens to, so that the driver finds its counter
LAYOUTS = 42
FRAME_S = 0.05  # of a period, from one frame of a latch to the next


class CounterFault(StrEnum):
    """Faults of a counter other than those of its bus."""

    RESET = "reset"  # it loses its power for a moment
    CLEARED = "cleared"  # somebody clears its counts, and nothing else
    STUCK = "stuck"  # the counts of an axis stand still
    SILENT_AXIS = "silent_axis"  # an axis sends no more
    BUS_OFF = "bus_off"  # its adapter leaves the bus
    ERRORS = "error_frames"  # there are error frames between the others


Fault = FrameFault | CounterFault
FAULTS: tuple[Fault, ...] = (*FrameFault, *CounterFault)
BESIDE: tuple[Fault, ...] = (
    FrameFault.LOST, FrameFault.DOUBLED, FrameFault.LATE, FrameFault.FOREIGN, FrameFault.SHORT, CounterFault.ERRORS,
)  # fmt: skip


@dataclass(frozen=True)
class Counter:
    """A counter that counts at steady rates: n-th latch → its values, before they are cut to their fields."""

    layout: Layout
    period_ticks: int
    tick_period_s: float
    max_rate_pps: int
    starts: dict[str, int]
    pulses: dict[str, tuple[int, int]]  # + and - of each axis in a million periods

    @property
    def period_s(self) -> float:
        return self.period_ticks * self.tick_period_s

    def counted(self, axis: str, latch: int) -> tuple[int, int]:
        """The + and - pulses of an axis since the first latch."""
        positive, negative = self.pulses[axis]
        return latch * positive // 1_000_000, latch * negative // 1_000_000


@dataclass(frozen=True)
class Sent:
    """One frame as the counter meant it: of the latch, or of an axis, and of which power-on it is."""

    what: str
    latch: int
    era: int
    values: dict[str, int]


@dataclass
class Story:
    """Everything that is on the bus, in the order of arrival; `sent` are the frames in `block`, None for others'.

    `altered` frames are not as they were sent. The bus is off from `off_at_s` on. `kinds` are the faults in it.
    """

    counter: Counter
    kinds: tuple[Fault, ...]
    block: FrameBlock
    sent: list[Sent | None]
    altered: list[bool]
    entry_s: float
    exit_s: float
    link_block_s: float
    off_at_s: float = np.inf


@lru_cache(maxsize=1)
def _layouts() -> list[Layout]:
    """As many kinds of frames as keep their DBC files few."""
    draws = np.random.default_rng(0)
    made = []
    for number in range(LAYOUTS):
        counter_bits, axis_number_bits = [(8, 8), (12, 8), (16, 8), (16, 16), (20, 12), (24, 16), (28, 8)][number % 7]
        number_bits, tick_bits = int(draws.choice([8, 12, 16])), int(draws.choice([16, 24, 32]))
        axes, big_endian, has_boots = int(draws.integers(1, 4)), bool(draws.integers(2)), bool(draws.integers(2))
        made.append(Layout(big_endian, axes, tick_bits, number_bits, counter_bits, axis_number_bits, has_boots))
    return made


def draw_counter(draws: np.random.Generator, *, goes_round: bool) -> Counter:
    """A counter of some kind, or one whose numbers go round soon."""
    layouts = [each for each in _layouts() if each.number_bits == 8] if goes_round else _layouts()
    layout = layouts[draws.integers(len(layouts))]
    tick_period_s = 1e-5 if layout.tick_bits == 16 else 1e-6
    period_s = float(draws.choice([0.001, 0.002, 0.005, 0.01] if layout.tick_bits == 16 else [0.001, 0.005, 0.01, 0.1]))
    if goes_round:
        period_s = 0.001
    pulses_a_period = min((1 << layout.counter_bits) / draws.uniform(1.05, 60), 1e6 * period_s)
    starts = {
        "tick": int(draws.integers(1 << layout.tick_bits)),
        "number": int(draws.integers(1 << layout.number_bits)),
    }
    pulses = {}
    for axis in AXES[: layout.axes]:
        rates = [draws.uniform(0.02, 0.99), 0.0 if draws.integers(2) else draws.uniform(0.02, 0.99)]
        draws.shuffle(rates)
        positive, negative = (round(1e6 * pulses_a_period * rate) for rate in rates)
        if max(positive, negative) < 1_000_000:  # so that no latch is without a pulse
            positive += 1_000_000
        pulses[axis] = positive, negative
        starts |= {f"{axis} {sign}": int(draws.integers(1 << layout.counter_bits)) for sign in "+-"}
    max_rate_pps = max(int(pulses_a_period / period_s), 1)
    return Counter(layout, round(period_s / tick_period_s), tick_period_s, max_rate_pps, starts, pulses)


def draw_story(seed: int, number: int) -> Story:
    """The story of a number: its fault is the next in turn, and every other one has another fault beside it."""
    draws = np.random.default_rng([seed, number])
    main = (None, *FAULTS)[number % (len(FAULTS) + 1)]
    is_long = main is FrameFault.BURST and bool(draws.integers(2))
    counter = draw_counter(draws, goes_round=is_long)
    kinds = [] if main is None else [main]
    if draws.integers(2) and main is not None:
        beside = [kind for kind in BESIDE if kind is not main]
        kinds.append(beside[draws.integers(len(beside))])
    latches = int(draws.integers(300, 400) if is_long else draws.integers(40, 120))
    period_s = counter.period_s
    sent = list(_sent(counter, latches, {k for k in kinds if isinstance(k, CounterFault)}, draws))
    frames = [(frame, (frame.latch + 1 + FRAME_S * place) * period_s) for place, frame in _places(sent)]
    entry_s = (LEAD_IN + 1 + draws.uniform(1, 20)) * period_s
    story = Story(
        counter, tuple(kinds), _block(counter.layout, frames), [frame for frame, _ in frames], [False] * len(frames),
        entry_s, (latches - draws.uniform(1, 6)) * period_s,
        link_block_s=1.0 if is_long else float(draws.choice([0.03, 0.2, 1.0])),
    )  # fmt: skip
    if CounterFault.BUS_OFF in kinds:
        story.off_at_s = float(draws.uniform(entry_s, story.exit_s))
        _keep(story, story.block.at_s < story.off_at_s)
    for kind in kinds:
        if isinstance(kind, FrameFault):
            _suffer(story, kind, draws, is_long=is_long)
        elif kind is CounterFault.ERRORS:
            _put_errors(story, draws)
    return story


def _places(sent: list[Sent]) -> Iterator[tuple[int, Sent]]:
    """Each frame with its place among those of its latch."""
    place, last = 0, None
    for frame in sent:
        place = 0 if frame.latch != last else place + 1
        last = frame.latch
        yield place, frame


def _sent(counter: Counter, latches: int, faults: set[CounterFault], draws: np.random.Generator) -> Iterator[Sent]:
    """All frames in order; the faults begin at a latch of their own."""
    layout, starts = counter.layout, dict(counter.starts)
    axes = AXES[: layout.axes]
    hurt, at = axes[draws.integers(len(axes))], int(draws.integers(LEAD_IN, latches))
    stands_for = int(draws.integers(1, latches))
    era = began = 0
    held: dict[str, tuple[int, int]] = {}
    lost = dict.fromkeys(axes, (0, 0))  # pulses that were not counted, or were cleared
    for latch in range(latches):
        if latch == at and CounterFault.RESET in faults:
            era, began = 1, latch
            starts = dict.fromkeys(starts, 0)
            lost = {axis: counter.counted(axis, latch) for axis in axes}
        if latch == at and CounterFault.CLEARED in faults:
            starts = starts | {name: 0 for name in starts if name not in ("tick", "number")}
            lost = {axis: counter.counted(axis, latch) for axis in axes}
        tick, count = (latch - began) * counter.period_ticks, latch - began
        said = {"Tick": starts["tick"] + tick, "Number": starts["number"] + count, "Boots": era, "Value": 7 * latch}
        yield Sent("latch", latch, era, said)
        for axis in axes:
            if CounterFault.SILENT_AXIS in faults and axis == hurt and latch >= at:
                continue
            counted = tuple(new - old for new, old in zip(counter.counted(axis, latch), lost[axis], strict=True))
            if CounterFault.STUCK in faults and axis == hurt and at <= latch < at + stands_for:
                counted = held.setdefault(axis, counted)
                now = counter.counted(axis, latch)
                lost[axis] = now[0] - counted[0], now[1] - counted[1]
            values = {"Positive": starts[f"{axis} +"] + counted[0], "Negative": starts[f"{axis} -"] + counted[1]}
            yield Sent(axis, latch, era, values | {"Number": starts["number"] + count})


def _block(layout: Layout, frames: list[tuple[Sent, float]]) -> FrameBlock:
    data, ids, lengths = [], [], []
    for frame, _ in frames:
        fields = layout.latch if frame.what == "latch" else layout.axis
        payload = layout.packed(fields, frame.values)
        ids.append(LATCH_ID if frame.what == "latch" else AXIS_ID + AXES.index(frame.what))
        lengths.append(len(payload))
        data.append(payload.ljust(8, b"\0"))
    return FrameBlock(
        np.array(ids, np.uint32), np.array([at_s for _, at_s in frames]), np.array(lengths, np.uint8),
        np.frombuffer(b"".join(data), np.uint8).reshape(-1, 8).copy(),
    )  # fmt: skip


def _suffer(story: Story, kind: FrameFault, draws: np.random.Generator, *, is_long: bool) -> None:
    """The frames after the lead-in suffer."""
    lead_s = LEAD_IN * story.counter.period_s
    first = int(np.searchsorted(story.block.at_s, lead_s))
    tail = _rows(story.block, np.arange(first, len(story.block)))
    axes = range(AXIS_ID, AXIS_ID + story.counter.layout.axes)
    share = float(draws.choice([0.01, 0.05, 0.2]))
    if kind is FrameFault.BURST and is_long:  # in which the numbers may go round
        begin, end = np.sort(draws.integers(0, len(tail), 2))
        _keep(story, (np.arange(len(story.block)) < first + begin) | (np.arange(len(story.block)) >= first + end))
        return
    carried = apply_fault(kind, tail, draws, share if kind is not FrameFault.BURST else 0.2, axes)
    rows = carried.rows.tolist()
    story.sent[first:] = [None if row < 0 else story.sent[first + row] for row in rows]
    story.altered[first:] = [
        row >= 0 and (story.altered[first + row] or hurt)
        for row, hurt in zip(rows, carried.altered.tolist(), strict=True)
    ]
    story.block = FrameBlock.joined([_rows(story.block, np.arange(first)), carried.block])


def _put_errors(story: Story, draws: np.random.Generator) -> None:
    """An error frame after one in twenty."""
    after = np.flatnonzero(draws.random(len(story.block)) < 0.05)
    errors = FrameBlock(
        np.full(len(after), ERROR_ID, np.uint32), story.block.at_s[after], np.full(len(after), 8, np.uint8),
        np.zeros((len(after), 8), np.uint8),
    )  # fmt: skip
    order = np.argsort(np.concatenate([np.arange(len(story.block)), after + 0.5]), kind="stable")
    story.block = _rows(FrameBlock.joined([story.block, errors]), order)
    story.sent = [(story.sent + [None] * len(after))[row] for row in order]
    story.altered = [(story.altered + [False] * len(after))[row] for row in order]


def _keep(story: Story, kept: np.ndarray) -> None:
    story.block = _rows(story.block, np.flatnonzero(kept))
    story.sent = [frame for frame, keep in zip(story.sent, kept, strict=True) if keep]
    story.altered = [hurt for hurt, keep in zip(story.altered, kept, strict=True) if keep]


def _rows(block: FrameBlock, rows: np.ndarray) -> FrameBlock:
    return block.at(rows)
