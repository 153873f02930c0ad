r"""The serial-line CAN protocol of LAWICEL adapters (`t1008112233…\r`), a block at a time, both directions.

Hexadecimal is converted by tables for whole blocks of equally long lines, never frame by frame.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.can.frame_block import EXTENDED, FrameBlock
from drivers.transport.alike import NIBBLES, Arrivals, bytes_of

BITRATES = {
    10_000: b"S0", 20_000: b"S1", 50_000: b"S2", 100_000: b"S3", 125_000: b"S4", 250_000: b"S5", 500_000: b"S6",
    800_000: b"S7", 1_000_000: b"S8",
}  # fmt: skip
END = b"\r"
REFUSED = b"\a"
CLOSE, OPEN = b"C", b"O"

_DIGITS = np.frombuffer(b"0123456789ABCDEF", np.uint8)
_IDENTIFIERS = {ord("t"): (3, 8), ord("T"): (8, 2)}  # number of digits, and limit of the first one: 11 and 29 bits


def parse(data: bytes, arrivals: Arrivals) -> tuple[FrameBlock, bytes, int]:
    """Parse the frames in `data`; also return the rest of an incomplete line, and the number of invalid lines.

    A frame has the time of arrival of its end. Acknowledgements (BEL, empty lines, `z`, `Z`) are neither frames nor
    errors.
    """
    data = data.replace(REFUSED, END)
    cut = data.rfind(END) + 1
    whole, rest = data[:cut], data[cut:]
    characters = np.frombuffer(whole, np.uint8)
    ends = np.flatnonzero(characters == END[0])
    starts = np.concatenate(([0], ends[:-1] + 1)) if len(ends) else ends
    lengths = ends - starts
    order: list[NDArray[np.intp]] = []
    blocks: list[FrameBlock] = []
    for length in np.flatnonzero(np.bincount(lengths)):
        rows = np.flatnonzero(lengths == length)
        lines = characters[starts[rows, None] + np.arange(length)]
        for kind in _IDENTIFIERS:
            good, block = _frames(lines, kind, arrivals.of_bytes(ends[rows]))
            order.append(rows[good])
            blocks.append(block)
    position = np.concatenate(order) if order else np.empty(0, np.intp)
    heads = characters[starts[lengths > 0]]
    spoken = np.count_nonzero(lengths > 0) - np.count_nonzero((heads == ord("z")) | (heads == ord("Z")))
    found, order_of_lines = FrameBlock.joined(blocks), np.argsort(position, kind="stable")
    return found.at(order_of_lines), rest, int(spoken - len(position))


def answer(data: bytes) -> tuple[bool | None, bytes]:
    """Find the adapter's answer to a command among frames; also return the rest of an incomplete line.

    True is an acknowledgement (empty line), False a refusal (BEL), None means no answer yet.
    """
    *lines, rest = data.replace(REFUSED, END).split(END)
    return (False if REFUSED in data else True if b"" in lines else None), rest


def _frames(lines: NDArray[np.uint8], kind: int, at_s: NDArray[np.float64]) -> tuple[NDArray[np.bool_], FrameBlock]:
    """Select the frames of one kind from equally long lines; return their mask and the frames."""
    id_digits, first_below = _IDENTIFIERS[kind]
    digits = lines.shape[1] - 2 - id_digits
    if digits < 0 or digits > 16 or digits % 2:
        return np.zeros(len(lines), dtype=bool), FrameBlock.empty()
    nibbles = NIBBLES[lines[:, 1:]]
    good = (lines[:, 0] == kind) & (nibbles < 16).all(axis=1)
    good &= (nibbles[:, 0] < first_below) & (nibbles[:, id_digits] == digits // 2)
    nibbles = nibbles[good]
    weights = 16 ** np.arange(id_digits - 1, -1, -1, dtype=np.uint32)
    data = bytes_of(nibbles[:, id_digits + 1 :])
    ids = (nibbles[:, :id_digits].astype(np.uint32) * weights).sum(axis=1, dtype=np.uint32)
    if kind == ord("T"):
        ids |= np.uint32(EXTENDED)
    count = len(nibbles)
    return good, FrameBlock(ids, at_s[good], np.full(count, digits // 2, np.uint8), data)


def render(block: FrameBlock) -> bytes:
    """Encode lines as an adapter sends them, in the order of the block."""
    lines: list[bytes] = [b""] * len(block)
    for extended in (False, True):
        for length in range(9):
            rows = np.flatnonzero(((block.ids >= EXTENDED) == extended) & (block.dlc == length))
            if not len(rows):
                continue
            id_digits = 8 if extended else 3
            shifts = np.arange(4 * (id_digits - 1), -1, -4, dtype=np.uint32)
            text = np.empty((len(rows), 1 + id_digits + 1 + 2 * length + 1), np.uint8)
            text[:, 0] = ord("T") if extended else ord("t")
            text[:, 1 : 1 + id_digits] = _DIGITS[((block.ids[rows, None] & ~np.uint32(EXTENDED)) >> shifts) & 15]
            text[:, 1 + id_digits] = _DIGITS[length]
            payload = block.data[rows, :length]
            text[:, 2 + id_digits : -1 : 2] = _DIGITS[payload >> 4]
            text[:, 3 + id_digits : -1 : 2] = _DIGITS[payload & 15]
            text[:, -1] = END[0]
            for row, line in zip(rows.tolist(), text, strict=True):
                lines[row] = line.tobytes()
    return b"".join(lines)
