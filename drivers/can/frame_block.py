"""CAN frames as blocks of arrays, as delivered by counters and kept by the store."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

EXTENDED = 1 << 31  # set in the id of a frame with a 29-bit identifier, as SocketCAN does
ERROR = 1 << 29  # set in the id of an error frame, whose other bits are its classes, as SocketCAN does
NEWEST_FRAMES = 64  # rows searched first for the newest frame of each message

Kind = tuple[int, int]
"""Id and length, by which messages are told apart."""


class Sent(NamedTuple):
    """Frames of one message in a block: `rows` (n,) in order, and their data as 64-bit words, (n,)."""

    rows: NDArray[np.intp]
    words: NDArray[np.uint64]


@dataclass(frozen=True, slots=True)
class FrameBlock:
    """CAN frames in order of arrival, including error frames.

    `ids` (N,) uint32 (29-bit ones with EXTENDED set, those of error frames with ERROR), `at_s` (N,) float64 loop time
    of arrival, `dlc` (N,) uint8, `data` (N, 8) uint8, zero past dlc.
    """

    ids: NDArray[np.uint32]
    at_s: NDArray[np.float64]
    dlc: NDArray[np.uint8]
    data: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.at_s)

    @property
    def words(self) -> NDArray[np.uint64]:
        """Data of each frame as one 64-bit word, (N,)."""
        return self.data.view(np.uint64).ravel()

    def sent(self, frame_id: int, length: int) -> Sent:
        """Frames of the message with this id and length."""
        rows = np.flatnonzero((self.ids == frame_id) & (self.dlc == length))
        return Sent(rows, self.words.take(rows))

    def newest(self, wanted: Collection[Kind]) -> dict[Kind, Sent]:
        """Last frame of each of these messages, without those that have none."""
        for begin in (max(len(self) - NEWEST_FRAMES, 0), 0):
            kinds = zip(self.ids[begin:].tolist(), self.dlc[begin:].tolist(), strict=True)
            rows = {kind: row for row, kind in enumerate(kinds, start=begin)}
            if rows.keys() >= set(wanted):
                break
        found = {kind: np.array([rows[kind]]) for kind in wanted if kind in rows}
        return {kind: Sent(row, self.words.take(row)) for kind, row in found.items()}

    def error_ids(self) -> NDArray[np.uint32]:
        """Identifiers of the error frames."""
        return np.asarray(self.ids[(self.ids & np.uint32(ERROR)) != 0], np.uint32)

    def by_message(self, most: int) -> Mapping[Kind, Sent] | None:
        """Frames of each message, in order of their first ones; None if there are more than `most` messages."""
        found: dict[Kind, Sent] = {}
        is_found, row = np.zeros(len(self), bool), 0
        while row < len(self) and not is_found[row]:
            if len(found) == most:
                return None
            kind = int(self.ids[row]), int(self.dlc[row])
            found[kind] = self.sent(*kind)
            is_found[found[kind].rows] = True
            row += int(is_found[row:].argmin())
        return found

    def at(self, rows: NDArray[np.intp]) -> FrameBlock:
        """Frames in these rows, in their order."""
        data = self.words.take(rows).view(np.uint8).reshape(-1, 8)
        return FrameBlock(self.ids[rows], self.at_s[rows], self.dlc[rows], data)

    @classmethod
    def of(cls, frames: Sequence[tuple[float, int, bytes]]) -> FrameBlock:
        """Build a block from times, identifiers and data."""
        data = b"".join(payload.ljust(8, b"\0") for _, _, payload in frames)
        return cls(
            np.array([frame_id for _, frame_id, _ in frames], np.uint32),
            np.array([at_s for at_s, _, _ in frames], np.float64),
            np.array([len(payload) for _, _, payload in frames], np.uint8),
            np.frombuffer(data, np.uint8).reshape(-1, 8).copy(),
        )

    @classmethod
    def joined(cls, blocks: Sequence[FrameBlock]) -> FrameBlock:
        """Concatenate blocks."""
        if len(blocks) == 1:
            return blocks[0]
        if not blocks:
            return cls.empty()
        return cls(
            np.concatenate([block.ids for block in blocks]),
            np.concatenate([block.at_s for block in blocks]),
            np.concatenate([block.dlc for block in blocks]),
            np.concatenate([block.data for block in blocks]),
        )

    @classmethod
    def empty(cls) -> FrameBlock:
        """A block without frames."""
        return cls(np.empty(0, np.uint32), np.empty(0, np.float64), np.empty(0, np.uint8), np.empty((0, 8), np.uint8))
