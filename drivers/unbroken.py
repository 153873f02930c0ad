"""Whether frames with numbers come one after the other: a quick look, block by block, that passes over no gap.

It knows nothing of a gap but that there may be one. What else is odd, such as a frame that is late or comes twice,
looks like one too, so that who must know decodes what has come.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drivers.dbc import Field
from drivers.frame_block import FrameBlock
from drivers.sequence_numbers import Integers


@dataclass(slots=True)
class _Numbers:
    """What has come of one message: how many, and the first and the last of their raw numbers."""

    field: Field
    count: int = 0
    first: int = 0
    last: int = 0

    def rise(self, raw: Integers) -> bool:
        """Takes in more of them; whether each is the one after that before it."""
        if not len(raw):
            return True
        mask = (1 << self.field.signal.length) - 1
        goes_on = not self.count or (int(raw[0]) - self.last) & mask == 1
        self.note(raw)
        steps = raw[1:] - raw[:-1]
        return goes_on and bool(((steps & mask) == 1).all())

    def note(self, raw: Integers) -> None:
        """Takes in more of them that are known to rise; not none."""
        if not self.count:
            self.first = int(raw[0])
        self.last = int(raw[-1])
        self.count += len(raw)


@dataclass(slots=True)
class Unbroken:
    """Frames whose numbers rise by one, by a clock in them, and those of other messages that come with each of them.

    One of a latch that began before the first block, and one that comes after the last, are not missed.
    """

    leading: _Numbers
    tick: Field
    others: Sequence[_Numbers]
    is_whole: bool = field(default=True, init=False)
    _in_step: bool = field(default=True, init=False)  # so far all others have followed the leading one at once
    _places: Integers | None = field(default=None, init=False)  # of the others behind it
    _ids: NDArray[np.uint32] = field(init=False)  # of the others, (n, 1)
    _lengths: NDArray[np.uint8] = field(init=False)
    _last_tick: int | None = field(default=None, init=False)
    _least_ticks: int = field(default=1 << 62, init=False)
    _most_ticks: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        messages = [each.field.message for each in self.others]
        self._ids = np.array([message.id for message in messages], np.uint32)[:, np.newaxis]
        self._lengths = np.array([message.length for message in messages], np.uint8)[:, np.newaxis]

    @classmethod
    def of(cls, sequence: Field, tick: Field, others: Sequence[Field] = ()) -> Unbroken:
        """Of a message with a number and a clock, and of numbers in others."""
        distinct = {(each.message.id, each.signal.name): each for each in others}
        return cls(_Numbers(sequence), tick, tuple(map(_Numbers, distinct.values())))

    def take(self, block: FrameBlock) -> None:
        """Looks at the next block; `is_whole` is True until something may be missing."""
        if self.is_whole and len(block):
            self.is_whole = self._goes_on(block)

    def _goes_on(self, block: FrameBlock) -> bool:
        leading = self.leading
        rows = leading.field.message.rows(block)
        data = block.payloads(rows)
        raw = leading.field.signal.raw(data)
        if not (leading.rise(raw) and self._in_time(self.tick.signal.raw(data))):
            return False
        if self._in_step and self._are_followed(block, rows, raw):
            return True
        self._in_step = False
        return all(
            each.rise(each.field.signal.raw(block.payloads(each.field.message.rows(block)))) and self._beside(each)
            for each in self.others
        )

    def _are_followed(self, block: FrameBlock, rows: NDArray[np.intp], raw: Integers) -> bool:
        """Whether all others come with each of the leading ones, at the same places behind it: most often they do."""
        if not self.others:
            return True
        if self._places is None:
            self._places = self._places_behind(block, rows)
        if self._places is None or not len(rows) or rows[-1] + self._places[-1] >= len(block):
            return False
        at = rows + self._places[:, np.newaxis]
        if (block.ids.take(at) != self._ids).any() or (block.dlc.take(at) != self._lengths).any():
            return False
        signal = self.others[0].field.signal
        mask = (1 << min(signal.length, self.leading.field.signal.length)) - 1
        numbers = signal.raw(block.payloads(at.ravel())).reshape(at.shape)
        if (numbers & mask != raw & mask).any():
            return False
        for each, own in zip(self.others, numbers, strict=True):
            each.note(own)
        return True

    def _places_behind(self, block: FrameBlock, rows: NDArray[np.intp]) -> Integers | None:
        """How far behind the first of the leading ones the others come; None where they are not all there, or alike."""
        signals = [each.field.signal for each in self.others]
        alike = {(signal.shift, signal.length, signal.big_endian) for signal in signals}
        if not len(rows) or len(alike) > 1:
            return None
        near = block.ids[rows[0] : rows[0] + 2 * len(self.others)].tolist()
        wanted = [each.field.message.id for each in self.others]
        places = [near.index(frame_id) for frame_id in wanted if frame_id in near]
        return np.array(places, np.int64) if len(places) == len(wanted) and places == sorted(places) else None

    def _in_time(self, ticks: Integers) -> bool:
        """Whether the numbers cannot have gone round between any two."""
        if not len(ticks):
            return True
        if self._last_tick is not None:
            ticks = np.concatenate(([self._last_tick], ticks))
        self._last_tick = int(ticks[-1])
        if len(ticks) > 1:
            steps = (ticks[1:] - ticks[:-1]) & ((1 << self.tick.signal.length) - 1)
            self._least_ticks = min(self._least_ticks, int(steps.min()))
            self._most_ticks = max(self._most_ticks, int(steps.max()))
        return self._most_ticks < 2 * self._least_ticks

    def _beside(self, other: _Numbers) -> bool:
        """Whether another message has come as often as the leading one, but for those at both ends."""
        leading = self.leading
        if not other.count or not leading.count:
            return max(other.count, leading.count) <= 1
        mask = (1 << min(other.field.signal.length, leading.field.signal.length)) - 1
        ahead = (leading.first - other.first) & mask  # of the first latch, where its other frames came before it
        behind = (leading.last - other.last + 1 & mask) - 1
        return ahead in (0, 1) and behind in (-1, 0, 1) and other.count - leading.count == ahead - behind
