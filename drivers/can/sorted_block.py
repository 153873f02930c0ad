"""A block of CAN frames that are sorted by message, as decoders want them; its columns are made when asked for."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.can.frame_block import ERROR, FrameBlock, Kind, Sent

Scalar = TypeVar("Scalar", bound=np.generic)
MOST_MESSAGES = 100  # of a block that is sorted; for more of them it is not worth it
_NOTHING = Sent(np.empty(0, np.intp), np.empty(0, np.uint64))


class SortedBlock(FrameBlock):
    """CAN frames in order of arrival, at times `at_s` (N,), given by message; each row belongs to one message."""

    def __init__(self, at_s: NDArray[np.float64], messages: Mapping[Kind, Sent]) -> None:
        object.__setattr__(self, "at_s", at_s)
        object.__setattr__(self, "_messages", messages)

    _messages: Mapping[Kind, Sent]

    def sent(self, frame_id: int, length: int) -> Sent:
        """Frames of the message with this id and length."""
        return self._messages.get((frame_id, length), _NOTHING)

    def newest(self, wanted: Collection[Kind]) -> dict[Kind, Sent]:
        """Last frame of each of these messages, without those that have none."""
        found = {kind: self._messages[kind] for kind in wanted if kind in self._messages}
        return {kind: Sent(sent.rows[-1:], sent.words[-1:]) for kind, sent in found.items()}

    def error_ids(self) -> NDArray[np.uint32]:
        """Identifiers of the error frames."""
        has_any = any(frame_id & ERROR for frame_id, _ in self._messages)
        return super().error_ids() if has_any else np.empty(0, np.uint32)

    def by_message(self, most: int) -> Mapping[Kind, Sent] | None:
        """Frames of each message; None if there are more than `most` messages."""
        return self._messages if len(self._messages) <= most else None

    @cached_property
    def ids(self) -> NDArray[np.uint32]:
        """Identifiers (N,), as in a FrameBlock."""
        return self._column(np.uint32, (frame_id for frame_id, _ in self._messages))

    @cached_property
    def dlc(self) -> NDArray[np.uint8]:
        """Lengths (N,)."""
        return self._column(np.uint8, (length for _, length in self._messages))

    @cached_property
    def data(self) -> NDArray[np.uint8]:
        """Data (N, 8)."""
        words = self._column(np.uint64, (sent.words for sent in self._messages.values()))
        return words.view(np.uint8).reshape(-1, 8)

    def _column(self, kind: type[Scalar], of_messages: Iterable[Any]) -> NDArray[Scalar]:
        """Column (N,) with a value for each message in its rows, or a value (n,) for each of its frames."""
        column = np.empty(len(self), kind)
        for sent, values in zip(self._messages.values(), of_messages, strict=True):
            column[sent.rows] = values
        return column


def joined(blocks: Sequence[FrameBlock]) -> FrameBlock:
    """Concatenate blocks; the result is sorted if one of them is, unless there are too many messages."""
    if len(blocks) == 1 or not any(isinstance(block, SortedBlock) for block in blocks):
        return FrameBlock.joined(blocks)
    parts: dict[Kind, list[Sent]] = {}
    begins = np.cumsum([0, *map(len, blocks)]).tolist()
    for begin, block in zip(begins, blocks, strict=False):
        messages = block.by_message(MOST_MESSAGES)
        if messages is None:
            return FrameBlock.joined(blocks)
        for kind, sent in messages.items():
            parts.setdefault(kind, []).append(Sent(sent.rows + begin, sent.words))
    return SortedBlock(
        np.concatenate([block.at_s for block in blocks]),
        {kind: Sent(*map(np.concatenate, zip(*sent, strict=True))) for kind, sent in parts.items()},
    )


def merged(block: FrameBlock, other: FrameBlock) -> FrameBlock:
    """Merge two blocks by time; at equal times, frames of the first come before those of the other.

    The result is sorted unless both have a message in common, or too many.
    """
    if not len(other):
        return block
    ours, theirs = block.by_message(MOST_MESSAGES), other.by_message(MOST_MESSAGES)
    if ours is None or theirs is None or ours.keys() & theirs.keys():
        whole = FrameBlock.joined([block, other])
        return whole.at(np.argsort(whole.at_s, kind="stable"))
    before = block.at_s.searchsorted(other.at_s, side="right")  # frames of the first before each of the other
    their_rows = np.arange(len(other)) + before
    our_rows = np.arange(len(block)) + np.arange(len(other) + 1).repeat(np.diff(before, prepend=0, append=len(block)))
    messages = {kind: Sent(our_rows.take(sent.rows), sent.words) for kind, sent in ours.items()}
    messages |= {kind: Sent(their_rows.take(sent.rows), sent.words) for kind, sent in theirs.items()}
    at_s = np.empty(len(block) + len(other))
    at_s[our_rows], at_s[their_rows] = block.at_s, other.at_s
    return SortedBlock(at_s, messages)
