"""Blocks that are sorted by message: the same frames as in their order of arrival."""

import numpy as np
import pytest

from drivers.can.frame_block import ERROR, NEWEST_FRAMES, FrameBlock
from drivers.can.sorted_block import SortedBlock, joined, merged
from tests.support.frames import in_order_of_messages

COLUMNS = ("ids", "at_s", "dlc", "data")


def drawn(frames: int, seed: int, ids: int = 5) -> FrameBlock:
    draws = np.random.default_rng(seed)
    return FrameBlock(
        draws.integers(0, ids, frames).astype(np.uint32), np.sort(draws.uniform(0, 9, frames)),
        draws.integers(0, 9, frames).astype(np.uint8), draws.integers(0, 256, (frames, 8)).astype(np.uint8),
    )  # fmt: skip


def check_alike(found: FrameBlock, expected: FrameBlock) -> None:
    assert len(found) == len(expected)
    for name in COLUMNS:
        column, wanted = getattr(found, name), getattr(expected, name)
        assert column.dtype == wanted.dtype
        assert np.array_equal(column, wanted)


@pytest.mark.parametrize("frames", [0, 1, 300])
def test_all_columns_are_those_of_the_frames(frames):
    block = drawn(frames, 1)
    found = in_order_of_messages(block)
    check_alike(found, block)
    some = np.arange(frames)[::3]
    check_alike(found.at(some), block.at(some))


def test_messages_are_found_by_id_and_length():
    block = drawn(300, 2)
    found = in_order_of_messages(block)
    for kind in [*{(int(each), int(length)) for each, length in zip(block.ids, block.dlc, strict=True)}, (7, 8)]:
        sent, wanted = found.sent(*kind), block.sent(*kind)
        assert np.array_equal(sent.rows, wanted.rows)
        assert np.array_equal(sent.words, block.words[wanted.rows])
    assert len(found.sent(7, 8).rows) == 0


def test_a_block_of_too_many_messages_is_not_sorted():
    block = drawn(300, 3)
    number = len(in_order_of_messages(block).by_message(300) or {})
    for each in (block, in_order_of_messages(block)):
        assert each.by_message(number - 1) is None
        assert list(each.by_message(number) or ()) == list(block.by_message(300) or ())


@pytest.mark.parametrize("ids", [5, 60])
def test_sorted_and_other_blocks_are_joined(ids):
    """With sixty identifiers there are too many messages."""
    blocks = [drawn(300, 4), drawn(20, 5), drawn(900, 6, ids)]
    expected = FrameBlock.joined(blocks)
    found = joined([in_order_of_messages(blocks[0]), blocks[1], blocks[2]])
    check_alike(found, expected)
    assert isinstance(found, SortedBlock) == (ids == 5)
    check_alike(joined([]), FrameBlock.empty())
    check_alike(joined(blocks), expected)


@pytest.mark.parametrize(("ids", "apart", "is_sorted"), [(5, 5, True), (5, 0, False), (60, 60, False)])
def test_blocks_are_merged_by_time(ids, apart, is_sorted):
    """Those that have a message in common, or too many, are not sorted. Times of one are those of the other as well."""
    block, other = drawn(300, 7, ids), drawn(40, 8, ids)
    other = FrameBlock(other.ids + np.uint32(apart), block.at_s[::8][:40], other.dlc, other.data)
    whole = FrameBlock.joined([block, other])
    expected = whole.at(np.argsort(whole.at_s, kind="stable"))
    for ours, theirs in [(block, other), (in_order_of_messages(block), in_order_of_messages(other))]:
        found = merged(ours, theirs)
        check_alike(found, expected)
        assert isinstance(found, SortedBlock) == is_sorted
    for found in (merged(block, FrameBlock.empty()), merged(FrameBlock.empty(), block)):
        check_alike(found, block)


def test_the_newest_frame_of_each_message_is_its_last_one():
    """That of one message lies before those that are looked at first."""
    block = drawn(300, 9)
    ids = np.where(np.arange(300) < 300 - NEWEST_FRAMES - 3, block.ids, block.ids % 3).astype(np.uint32)
    block = FrameBlock(ids, block.at_s, np.full(300, 8, np.uint8), block.data)
    wanted = [(0, 8), (1, 8), (4, 8), (4, 7), (9, 8)]
    for each in (block, in_order_of_messages(block)):
        found = each.newest(wanted)
        assert found.keys() == {(0, 8), (1, 8), (4, 8)}
        for (frame_id, _), sent in found.items():
            (row,) = sent.rows.tolist()
            assert row == np.flatnonzero(ids == frame_id)[-1]
            assert np.array_equal(sent.words, block.words[[row]])


@pytest.mark.parametrize("errors", [0, 4])
def test_error_frames_are_found_in_either_form(errors):
    block = drawn(50, 10)
    ids = block.ids.copy()
    ids[5 : 5 + errors] |= ERROR
    block = FrameBlock(ids, block.at_s, block.dlc, block.data)
    for each in (block, in_order_of_messages(block)):
        assert each.error_ids().tolist() == ids[5 : 5 + errors].tolist()
