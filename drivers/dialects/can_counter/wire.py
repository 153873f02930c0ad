"""Counter frames in both directions: blocks of frames ⇄ latches, counts and temperatures.

Frames of one latch carry its sequence number. By it lost frames are detected and counted, never interpolated;
duplicated frames and frames out of order are dropped and counted.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.can.dbc import Dbc, Field, readings_of
from drivers.can.decoded import Counts, Positions
from drivers.can.encoder_frames import PositionFormat, position_formats, unwrap_by_neighbours
from drivers.can.frame_block import FrameBlock
from drivers.can.gap_detection import GapDetector
from drivers.can.options import PositionOptions
from drivers.can.sequence_numbers import Integers, ascending, count_restarts, gaps_in, unwrapped_by_clock
from drivers.dialects.can_counter.options import ChannelOptions, LatchOptions


class ChannelFormat(NamedTuple):
    """Signals of one pair of counters."""

    positive: Field
    negative: Field
    sequence: Field


class CounterFormat(NamedTuple):
    """Frame format of a counter: latch, channels and encoders by name, and readings by `Message.Signal`."""

    tick: Field
    tick_period_s: float
    sequence: Field
    boot_count: Field | None
    channels: Mapping[str, ChannelFormat]
    temperatures: Mapping[str, Field]
    positions: Mapping[str, PositionFormat]


def counter_format(
    dbc: Dbc, latch: LatchOptions, channels: Mapping[str, ChannelOptions], positions: Mapping[str, PositionOptions]
) -> CounterFormat:
    """Resolve the names of the options in the DBC; DbcError names the missing ones."""
    return CounterFormat(
        tick=dbc.field(latch.tick),
        tick_period_s=latch.tick_period,
        sequence=dbc.field(latch.sequence),
        boot_count=dbc.field(latch.boot_count) if latch.boot_count is not None else None,
        channels={
            name: ChannelFormat(dbc.field(pair.positive), dbc.field(pair.negative), dbc.field(pair.sequence))
            for name, pair in channels.items()
        },
        temperatures=dbc.readings,
        positions=position_formats(dbc, positions),
    )


def unbroken(form: CounterFormat) -> GapDetector:
    """Gap detector for an acquisition: every latch, with the counts of each channel."""
    return GapDetector.of(form.sequence, form.tick, [pair.sequence for pair in form.channels.values()])


class Latches(NamedTuple):
    """Latches of a block: rows, arrival times, ticks and sequence numbers, raw and unwrapped.

    `fresh` marks numbers above all before them, `newest` is the highest, -1 without a latch.
    """

    rows: NDArray[np.intp]
    host_s: NDArray[np.float64]
    tick: Integers
    raw: Integers
    numbers: Integers
    fresh: NDArray[np.bool_]
    newest: int
    restarts: int


def latches_of(form: CounterFormat, block: FrameBlock) -> Latches:
    """Latches of a block, with which the frames of all channels are paired."""
    rows, words, raw = _numbered(form.sequence, block)
    ticks, tick_bits = form.tick.signal.raw(words), form.tick.signal.length
    numbers = unwrapped_by_clock(raw, form.sequence.signal.length, ticks, tick_bits)
    boots = form.boot_count.signal.raw(words) if form.boot_count else np.empty(0, np.int64)
    restarts = int(np.count_nonzero(np.diff(boots))) or count_restarts(numbers, ticks, tick_bits)
    newest = int(numbers.max()) if len(numbers) else -1
    return Latches(rows, block.at_s.take(rows), ticks, raw, numbers, ascending(numbers), newest, restarts)


class _Paired(NamedTuple):
    """Frames of one message, their data as words (N,), their latches, and the number of dropped frames."""

    sequence: Integers
    tick: Integers
    other: NDArray[np.uint64]
    host_s: NDArray[np.float64]
    first: int
    last: int
    lost: int
    dropped: int
    restarts: int


def decode_counts(form: CounterFormat, channel: str, block: FrameBlock, latches: Latches | None = None) -> Counts:
    """Decode the counts of one channel in a block, paired with its latches, which are found unless given."""
    pair = form.channels[channel]
    found = _paired(form, pair.sequence, block, latches or latches_of(form, block))
    return Counts(
        sequence=found.sequence,
        tick=found.tick,
        positive=pair.positive.signal.raw(found.other),
        negative=pair.negative.signal.raw(found.other),
        host_s=found.host_s,
        tick_bits=form.tick.signal.length,
        counter_bits=pair.positive.signal.length,
        first=found.first,
        gaps=gaps_in(found.sequence, found.first, found.last),
        lost=found.lost,
        dropped=found.dropped,
        restarts=found.restarts,
    )


def decode_positions(form: CounterFormat, name: str, block: FrameBlock, latches: Latches | None = None) -> Positions:
    """Decode the positions of one encoder, paired with the latches as counts are."""
    encoder = form.positions[name]
    found = _paired(form, encoder.sequence, block, latches or latches_of(form, block))
    return Positions(
        sequence=found.sequence,
        tick=found.tick,
        position=encoder.position.signal.raw(found.other),
        host_s=found.host_s,
        tick_bits=form.tick.signal.length,
        position_bits=encoder.position.signal.length,
        lost=found.lost,
        restarts=found.restarts,
    )


def _paired(form: CounterFormat, other: Field, block: FrameBlock, latches: Latches) -> _Paired:
    """Pair the frames with a sequence number `other` with their latches."""
    sequence, tick, host_s, stale = latches.numbers, latches.tick, latches.host_s, 0
    rows, words, raw = _numbered(other, block)
    ahead = _ahead_of_step(form, other, rows, raw, latches)
    if ahead is not None:
        words = words[ahead:]
        if len(words) < len(sequence):
            sequence, tick, host_s = sequence[:-1], tick[:-1], host_s[:-1]
    else:
        bits = min(
            other.signal.length, form.sequence.signal.length
        )  # sequence numbers of a longer signal have no counterpart in the latches
        rising = latches.fresh
        numbers, fresh = unwrap_by_neighbours(rows, raw, bits, latches.rows[rising], latches.numbers[rising])
        sequence, latch_places, other_places = np.intersect1d(
            latches.numbers[rising], numbers[fresh], assume_unique=True, return_indices=True
        )
        of_latch = np.flatnonzero(rising)[latch_places]
        tick, host_s, words = tick[of_latch], host_s[of_latch], words[np.flatnonzero(fresh)[other_places]]
        stale = int(np.count_nonzero(~latches.fresh) + np.count_nonzero(~fresh))
    first = int(latches.numbers[0]) if len(latches.rows) else 0
    last = latches.newest
    if len(latches.rows) and (not len(sequence) or sequence[-1] != last):
        last -= 1  # its other frames may arrive after the end
    return _Paired(
        sequence=sequence,
        tick=tick,
        other=words,
        host_s=host_s,
        first=first,
        last=last,
        lost=last - first + 1 - len(sequence),
        dropped=stale,
        restarts=latches.restarts,
    )


def _ahead_of_step(
    form: CounterFormat, other: Field, rows: NDArray[np.intp], raw: Integers, latches: Latches
) -> int | None:
    """Number of frames before the first latch, if after it one with its number follows each latch; else None.

    Then none is lost, late or duplicated. The last latch may lack its frame.
    """
    if not len(latches.rows) or other.signal.length != form.sequence.signal.length or not latches.fresh.all():
        return None
    ahead = int(np.searchsorted(rows, latches.rows[0]))
    after, own = rows[ahead:], latches.rows[: len(rows) - ahead]
    following = latches.rows[1 : 1 + len(after)]
    if ahead > 1 or len(after) != len(own) or len(own) < len(latches.rows) - 1:
        return None
    if (after < own).any() or (after[: len(following)] > following).any():
        return None
    if (raw[ahead:] != latches.raw[: len(own)]).any():
        return None
    earlier = int(latches.raw[0] - raw[0]) % (1 << other.signal.length) if ahead else 1
    return ahead if 0 < earlier <= 1 << (other.signal.length - 1) else None  # else frames are late or duplicated


def latches(form: CounterFormat, block: FrameBlock) -> tuple[Integers, NDArray[np.float64]]:
    """Raw sequence numbers of the latches in a block, and when they arrived."""
    rows, _, raw = _numbered(form.sequence, block)
    return raw, block.at_s[rows]


def newest_counts(form: CounterFormat, block: FrameBlock) -> dict[str, tuple[float, tuple[int, int]]]:
    """Arrival time and raw counts of the last frame of each channel in a block, without channels that have none."""
    messages = {name: pair.sequence.message for name, pair in form.channels.items()}
    newest = block.newest({(message.id, message.length) for message in messages.values()})
    found = {}
    for name, pair in form.channels.items():
        sent = newest.get((messages[name].id, messages[name].length))
        if sent is not None:
            data = sent.words.tobytes()
            counts = pair.positive.signal.raw_of(data), pair.negative.signal.raw_of(data)
            found[name] = float(block.at_s[sent.rows[0]]), counts
    return found


def temperatures(form: CounterFormat, block: FrameBlock) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Decode readings in a block by channel name: arrival times and values in their units."""
    return readings_of(form.temperatures, block)


def _numbered(sequence: Field, block: FrameBlock) -> tuple[NDArray[np.intp], NDArray[np.uint64], Integers]:
    """Rows, data and raw sequence numbers of the frames of a message."""
    sent = sequence.message.sent_in(block)
    return sent.rows, sent.words, sequence.signal.raw(sent.words)
