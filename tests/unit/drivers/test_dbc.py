import random
from pathlib import Path

import cantools
import numpy as np
import pytest

from drivers.can.dbc import Dbc, DbcError
from drivers.can.dbc_outline import outline
from drivers.can.frame_block import EXTENDED, FrameBlock

OURS = (Path(__file__).parents[3] / "config" / "if_counter.dbc").read_text("utf-8")
HEAD = 'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: A B\n\n'


def dbc_text(*messages: str) -> str:
    return HEAD + "\n\n".join(messages) + "\n"


def random_message(draws: random.Random, frame_id: int) -> str:
    """One signal anywhere in a frame of any length, in either byte order."""
    dlc = draws.randint(1, 8)
    length = draws.randint(1, 8 * dlc)
    first = draws.randint(0, 8 * dlc - length)  # bits before it, in its own byte order
    big_endian, signed = draws.random() < 0.5, draws.random() < 0.5
    start = 8 * (first // 8) + 7 - first % 8 if big_endian else first
    scale, offset = draws.choice([(1, 0), (0.01, 0), (0.5, -40), (-2, 7), (1e-6, 1e3)])
    layout = f"{start}|{length}@{0 if big_endian else 1}{'-' if signed else '+'}"
    return f'BO_ {frame_id} M{frame_id}: {dlc} A\n SG_ S : {layout} ({scale},{offset}) [0|0] "V" B'


def test_our_decoder_agrees_with_cantools_on_thousands_of_random_frames() -> None:
    draws = random.Random(20)
    ids = range(1, 501)
    text = dbc_text(*(random_message(draws, frame_id) for frame_id in ids))
    ours, theirs = Dbc(text), cantools.database.load_string(text, "dbc")
    seen = set()
    for frame_id in ids:
        message, signal = ours.field(f"M{frame_id}.S")
        seen.add((signal.big_endian, signal.signed, signal.length))
        frames = [draws.randbytes(message.length) for _ in range(10)]
        words = np.frombuffer(b"".join(frame.ljust(8, b"\0") for frame in frames), np.uint64)
        plain = [theirs.decode_message(frame_id, frame, scaling=False)["S"] for frame in frames]
        scaled = [theirs.decode_message(frame_id, frame)["S"] for frame in frames]
        raw = signal.raw(words).tolist()
        if signal.length == 64 and not signal.signed:
            plain, scaled = [value - 2**64 if value >= 2**63 else value for value in plain], []
        assert raw == plain, message
        if signal.length < 64 or signal.signed:
            assert [signal.raw_of(row.tobytes()) for row in words] == plain, message
        if scaled:
            assert signal.physical(words).tolist() == pytest.approx(scaled, rel=1e-12), message
        if signal.length < 64:
            bits = signal.bits(np.array(plain, np.int64))
            encoded = [theirs.encode_message(frame_id, {"S": value}, scaling=False, strict=False) for value in plain]
            assert [word.tobytes()[: message.length] for word in bits.astype("<u8")] == encoded, message
    assert len({length for _, _, length in seen}) > 50
    assert {(big_endian, signed) for big_endian, signed, _ in seen} == {(a, b) for a in (0, 1) for b in (0, 1)}


def test_every_signal_of_our_dbc_agrees_with_cantools_on_random_frames() -> None:
    draws, theirs = random.Random(21), cantools.database.load_string(OURS, "dbc")
    for message in Dbc(OURS).messages.values():
        frames = [draws.randbytes(message.length) for _ in range(500)]
        words = np.frombuffer(b"".join(frame.ljust(8, b"\0") for frame in frames), np.uint64)
        decoded = [theirs.decode_message(message.id, frame) for frame in frames]
        for name, signal in message.signals.items():
            assert signal.physical(words).tolist() == pytest.approx([values[name] for values in decoded], rel=1e-12)


def test_the_layout_of_our_dbc() -> None:
    dbc = Dbc(OURS)
    layout = {
        f"{message.name}.{signal.name}": (message.id, signal.shift, signal.length, signal.signed, signal.scale)
        for message in dbc.messages.values()
        for signal in message.signals.values()
    }
    assert layout == {
        "Latch.Tick": (0x100, 0, 32, False, 1), "Latch.Sequence": (0x100, 32, 16, False, 1),
        "Latch.Status": (0x100, 48, 8, False, 1), "Latch.BootCount": (0x100, 56, 8, False, 1),
        "AxisX.Positive": (0x101, 0, 24, False, 1), "AxisX.Negative": (0x101, 24, 24, False, 1),
        "AxisX.Sequence": (0x101, 48, 16, False, 1),
        "AxisY.Positive": (0x102, 0, 24, False, 1), "AxisY.Negative": (0x102, 24, 24, False, 1),
        "AxisY.Sequence": (0x102, 48, 16, False, 1),
        "AxisZ.Positive": (0x103, 0, 24, False, 1), "AxisZ.Negative": (0x103, 24, 24, False, 1),
        "AxisZ.Sequence": (0x103, 48, 16, False, 1),
        "Temperatures.Unit": (0x110, 0, 16, True, 0.01), "Temperatures.Converter": (0x110, 16, 16, True, 0.01),
        "Temperatures.Sequence": (0x110, 32, 16, False, 1),
    }  # fmt: skip
    assert {message.name: message.length for message in dbc.messages.values()} == {
        "Latch": 8, "AxisX": 8, "AxisY": 8, "AxisZ": 8, "Temperatures": 6,
    }  # fmt: skip


def test_a_message_is_found_by_its_identifier_and_length() -> None:
    text = dbc_text(
        'BO_ 256 Plain: 8 A\n SG_ S : 0|8@1+ (1,0) [0|0] "" B',
        f'BO_ {256 | 1 << 31} Long: 2 A\n SG_ S : 0|8@1+ (1,0) [0|0] "" B',
    )
    dbc = Dbc(text)
    block = FrameBlock(
        np.array([0x100, 0x100 | EXTENDED, 0x100, 0x7FF, 0x100 | EXTENDED], np.uint32), np.zeros(5),
        np.array([8, 2, 7, 8, 8], np.uint8), np.zeros((5, 8), np.uint8),
    )  # fmt: skip
    assert dbc.message("Plain").rows(block).tolist() == [0]
    assert dbc.message("Long").rows(block).tolist() == [1]
    assert dbc.message("Plain").rows(FrameBlock.empty()).tolist() == []
    assert dbc.field("Plain.S")[1].raw(FrameBlock.empty().words).tolist() == []


def test_what_no_counter_sends_is_left_out() -> None:
    text = dbc_text(
        'BO_ 1 Mixed: 8 A\n SG_ Which M : 0|8@1+ (1,0) [0|0] "" B\n SG_ One m0 : 8|8@1+ (1,0) [0|0] "" B\n'
        ' SG_ Always : 16|8@1+ (1,0) [0|0] "" B\n SG_ Real : 32|32@1- (1,0) [0|0] "" B',
        'BO_ 2 Large: 64 A\n SG_ Far : 256|16@1- (0.01,0) [0|0] "degC" B',
        "SIG_VALTYPE_ 1 Real : 1;",
    )
    dbc = Dbc(text)
    assert list(dbc.messages) == ["Mixed"]
    assert list(dbc.message("Mixed").signals) == ["Always"]
    assert "Mixed.One" not in outline(text)
    assert "Mixed.Which" not in outline(text)


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("Nothing.S", "no message 'Nothing'; it has Latch, AxisX, AxisY, AxisZ, Temperatures"),
        ("Latch.Tack", "message Latch has no signal 'Tack'; it has Tick, Sequence, Status, BootCount"),
        ("", "no message ''"),
    ],
)
def test_a_name_that_it_does_not_have_is_answered_with_those_it_has(name: str, problem: str) -> None:
    with pytest.raises(DbcError, match=problem):
        Dbc(OURS).field(name)


@pytest.mark.parametrize(
    "text",
    [
        "this is no DBC",
        dbc_text('BO_ 256 A: 8 A\n SG_ S : 60|8@1+ (1,0) [0|0] "" B'),
        dbc_text('BO_ 256 A: 8 A\n SG_ S : 0|8@1+ (1,0) [0|0] "" B\n SG_ T : 4|8@1+ (1,0) [0|0] "" B'),
    ],
)
def test_a_text_that_is_no_dbc_is_an_error_of_ours(text: str) -> None:
    with pytest.raises(DbcError, match="not a usable DBC: "):
        Dbc(text)


# The outline


def test_the_outline_has_what_cantools_finds() -> None:
    draws = random.Random(22)
    for text in (OURS, dbc_text(*(random_message(draws, frame_id) for frame_id in range(1, 50)))):
        found = Dbc(text).messages.values()
        assert outline(text) == {f"{m.name}.{s.name}": s.unit for m in found for s in m.signals.values()}


@pytest.mark.parametrize("unit", [b"degC", b"DegC", b"deg C", "°C".encode(), b"\xb0C"])
def test_degrees_are_known_in_every_spelling(unit: bytes) -> None:
    raw = dbc_text('BO_ 1 Warm: 8 A\n SG_ T : 0|16@1- (0.01,0) [0|0] "?" B').encode().replace(b"?", unit)
    text = raw.decode("utf-8", errors="replace")
    assert outline(text) == {"Warm.T": "°C"}
    assert Dbc(text).message("Warm").signal("T").unit == "°C"


def test_the_outline_of_anything_else_is_empty() -> None:
    assert outline("") == {}
    assert outline(' SG_ Stray : 0|8@1+ (1,0) [0|0] "" B\nBO_ x y') == {}


# Frame blocks


def block_of(*ids: int) -> FrameBlock:
    count = len(ids)
    return FrameBlock(
        np.array(ids, np.uint32), np.arange(count, dtype=float), np.full(count, 8, np.uint8),
        np.full((count, 8), count, np.uint8),
    )  # fmt: skip


def test_blocks_are_joined_in_order() -> None:
    assert len(FrameBlock.joined([])) == len(FrameBlock.empty()) == 0
    alone = block_of(1, 2)
    assert FrameBlock.joined([alone]) is alone
    both = FrameBlock.joined([block_of(1, 2), FrameBlock.empty(), block_of(3)])
    assert both.ids.tolist() == [1, 2, 3]
    assert both.at_s.tolist() == [0, 1, 0]
    assert both.dlc.tolist() == [8, 8, 8]
    assert both.data[:, 0].tolist() == [2, 2, 1]
    assert (both.ids.dtype, both.at_s.dtype, both.dlc.dtype, both.data.dtype) == (np.uint32, float, np.uint8, np.uint8)
