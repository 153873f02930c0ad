"""Blocks of frames as they are stored: read as they were written, small where messages recur, told where damaged."""

import hashlib
import zlib
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.errors import StoreError
from bench.store.blocks import FEWEST_BY_MESSAGE, Packed, content_in, content_of, packed, unpack, unpack_all
from drivers.can.frame_block import ERROR, EXTENDED, FrameBlock
from drivers.can.sorted_block import MOST_MESSAGES
from tests.support.frames import counted

COLUMNS = ("ids", "at_s", "dlc", "data")
IDS = [0x100, 0x101, EXTENDED | 0x101, ERROR | 0x20, 0x7FF]


def stored(block: FrameBlock) -> Packed:
    return packed(content_of(block), len(block))


def check_alike(found: FrameBlock, expected: FrameBlock) -> None:
    for name in COLUMNS:
        column, wanted = getattr(found, name), getattr(expected, name)
        assert column.dtype == wanted.dtype, name
        assert np.array_equal(column, wanted), name


def drawn(frames: int, seed: int, ids: int = len(IDS)) -> FrameBlock:
    """Frames of any message with any data, at times of whole ns that may go back."""
    draws = np.random.default_rng(seed)
    at_ns = np.cumsum(draws.choice([0, 0, 1, 999_999, 10**9, -5_000_000], frames))
    return FrameBlock(
        draws.choice(np.array(IDS + list(range(0x200, 0x600)), np.uint32)[:ids], frames),
        at_ns / 1e9,
        draws.integers(0, 9, frames).astype(np.uint8),
        draws.integers(0, 256, (frames, 8)).astype(np.uint8),
    )


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 2000), st.integers(0, 10**6), st.integers(1, 140))
def test_blocks_are_read_as_they_were_written(frames, seed, ids):
    block = drawn(frames, seed, ids)
    check_alike(unpack(stored(block)), block)


@pytest.mark.parametrize("by_message", [False, True])
def test_a_message_of_either_byte_order_and_of_any_changes(by_message):
    count = FEWEST_BY_MESSAGE if by_message else FEWEST_BY_MESSAGE - 1
    for kind in ("<u8", ">u8"):
        number = np.arange(count, dtype=np.uint64)
        words = (number * 1000 << np.uint64(16) | number & np.uint64(0xFFFF)).astype(kind)
        data = words.view(np.uint8).reshape(-1, 8)
        block = FrameBlock(np.full(count, 5, np.uint32), number / 100, np.full(count, 8, np.uint8), data)
        content = content_of(block)
        assert content.by_message == by_message
        check_alike(unpack(packed(content, count)), block)
        assert not by_message or len(content.plain) < 3 * count


def test_counts_take_less_than_a_byte_a_frame():
    block = counted(6000)
    assert len(stored(block).data) < 0.2 * len(block)
    check_alike(unpack(stored(block)), block)


def test_blocks_of_both_forms_are_joined():
    blocks = [counted(3000), drawn(20, 1), drawn(1200, 2), drawn(1200, 3, ids=200)]
    assert [content_of(each).by_message for each in blocks] == [True, False, True, False]
    for some in (blocks[:1], blocks[:3], blocks[1:2], blocks):
        check_alike(unpack_all(list(map(stored, some))), FrameBlock.joined(some))


def test_many_messages_are_stored_plain():
    ids = np.arange(MOST_MESSAGES + 1, dtype=np.uint32).repeat(20)
    block = FrameBlock(
        ids, np.arange(len(ids)) / 1e3, np.full(len(ids), 8, np.uint8), np.zeros((len(ids), 8), np.uint8)
    )
    assert not content_of(block).by_message
    check_alike(unpack(stored(block)), block)


def test_the_bytes_of_a_format_never_change():
    """They are what digests are made of: other bytes need another number of the format."""
    found = [hashlib.sha256(content_of(block).plain).hexdigest()[:16] for block in (counted(700), counted(100))]
    assert found == ["a7ff1cd74df47109", "5475ebee4b4bd0d9"]


@pytest.mark.parametrize("frames", [30, 1200])
@pytest.mark.parametrize("offset", range(0, 100, 7))
def test_a_block_with_one_bit_flipped_is_told_never_returned(frames, offset):
    data, _, crc = stored(drawn(frames, 1))
    damaged = bytearray(data)
    damaged[offset % len(damaged)] ^= 0x10
    with pytest.raises(StoreError, match=f"a block of {frames} frames is damaged"):
        unpack(Packed(bytes(damaged), frames, crc))


@pytest.mark.parametrize("block", [counted(600), drawn(3, 1)])
def test_what_is_no_block_is_told_as_damaged(block):
    data, frames, crc = stored(block)
    assert content_in(Packed(data, frames, crc)) == content_of(block)
    for wrong in (("text", frames, crc), (data, "3", crc), (data, -1, crc), (data, 10**9, crc)):
        with pytest.raises(StoreError, match=f"^a block of {wrong[1]} frames is damaged$"):
            unpack(Packed(*wrong))
    for other in ((data, frames, crc + 1), (data, frames - 1, crc), (data[:-9], frames, crc), (data[1:], frames, crc)):
        with pytest.raises(StoreError, match=f"^a block of {other[1]} frames is damaged"):
            unpack(Packed(*other))


@pytest.mark.parametrize("place", range(0, 250, 7))
def test_a_forged_block_is_told_as_damaged_or_is_a_block(place):
    """Its checksum is right, as somebody would make it; the chain finds it (`test_chain`), nothing fails otherwise."""
    block = counted(600)
    for value in (0, 1, 0x7F, 0xFF):
        plain = bytearray(content_of(block).plain)
        plain[place] = value
        forged = Packed(b"\x01" + zlib.compress(plain), len(block), zlib.crc32(plain))
        with suppress(StoreError):
            found = unpack(forged)
            assert [len(getattr(found, name)) for name in COLUMNS] == [len(block)] * 4
    for part in (plain[:place], plain + b"0"):
        with pytest.raises(StoreError, match="is damaged"):
            unpack(Packed(b"\x01" + zlib.compress(part), len(block), zlib.crc32(part)))
