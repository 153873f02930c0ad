"""Bytes as in the manual, never made by our own encoder."""

import numpy as np
import pytest
from drivers.can.dbc import readings_of
from drivers.can.frame_block import FrameBlock

from toy_counter import wire

FRAMES = (
    "FE 03E8 00010 00002",  # latch 254 after 1 s: 16 positive pulses, 2 negative ones
    "FF 044C 00020 00003",
    "00 04B0 00030 00004",  # the number wraps
)


def block(*frames: str, frame_id: int = 0x300) -> FrameBlock:
    data = [bytes.fromhex(each.replace(" ", "")) for each in frames]
    padded = np.array([list(each.ljust(8, b"\0")) for each in data], np.uint8).reshape(-1, 8)
    lengths = np.array([len(each) for each in data], np.uint8)
    return FrameBlock(np.full(len(data), frame_id, np.uint32), np.arange(len(data)) / 10, lengths, padded)


def test_counts_are_read():
    found = wire.counts_in(wire.latch(0), block(*FRAMES))
    assert found.sequence.tolist() == [254, 255, 256]
    assert found.tick.tolist() == [1000, 1100, 1200]
    assert found.positive.tolist() == [16, 32, 48]
    assert found.negative.tolist() == [2, 3, 4]
    assert (found.tick_bits, found.counter_bits, found.lost, found.dropped, found.restarts) == (16, 20, 0, 0, 0)
    assert found.gaps.tolist() == []


def test_a_lost_frame_is_a_gap_and_one_that_comes_twice_is_dropped():
    lossy = wire.counts_in(wire.latch(0), block(FRAMES[0], FRAMES[2]))
    assert (lossy.gaps.tolist(), lossy.lost) == ([[255, 255]], 1)
    doubled = wire.counts_in(wire.latch(0), block(FRAMES[0], FRAMES[0], FRAMES[1]))
    assert (doubled.sequence.tolist(), doubled.dropped, doubled.lost) == ([254, 255], 1, 0)


def test_frames_of_another_input_or_length_are_none_of_its_own():
    assert len(wire.counts_in(wire.latch(0), block(*FRAMES, frame_id=0x301)).sequence) == 0
    assert len(wire.counts_in(wire.latch(0), block("FE 03E8 0001")).sequence) == 0


@pytest.mark.parametrize(("frame", "celsius"), [("09C4", 25.0), ("F060", -40.0)])
def test_a_temperature_is_read(frame, celsius):
    found = readings_of({"temperature": wire.TEMPERATURE}, block(frame, frame_id=0x3F0))
    assert found["temperature"][1].tolist() == [pytest.approx(celsius)]


def test_what_the_simulator_sends_is_what_the_manual_says():
    numbers = np.array([254, 255, 256])
    values = {
        wire.NUMBER: numbers, wire.TICK: 1000 + 100 * (numbers - 254), wire.POSITIVE: 16 * (numbers - 253),
        wire.NEGATIVE: numbers - 252,
    }  # fmt: skip
    sent = wire.latch_frames(wire.latch(0), np.arange(3) / 10, values)
    assert sent.data.tolist() == block(*FRAMES).data.tolist()
    cold = wire.temperature_frames(np.zeros(1), np.array([-40.0]))
    assert cold.data[0].tobytes() == bytes.fromhex("F060") + bytes(6)
