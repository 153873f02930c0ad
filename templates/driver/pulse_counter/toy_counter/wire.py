"""Frames of the counter ⇄ counts, both directions; no I/O.

Source: its manual, which is the table in README.md.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from drivers.can.dbc import Field, Message, Signal
from drivers.can.decoded import Counts
from drivers.can.frame_block import FrameBlock
from drivers.can.sequence_numbers import Integers, ascending, count_restarts, gaps_in, unwrapped_by_clock
from numpy.typing import NDArray

FIRST_ID = 0x300
_field = partial(Signal, big_endian=True, offset=0.0)  # shifts count in the eight bytes as one number

NUMBER = _field("Number", shift=56, length=8, signed=False, scale=1.0, unit="")
TICK = _field("Tick", shift=40, length=16, signed=False, scale=1.0, unit="")
POSITIVE = _field("Positive", shift=20, length=20, signed=False, scale=1.0, unit="")
NEGATIVE = _field("Negative", shift=0, length=20, signed=False, scale=1.0, unit="")
CELSIUS = _field("Celsius", shift=48, length=16, signed=True, scale=0.01, unit="°C")
TEMPERATURE = Field(Message("Temperature", 0x3F0, 2, {CELSIUS.name: CELSIUS}), CELSIUS)


def latch(number: int) -> Message:
    """Decode the latch frame of an input."""
    fields = (NUMBER, TICK, POSITIVE, NEGATIVE)
    return Message(f"Input{number}", FIRST_ID + number, 8, {each.name: each for each in fields})


def counts_in(message: Message, block: FrameBlock) -> Counts:
    """Decode the counts of an input in a block; duplicated and late frames are dropped, lost ones counted."""
    rows, words = message.sent_in(block)
    ticks = TICK.raw(words)
    numbers = unwrapped_by_clock(NUMBER.raw(words), NUMBER.length, ticks, TICK.length)
    fresh = ascending(numbers)
    kept, came = words[fresh], numbers[fresh]
    first, last = (int(numbers[0]), int(came[-1])) if len(rows) else (0, -1)
    return Counts(
        sequence=came,
        tick=ticks[fresh],
        positive=POSITIVE.raw(kept),
        negative=NEGATIVE.raw(kept),
        host_s=block.at_s[rows[fresh]],
        tick_bits=TICK.length,
        counter_bits=POSITIVE.length,
        first=first,
        gaps=gaps_in(came, first, last),
        lost=last - first + 1 - len(came),
        dropped=len(rows) - len(came),
        restarts=count_restarts(numbers, ticks, TICK.length),
    )


def latch_frames(message: Message, at_s: NDArray[np.float64], values: dict[Signal, Integers]) -> FrameBlock:
    """Encode a frame of an input at each time, (n,), with these integers in its fields."""
    words = np.zeros(len(at_s), np.uint64)
    for signal, integers in values.items():
        words |= signal.bits(integers)
    return _frames(message, at_s, words)


def temperature_frames(at_s: NDArray[np.float64], celsius: NDArray[np.float64]) -> FrameBlock:
    """Encode a frame with the temperature at each time, (n,)."""
    raw = np.rint(celsius / CELSIUS.scale).astype(np.int64)
    return _frames(TEMPERATURE.message, at_s, CELSIUS.bits(raw))


def _frames(message: Message, at_s: NDArray[np.float64], words: NDArray[np.uint64]) -> FrameBlock:
    data = np.ascontiguousarray(words, "<u8").view(np.uint8).reshape(-1, 8)
    ids, lengths = np.full(len(at_s), message.id, np.uint32), np.full(len(at_s), message.length, np.uint8)
    return FrameBlock(ids, at_s, lengths, data)
