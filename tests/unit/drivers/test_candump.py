"""Logs of candump: read as one table, and as python-can reads them."""

from __future__ import annotations

from pathlib import Path

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.can.frame_block import EXTENDED
from drivers.transport import candump
from drivers.transport.can import frame_of, read_log

LINES = (
    b"(1690000000.000100) can0 123#0A0B\n"
    b"(1690000000.000200) can0 1ABCDEF0#FFEE\n"
    b"(1690000000.000300) vcan12 7FF#\n"
    b"(23.424242) can0 123#1122334455667788\n"
    b"(0.5) can0 00F#0a0b\n"
)
ROWS = [
    (1690000000.0001, 0x123, 2, "0a0b"),
    (1690000000.0002, 0x1ABCDEF0 | EXTENDED, 2, "ffee"),
    (1690000000.0003, 0x7FF, 0, ""),
    (23.424242, 0x123, 8, "1122334455667788"),
    (0.5, 0x00F, 2, "0a0b"),
]


def rows_of(path: Path) -> list[tuple[float, int, int, str]]:
    block = read_log("counter", path)
    return [
        (float(at_s), int(frame_id), int(dlc), data[:dlc].tobytes().hex())
        for at_s, frame_id, dlc, data in zip(block.at_s, block.ids, block.dlc, block.data, strict=True)
    ]


def log(folder: Path, data: bytes) -> Path:
    path = folder / "bus.log"
    path.write_bytes(data)
    return path


def test_lines_are_frames(tmp_path: Path) -> None:
    assert candump.parse(LINES) is not None
    assert rows_of(log(tmp_path, LINES)) == ROWS


def test_an_empty_log_is_no_error_here() -> None:
    block = candump.parse(b"")
    assert block is not None
    assert len(block) == 0


def test_a_log_is_read_in_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(candump, "PART_BYTES", 7)
    path = log(tmp_path, LINES)
    assert candump.read(path) is not None
    assert rows_of(path) == ROWS


@pytest.mark.parametrize(
    "line",
    [
        b"", b"\r\n", b"(1.0) can0 123#R\n", b"(1.0) can0 123##1AABB\n", b"(1.0) can0 20000004#0000000000000000\n",
        b"(1690000000.000000001) can0 123#00\n", b"(1.0) can0 123#00", b"(1.0)  can0 123#00\n",
        b"(1.0) can0 123#00 R\n", b"(9.5) can0 12#00\n",
    ],
)  # fmt: skip
def test_other_lines_are_left_to_python_can(tmp_path: Path, line: bytes) -> None:
    path = log(tmp_path, LINES + line)
    with can.LogReader(path) as reader:
        expected = [(each.timestamp, *frame) for each in reader if (frame := frame_of(each)) is not None]
    assert [(at_s, each, bytes.fromhex(data)) for at_s, each, _, data in rows_of(path)] == expected


frames_of_a_log = st.tuples(
    st.integers(10**9, 2 * 10**9), st.integers(0, 999_999), st.booleans(), st.integers(0, 2**11 - 1),
    st.binary(max_size=8),
)  # fmt: skip


@given(frames=st.lists(frames_of_a_log, max_size=12))
def test_what_candump_writes_is_read_as_by_float(frames: list[tuple[int, int, bool, int, bytes]]) -> None:
    text = "".join(
        f"({seconds}.{micro:06d}) can0 {number:0{8 if long else 3}X}#{data.hex().upper()}\n"
        for seconds, micro, long, number, data in frames
    )
    block = candump.parse(text.encode())
    assert block is not None
    assert block.at_s.tolist() == [float(f"{seconds}.{micro:06d}") for seconds, micro, *_ in frames]
    ids = [number | (EXTENDED if long else 0) for _, _, long, number, _ in frames]
    assert block.ids.tolist() == ids
    assert np.array_equal(block.dlc, [len(data) for *_, data in frames])
    assert block.data.tobytes() == b"".join(data.ljust(8, b"\0") for *_, data in frames)
