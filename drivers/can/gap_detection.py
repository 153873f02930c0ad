"""Quick check, block by block, that numbered frames are consecutive; it misses no gap.

It only detects a possible gap: late and duplicated frames look like gaps, too. For certainty, decode the frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drivers.can.dbc import Field, Message
from drivers.can.frame_block import FrameBlock
from drivers.can.frame_cycles import Cycles, cycles_of
from drivers.can.sequence_numbers import Integers
from drivers.can.sorted_block import SortedBlock


@dataclass(slots=True)
class _SequenceNumbers:
    """Sequence numbers of one message so far: count, and first and last raw number."""

    field: Field
    count: int = 0
    first: int = 0
    last: int = 0

    def extend(self, raw: Integers) -> bool:
        """Add numbers; return whether each is the successor of the one before."""
        if not len(raw):
            return True
        mask = (1 << self.field.signal.length) - 1
        continues = not self.count or (int(raw[0]) - self.last) & mask == 1
        self.note(raw)
        steps = raw[1:] - raw[:-1]
        return continues and bool(((steps & mask) == 1).all())

    def note(self, raw: Integers) -> None:
        """Add numbers that are known to be consecutive; at least one."""
        if not self.count:
            self.first = int(raw[0])
        self.last = int(raw[-1])
        self.count += len(raw)


@dataclass(slots=True)
class GapDetector:
    """Gap detector for frames with consecutive numbers and a clock, and for other messages sent with each of them.

    A missing frame of a latch that began before the first block or ends after the last is not a gap.
    """

    leading: _SequenceNumbers
    tick: Field
    others: Sequence[_SequenceNumbers]
    is_whole: bool = field(default=True, init=False)
    _in_step: bool = field(default=True, init=False)  # True while all others have followed the leading message at once
    _last_tick: int | None = field(default=None, init=False)
    _min_ticks: int = field(default=1 << 62, init=False)
    _max_ticks: int = field(default=0, init=False)

    @classmethod
    def of(cls, sequence: Field, tick: Field, others: Sequence[Field] = ()) -> GapDetector:
        """Build from a message with number and clock, and from the numbers in other messages."""
        distinct = {(each.message.id, each.signal.name): each for each in others}
        return cls(_SequenceNumbers(sequence), tick, tuple(map(_SequenceNumbers, distinct.values())))

    def take(self, block: FrameBlock) -> None:
        """Check the next block; `is_whole` is True until a frame may be missing."""
        if self.is_whole and len(block):
            self.is_whole = self._continues(block)

    def _continues(self, block: FrameBlock) -> bool:
        leading = self.leading
        sent = leading.field.message.sent_in(block)
        raw = leading.field.signal.raw(sent.words)
        if not (leading.extend(raw) and self._in_time(self.tick.signal.raw(sent.words))):
            return False
        if self._in_step and self._are_followed(block, sent.rows, raw):
            return True
        self._in_step = False
        return all(
            each.extend(each.field.signal.raw(each.field.message.sent_in(block).words)) and self._as_many(each)
            for each in self.others
        )

    def _are_followed(self, block: FrameBlock, rows: NDArray[np.intp], raw: Integers) -> bool:
        """Return whether all others are sent as often as the leading message and carry its numbers: the usual case."""
        cycles, found = None if isinstance(block, SortedBlock) else cycles_of(block, rows), []
        for each in self.others:
            words = _words(each.field.message, block, cycles)
            if words is None or len(words) != len(rows):
                return False
            numbers = each.field.signal.raw(words)
            if ((numbers ^ raw) & self._common(each)).any():
                return False
            found.append(numbers)
        for each, numbers in zip(self.others, found, strict=True):
            each.note(numbers)
        return True

    def _common(self, other: _SequenceNumbers) -> int:
        """Bits that the number of another message has in common with the leading one."""
        return (1 << min(other.field.signal.length, self.leading.field.signal.length)) - 1

    def _in_time(self, ticks: Integers) -> bool:
        """Return whether the number cannot have wrapped between any two frames, by their clock."""
        if not len(ticks):
            return True
        if self._last_tick is not None:
            ticks = np.concatenate(([self._last_tick], ticks))
        self._last_tick = int(ticks[-1])
        if len(ticks) > 1:
            steps = (ticks[1:] - ticks[:-1]) & ((1 << self.tick.signal.length) - 1)
            self._min_ticks = min(self._min_ticks, int(steps.min()))
            self._max_ticks = max(self._max_ticks, int(steps.max()))
        return self._max_ticks < 2 * self._min_ticks

    def _as_many(self, other: _SequenceNumbers) -> bool:
        """Return whether another message arrived as often as the leading one, apart from both ends."""
        leading = self.leading
        if not other.count or not leading.count:
            return max(other.count, leading.count) <= 1
        mask = self._common(other)
        ahead = (leading.first - other.first) & mask  # numbers of the first latch whose other frames arrived before it
        behind = (leading.last - other.last + 1 & mask) - 1
        return ahead in (0, 1) and behind in (-1, 0, 1) and other.count - leading.count == ahead - behind


def _words(message: Message, block: FrameBlock, cycles: Cycles | None) -> NDArray[np.uint64] | None:
    """Data of the frames of a message, by the cycles of a block that is not sorted; None if one lacks it."""
    if cycles is None:
        return message.sent_in(block).words
    rows = cycles.rows(message)
    return None if rows is None else block.words.take(rows)
