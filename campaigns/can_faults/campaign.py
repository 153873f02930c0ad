"""Many acquisitions on bad buses, through the real driver and decoder, each held against what was really sent.

An outcome is what became of one axis in one acquisition:

* `true`: its mean is the true one, and nothing is said of it;
* `told`: the mean is marked, or the driver has ended the acquisition, and there is a reason;
* `unseeable`: the counts themselves are wrong, and no one can tell: every step of theirs could have been counted.

Whatever the outcome, every frame that came is handed out once, and the latches that did not come whole are told by the
number of the first and of the last.
"""

from __future__ import annotations

import asyncio
import math
from collections import Counter as Tallies
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise

import numpy as np

from bench.loop import AS_FAST_AS_POSSIBLE, run
from bench.metrology.acquisition import Codes, Counts
from bench.metrology.pulse_counts import mean_rate
from bench.metrology.sampled_codes import mean_code
from campaigns.can_faults.layout import AXES, AXIS_ID, LATCH_ID, Layout
from campaigns.can_faults.story import CounterFault, Story, draw_story
from campaigns.can_faults.truth import CAME_ROUND, MAY_BE_TOLD, Truth, truth_of, truth_of_samples
from drivers.can.dbc import Dbc
from drivers.can.frame_block import FrameBlock
from drivers.can.gap_detection import GapDetector
from drivers.description import IdentityPin, Nothing, Setup, make_driver
from drivers.dialects.can_counter import wire
from drivers.dialects.can_counter.description import DESCRIPTION, CounterOptions
from drivers.dialects.can_counter.driver import CanCounter
from drivers.dialects.can_counter.options import ChannelOptions, LatchOptions
from drivers.dialects.can_telemetry import wire as telemetry
from drivers.dialects.can_telemetry.options import SampleOptions
from drivers.errors import CannotConnect, DriverError, InstrumentFault, LinkLost, NoAnswer
from drivers.transport.address import Address
from drivers.transport.frame_link import FrameLink
from simulators.faults.frame_faults import FrameFault

SPOILING = frozenset({CounterFault.CLEARED, CounterFault.STUCK, FrameFault.SWAPPED})  # of the counts themselves
EXACT = 1e-12  # relative: the same sums of whole numbers, divided by the same times


@dataclass
class Tally:
    """Outcomes of the axes; `unexpected` are sentences that should not be there."""

    outcomes: Tallies[str] = field(default_factory=Tallies)
    unexpected: list[str] = field(default_factory=list)
    by_kind: dict[str, Tallies[str]] = field(default_factory=dict)
    cases: int = 0


class Bus:
    """A Wires to what a story has on its bus, as a link hands it out."""

    def __init__(self, story: Story) -> None:
        self._story, self.block_s = story, story.link_block_s
        self._next = 0

    async def stream(self, device: str, address: Address, factory: Callable[[], asyncio.Protocol]) -> asyncio.Protocol:
        raise CannotConnect(device, f"{address} carries no bytes")

    async def frames(self, device: str, address: Address) -> FrameLink:
        return self

    def take(self) -> FrameBlock:
        story, now_s = self._story, asyncio.get_running_loop().time()
        end = int(np.searchsorted(story.block.at_s, now_s, side="right"))
        begin, self._next = self._next, max(self._next, end)
        if now_s >= story.off_at_s and begin == self._next:
            raise LinkLost("counter", "the bus is off")
        return _rows(story.block, begin, self._next)

    def close(self) -> None:
        """A story goes on without listeners."""


@dataclass
class Acquired:
    """Blocks from the driver, its final report, and begin and end of the acquisition."""

    blocks: list[FrameBlock] = field(default_factory=list)
    problem: DriverError | None = None
    begin_s: float = 0.0
    end_s: float = 0.0


def play(cases: Iterable[int], seed: int) -> Tally:
    """Play the cases with these numbers."""
    tally = Tally()
    for number in cases:
        play_one(seed, number, tally)
    return tally


def play_one(seed: int, number: int, tally: Tally) -> None:
    """One acquisition."""
    story = draw_story(seed, number)
    counter = story.counter
    names = counter.layout.names()
    names["latch"]["tick_period"] = f"{counter.tick_period_s * 1e6:g} µs"
    options = CounterOptions.model_validate(
        {"dbc": counter.layout.dbc().name, "period": f"{counter.period_s * 1e6:.0f} µs",
         "max_rate": f"{counter.max_rate_pps} Hz", **names},
        context={"folder": counter.layout.dbc().parent},
    )  # fmt: skip
    acquired = Acquired()
    run(acquire(options, story, acquired), AS_FAST_AS_POSSIBLE)
    kinds = "+".join(story.kinds) or "none"
    where = f"{kinds}; to play it again: python -m campaigns.can_faults --seed {seed} --case {number}"
    outcomes, problems = judge(story, options, acquired)
    tally.cases += 1
    tally.outcomes.update(outcomes)
    tally.by_kind.setdefault(story.kinds[0] if story.kinds else "none", Tallies()).update(outcomes)
    tally.unexpected += [f"{problem} ({where})" for problem in problems]


async def acquire(options: CounterOptions, story: Story, acquired: Acquired) -> None:
    """Acquire as the engine does."""
    loop = asyncio.get_running_loop()
    setup = Setup(
        name="counter", address=Address.parse("can:virtual/story"), wires=Bus(story), options=options,
        limits=Nothing(), safe=Nothing(), identity=IdentityPin(),
    )  # fmt: skip
    driver = make_driver(DESCRIPTION, setup)
    assert isinstance(driver, CanCounter)
    async with driver:
        await asyncio.sleep(story.entry_s - loop.time())
        acquired.begin_s = loop.time()
        gate = asyncio.timeout_at(story.exit_s)
        try:
            async with driver.acquire() as blocks:
                try:
                    async with gate:
                        async for block in blocks:
                            acquired.blocks.append(block)
                except TimeoutError:
                    if not gate.expired():  # a silent counter is a TimeoutError too
                        raise
            async for block in blocks:
                acquired.blocks.append(block)
        except DriverError as problem:
            acquired.problem = problem
        acquired.end_s = loop.time()


def judge(story: Story, options: CounterOptions, acquired: Acquired) -> tuple[list[str], list[str]]:
    """An outcome for each axis, and what should not be."""
    block = story.block
    begin, end = (int(np.searchsorted(block.at_s, at_s, side="right")) for at_s in (acquired.begin_s, acquired.end_s))
    handed, wanted = FrameBlock.joined(acquired.blocks), _rows(block, begin, end)
    problems = []
    if acquired.problem is None and len(handed) != len(wanted):
        problems.append(f"{len(handed)} frames were handed out, {len(wanted)} came")
    wanted = _rows(wanted, 0, len(handed))
    if not all(np.array_equal(getattr(handed, what), getattr(wanted, what)) for what in ("ids", "dlc", "data", "at_s")):
        problems.append("other frames were handed out than came")
    if acquired.problem is None and story.off_at_s <= acquired.end_s:
        problems.append("the bus went off, and the acquisition did not fail")
    if acquired.problem is not None:
        return _told(story, acquired, begin, problems)
    layout = story.counter.layout
    came = [
        (story.sent[row], story.altered[row], _seems(layout, int(block.ids[row]), int(block.dlc[row])))
        for row in range(begin, end)
    ]
    outcomes = []
    for axis in AXES[: layout.axes]:
        truth = truth_of(story.counter, axis, came)
        found = _Found.of(options, layout, axis, handed)
        outcome, wrong = compare(story, truth, found)
        outcomes.append(outcome)
        problems += [f"axis {axis}: {problem}" for problem in wrong]
        problems += [
            f"axis {axis}: {problem}" for problem in overlooked(wire.unbroken(_form(layout)), story, truth, acquired)
        ]
    truth = truth_of_samples(came)
    wrongs = compare_samples(story, truth, handed)
    wrongs += overlooked(telemetry.unbroken({"latch": _form_of_samples(layout)})[0], story, truth, acquired)
    return outcomes, problems + [f"samples: {wrong}" for wrong in wrongs]


def overlooked(look: GapDetector, story: Story, truth: Truth, acquired: Acquired) -> list[str]:
    """Errors of the gap check of blocks: missed gaps, or gaps reported where there are none."""
    for block in acquired.blocks:
        look.take(block)
    if look.is_whole and truth.gaps and not truth.restarted:
        return [f"gaps {truth.gaps} were overlooked"]
    return [] if look.is_whole or story.kinds else ["gaps were seen where nothing is missing"]


def compare_samples(story: Story, truth: Truth, block: FrameBlock) -> list[str]:
    """Errors of the latches decoded as samples of telemetry."""
    layout, counter = story.counter.layout, story.counter
    form = _form_of_samples(layout)
    raw = telemetry.decode_samples(form, block)
    ticks = max((b - a for a, b in pairwise(truth.latches)), default=0) * counter.period_ticks
    if truth.restarted:
        codes = Codes(
            raw.sequence, raw.tick, raw.values, raw.host_s, raw.tick_bits, counter.tick_period_s, 1.0, raw.lost,
            raw.dropped, raw.invalid, restarts=raw.restarts,
        )  # fmt: skip
        return [] if mean_code(codes).problems else ["a unit that began anew was not told"]
    if ticks >= 1 << (layout.tick_bits - 1) or truth.reasons:
        return []
    found = ((raw.gaps - raw.first + truth.first).tolist(), (raw.sequence - raw.first + truth.first).tolist())
    problems = []
    if found != ([list(gap) for gap in truth.gaps], truth.latches):
        problems.append(f"gaps {found[0]} were told, {truth.gaps} are true")
    if (raw.lost, raw.dropped, raw.restarts) != (truth.lost, truth.dropped, 0):
        problems.append(f"{raw.lost} lost, {raw.dropped} dropped, {raw.restarts} restarts were told")
    if raw.values.tolist() != [7 * latch % 256 for latch in truth.latches]:
        problems.append("other values were read than sent")
    return problems


@dataclass
class _Found:
    """Results of driver and decoder for one axis."""

    counts: wire.Counts
    net_pps: float
    flags: tuple[str, ...]

    @classmethod
    def of(cls, options: CounterOptions, layout: Layout, axis: str, block: FrameBlock) -> _Found:
        raw = wire.decode_counts(_form(layout), axis, block)
        rate = mean_rate(
            Counts(
                raw.sequence, raw.tick, raw.positive, raw.negative, raw.host_s, raw.tick_bits, raw.counter_bits,
                options.latch.tick_period, options.max_rate, raw.lost, raw.restarts,
            )
        )  # fmt: skip
        return cls(raw, rate.net_pps, rate.problems)


@cache
def _form(layout: Layout) -> wire.CounterFormat:
    names = layout.names()
    latch = LatchOptions.model_validate({**names["latch"], "tick_period": "1 s"})
    channels = {name: ChannelOptions.model_validate(each) for name, each in names["channels"].items()}
    return wire.counter_format(Dbc(layout.dbc().read_text("utf-8")), latch, channels, {})


@cache
def _form_of_samples(layout: Layout) -> telemetry.SampleFormat:
    names = {"value": "Latch.Value", "tick": "Latch.Tick", "sequence": "Latch.Number", "invalid_bits": 1}
    sample = SampleOptions.model_validate({**names, "tick_period": "1 s", "period": "1 s"})
    return telemetry.sample_formats(Dbc(layout.dbc().read_text("utf-8")), {"latch": sample})["latch"]


def compare(story: Story, truth: Truth, found: _Found) -> tuple[str, list[str]]:
    """The outcome of an axis, and what is wrong with it."""
    exact = not truth.restarted and CAME_ROUND not in truth.reasons
    problems = _misread(truth, found.counts) if exact else []
    if found.flags:
        told = ", ".join(found.flags)
        return "told", problems if truth.reasons else [*problems, f"{told} was told without a reason"]
    if truth.reasons - MAY_BE_TOLD:
        problems.append(f"nothing was told in spite of: {', '.join(sorted(truth.reasons))}")
    if math.isclose(found.net_pps, truth.true_net_pps, rel_tol=EXACT, abs_tol=EXACT):
        return "true", problems
    if SPOILING & set(story.kinds) and math.isclose(found.net_pps, truth.net_pps, rel_tol=EXACT, abs_tol=EXACT):
        return "unseeable", problems
    problems.append(f"a rate of {found.net_pps} Hz without a word, {truth.true_net_pps} Hz is true")
    return "wrong", problems


def _misread(truth: Truth, counts: wire.Counts) -> list[str]:
    """Errors in the latches that were decoded and those reported lost."""
    problems = []
    ahead = truth.first - counts.first
    gaps = [(first, last) for first, last in (counts.gaps + ahead).tolist()]
    if gaps != truth.gaps:
        problems.append(f"gaps {gaps} were told, {truth.gaps} are true")
    if (counts.sequence + ahead).tolist() != truth.latches:
        problems.append("other latches were paired than came whole")
    if counts.lost != truth.lost or abs(counts.dropped - truth.dropped) > truth.strays:
        told, true = (counts.lost, counts.dropped), (truth.lost, truth.dropped)
        problems.append(f"lost and dropped are told as {told}, {true} are true")
    return problems


def _told(story: Story, acquired: Acquired, begin: int, problems: list[str]) -> tuple[list[str], list[str]]:
    """The driver has ended the acquisition, for which there must be a reason on the bus."""
    layout, problem = story.counter.layout, acquired.problem
    at_s = [
        at
        for at, sent, seems in zip(story.block.at_s.tolist(), story.sent, _all_seem(story), strict=True)
        if sent is not None and seems == "latch" and at <= acquired.end_s
    ]
    silent_s = max(np.diff([*at_s, acquired.end_s]), default=0.0)
    twice = CounterFault.RESET in story.kinds or FrameFault.DOUBLED in story.kinds or FrameFault.LATE in story.kinds
    if isinstance(problem, LinkLost):
        is_true = acquired.end_s >= story.off_at_s
    elif isinstance(problem, NoAnswer):
        is_true = silent_s > 25 * story.counter.period_s
    else:
        is_true = isinstance(problem, InstrumentFault) and twice
    if not is_true:
        problems.append(f"without a reason: {problem}")
    return ["told"] * layout.axes, problems


def _all_seem(story: Story) -> list[str]:
    layout = story.counter.layout
    return [
        _seems(layout, frame_id, dlc)
        for frame_id, dlc in zip(story.block.ids.tolist(), story.block.dlc.tolist(), strict=True)
    ]


def _seems(layout: Layout, frame_id: int, dlc: int) -> str:
    """Message of the counter with the identifier and length of a frame, or ""."""
    if frame_id == LATCH_ID:
        return "latch" if dlc == layout.length(layout.latch) else ""
    if AXIS_ID <= frame_id < AXIS_ID + layout.axes:
        return AXES[frame_id - AXIS_ID] if dlc == layout.length(layout.axis) else ""
    return ""


def _rows(block: FrameBlock, begin: int, end: int) -> FrameBlock:
    rows = slice(begin, end)
    return FrameBlock(block.ids[rows], block.at_s[rows], block.dlc[rows], block.data[rows])
