"""Blocks that are sorted by message: the same frames as in their order of arrival."""

import numpy as np
import pytest

from drivers.can.frame_block import FrameBlock
from drivers.can.sorted_block import SortedBlock, joined

COLUMNS = ("ids", "at_s", "dlc", "data")


def drawn(frames: int, seed: int, ids: int = 5) -> FrameBlock:
    draws = np.random.default_rng(seed)
    return FrameBlock(
        draws.integers(0, ids, frames).astype(np.uint32), np.sort(draws.uniform(0, 9, frames)),
        draws.integers(0, 9, frames).astype(np.uint8), draws.integers(0, 256, (frames, 8)).astype(np.uint8),
    )  # fmt: skip


def in_order_of_messages(block: FrameBlock) -> SortedBlock:
    messages = block.by_message(len(block))
    assert messages is not None
    return SortedBlock(block.at_s, messages)


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
        assert np.array_equal(sent.data, block.data[wanted.rows])
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
