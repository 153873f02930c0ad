"""Frames that follow their latches are found by their place, and so are those of cycles; nothing else is found so."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from drivers.can.frame_block import FrameBlock
from drivers.can.frame_cycles import cycles_of
from drivers.dialects.can_counter import wire
from drivers.dialects.can_counter.wire import Counts, decode_counts
from tests.support.frames import in_order_of_messages
from tests.support.laboratory import counter_form

FORM = counter_form()
LATCH, AXES, TEMPERATURES = 0x100, {"x": 0x101, "y": 0x102, "z": 0x103}, 0x110
FOREIGN = 0x7FF
CYCLE = 1 + len(AXES)
SPOILT = ["drop", "double", "cycle again", "foreign", "short", "swap", "other number"]

Row = list[int]  # an id, a length, the number of its latch


def row(frame_id: int, number: int) -> Row:
    return [frame_id, 6 if frame_id == TEMPERATURES else 8, number]


def night(latches: int, first: int, warmest: int) -> list[Row]:
    """A healthy counter: axes after every latch, temperatures after every `warmest`-th."""
    rows = []
    for number in range(first, first + latches):
        rows += [row(frame_id, number) for frame_id in (LATCH, *AXES.values())]
        if number % warmest == 0:
            rows.append(row(TEMPERATURES, number))
    return rows


def block(rows: list[Row]) -> FrameBlock:
    data = np.zeros((len(rows), 8), np.uint8)
    for bytes_of, (frame_id, _, number) in zip(data, rows, strict=True):
        low, high = number & 0xFF, number >> 8 & 0xFF
        if frame_id == LATCH:
            bytes_of[:6] = [*(100 * number).to_bytes(4, "little"), low, high]
        else:
            bytes_of[:8] = [low, high, 0, frame_id & 0xFF, 0, 0, low, high]
    ids, dlc = np.array([each[:2] for each in rows], np.uint32).reshape(-1, 2).T
    return FrameBlock(ids.copy(), np.arange(len(rows)) / 1000, dlc.astype(np.uint8), data)


def by_numbers(channel: str, frames: FrameBlock) -> Counts:
    """Counts without the short cut for frames that follow their latches."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(wire, "_ahead_of_step", lambda *_: None)
        return decode_counts(FORM, channel, frames)


def check_alike(found: Counts, expected: Counts) -> None:
    for name in Counts._fields:
        assert np.array_equal(getattr(found, name), getattr(expected, name)), name


@pytest.mark.lengthy
@settings(max_examples=400, deadline=None)
@given(
    latches=st.integers(0, 12),
    first=st.sampled_from([0, 7, 0xFFFA]),
    warmest=st.integers(1, 5),
    head=st.integers(0, 6),
    tail=st.integers(0, 6),
    damaged=st.lists(st.tuples(st.integers(0, 60), st.sampled_from(SPOILT)), max_size=2),
)
@example(latches=6, first=0, warmest=3, head=2, tail=3, damaged=[])
@example(latches=3, first=7, warmest=5, head=0, tail=1, damaged=[(10, "short")])
@example(latches=2, first=0, warmest=1, head=1, tail=0, damaged=[(0, "other number")])  # a late frame at the head
def test_counts_are_the_same(
    latches: int, first: int, warmest: int, head: int, tail: int, damaged: list[tuple[int, str]]
) -> None:
    rows = night(latches, first, warmest)
    rows = rows[head : len(rows) - tail]
    for at, how in (each for each in damaged if each[0] < len(rows)):
        if how == "drop":
            del rows[at]
        elif how == "short":
            rows[at] = [rows[at][0], 5, rows[at][2]]
        elif how == "swap":
            rows[at], rows[at - 1] = rows[at - 1], rows[at]
        elif how == "cycle again":
            rows[at:at] = rows[max(at - CYCLE, 0) : at]
        elif how == "other number":
            rows[at] = row(rows[at][0], rows[at][2] + 1)
        else:
            rows.insert(at, row(FOREIGN, 0) if how == "foreign" else rows[at])
    frames = block(rows)
    for channel in AXES:
        expected = by_numbers(channel, frames)
        check_alike(decode_counts(FORM, channel, frames), expected)
        check_alike(decode_counts(FORM, channel, in_order_of_messages(frames)), expected)


@pytest.mark.parametrize(("head", "tail", "whole"), [(0, 0, 9), (2, 0, 8), (0, 2, 9), (3, 3, 7)])
def test_a_healthy_counter_sends_in_cycles(head: int, tail: int, whole: int) -> None:
    rows = night(9, 1, warmest=4)  # begins with the latch 1, temperatures come after the latches 4 and 8
    frames = block(rows[head : len(rows) - tail])
    cycles = cycles_of(frames, FORM.sequence.message.rows(frames))
    found = cycles.rows(FORM.channels["x"].sequence.message)
    assert found is not None
    assert len(found) == whole
    assert set(frames.ids[found].tolist()) == {AXES["x"]}


def test_what_comes_elsewhere_as_well_is_in_no_cycle() -> None:
    rows = night(9, 1, warmest=100)
    frames = block([*rows[:8], row(AXES["y"], 1), *rows[8:]])
    cycles = cycles_of(frames, FORM.sequence.message.rows(frames))
    assert cycles.rows(FORM.channels["y"].sequence.message) is None


def test_what_comes_twice_in_each_cycle_is_found_twice() -> None:
    rows = [each for row in night(9, 1, warmest=100) for each in [row] * (2 if row[0] == AXES["y"] else 1)]
    found = decode_counts(FORM, "y", block(rows))
    assert found.dropped == 9
    check_alike(found, by_numbers("y", block(rows)))
