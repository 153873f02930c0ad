"""Telemetry frames decoded: blocks of frames → samples of channels.

A sample is a code or a decoded value, with the time of the unit's own clock and a sequence number. By it lost frames
are detected and counted, never interpolated; samples that are duplicated, out of order or marked invalid by the unit
are dropped and counted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.can.dbc import Dbc, DbcError, Field
from drivers.can.decoded import Positions, Samples, Scale
from drivers.can.encoder_frames import PositionFormat, unwrap_by_neighbours
from drivers.can.frame_block import FrameBlock
from drivers.can.gap_detection import GapDetector
from drivers.can.sequence_numbers import Integers, ascending, count_restarts, gaps_in, unwrapped_by_clock
from drivers.dialects.can_telemetry.options import SampleOptions


@dataclass(frozen=True, slots=True)
class SampleFormat:
    """Frame format of one channel; all its fields are in one message.

    If `decoded`, values are in the unit of the DBC, else raw codes. A sample with any of the `invalid_bits` in its
    status is invalid.
    """

    value: Field
    tick: Field
    sequence: Field
    status: Field | None
    invalid_bits: int
    decoded: bool

    @property
    def scale(self) -> Scale:
        """Scale from codes to values."""
        return Scale(self.value.signal.scale, self.value.signal.offset) if self.decoded else Scale()


def sample_formats(dbc: Dbc, channels: Mapping[str, SampleOptions]) -> dict[str, SampleFormat]:
    """Resolve the names of each channel in the DBC; DbcError names those missing or spread over several messages."""
    return {name: _sample_format(dbc, name, sample) for name, sample in channels.items()}


def _sample_format(dbc: Dbc, name: str, sample: SampleOptions) -> SampleFormat:
    form = SampleFormat(
        value=dbc.field(sample.value),
        tick=dbc.field(sample.tick),
        sequence=dbc.field(sample.sequence),
        status=dbc.field(sample.status) if sample.status is not None else None,
        invalid_bits=sample.invalid_bits,
        decoded=sample.unit is not None,
    )
    fields = (form.value, form.tick, form.sequence, form.status)
    messages = {field.message.name for field in fields if field is not None}
    if len(messages) > 1:
        raise DbcError(f"channel {name} is in several messages: {', '.join(sorted(messages))}")
    return form


def unbroken(forms: Mapping[str, SampleFormat]) -> list[GapDetector]:
    """Gap detectors for an acquisition, by message: every sample."""
    distinct = {(form.sequence.message.id, form.sequence.signal.name): form for form in forms.values()}
    return [GapDetector.of(form.sequence, form.tick) for form in distinct.values()]


def first_number(form: SampleFormat, block: FrameBlock) -> int | None:
    """Sequence number in the first frame of a channel in a block, as sent; None without a frame."""
    words = form.value.message.sent_in(block).words
    return int(form.sequence.signal.raw(words[:1])[0]) if len(words) else None


def decode_samples(form: SampleFormat, block: FrameBlock, from_number: int | None = None) -> Samples:
    """Decode the samples of one channel in a block; their numbers are unwrapped from the first, or `from_number`."""
    rows, words = form.value.message.sent_in(block)
    tick = form.tick.signal
    ticks = tick.raw(words)
    numbers = _numbers(form, words, from_number)
    first, last = (int(numbers[0]), int(numbers.max())) if len(rows) else (0, -1)
    fresh = ascending(numbers)
    usable = fresh & _valid(form, words)
    signal, kept = form.value.signal, words[usable]
    return Samples(
        sequence=numbers[usable],
        tick=ticks[usable],
        values=signal.physical(kept) if form.decoded else signal.raw(kept).astype(np.float64),
        host_s=block.at_s[rows[usable]],
        tick_bits=tick.length,
        first=first,
        gaps=gaps_in(numbers[fresh], first, last),
        lost=last - first + 1 - int(np.count_nonzero(fresh)),
        dropped=int(np.count_nonzero(~fresh)),
        invalid=int(np.count_nonzero(fresh & ~usable)),
        restarts=count_restarts(numbers, ticks, tick.length),
    )


def _numbers(form: SampleFormat, words: NDArray[np.uint64], from_number: int | None) -> Integers:
    """Unwrapped numbers of samples, of which the first is `from_number`, or as it was sent."""
    number, tick = form.sequence.signal, form.tick.signal
    numbers = unwrapped_by_clock(number.raw(words), number.length, tick.raw(words), tick.length)
    return numbers if from_number is None or not len(numbers) else numbers + (from_number - numbers[0])


def decode_positions(
    form: SampleFormat, encoder: PositionFormat, block: FrameBlock, from_number: int | None = None
) -> Positions:
    """Decode encoder positions at the ends of the samples of a channel, one row for each valid sample that has one."""
    samples = decode_samples(form, block, from_number)
    sent, of_samples = encoder.sequence.message.sent_in(block), form.value.message.sent_in(block)
    known = _numbers(form, of_samples.words, from_number)
    own = encoder.sequence.signal
    bits = min(own.length, form.sequence.signal.length)  # a longer number has no counterpart in the samples
    ahead = ascending(known)
    numbers, fresh = unwrap_by_neighbours(sent.rows, own.raw(sent.words), bits, of_samples.rows[ahead], known[ahead])
    sequence, of_sample, of_encoder = np.intersect1d(
        samples.sequence, numbers[fresh], assume_unique=True, return_indices=True
    )
    return Positions(
        sequence=sequence,
        tick=samples.tick[of_sample],
        position=encoder.position.signal.raw(sent.words[fresh][of_encoder]),
        host_s=samples.host_s[of_sample],
        tick_bits=samples.tick_bits,
        position_bits=encoder.position.signal.length,
        lost=len(samples.sequence) - len(sequence),
        restarts=0,
    )


def arrivals(form: SampleFormat, block: FrameBlock) -> tuple[Integers, Integers, NDArray[np.float64]]:
    """Raw sequence numbers, codes and arrival times of all samples in a block."""
    sent = form.value.message.sent_in(block)
    return form.sequence.signal.raw(sent.words), form.value.signal.raw(sent.words), block.at_s[sent.rows]


def _valid(form: SampleFormat, words: NDArray[np.uint64]) -> NDArray[np.bool_]:
    if form.status is None:
        return np.ones(len(words), dtype=bool)
    return np.asarray(form.status.signal.raw(words) & form.invalid_bits == 0)
