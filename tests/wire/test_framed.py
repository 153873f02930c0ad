"""Frames typed by hand: numbers, checksums, where a frame begins, and what a described controller answers."""

import struct
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.dialects.framed.status import StatusReader
from drivers.dialects.framed.wire import Checksum, ChecksumKind, FrameFormat, NumberFormat, Splitter
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.axes.framed import SimulatedFrames
from simulators.world import World
from tests.support.clock import Clock, quiet_chamber
from tests.support.framed import FICTIONAL, PLAIN

CHECK = b"123456789"  # what the catalogue of CRCs gives its check values for


@pytest.mark.parametrize(
    ("parameters", "check"),
    [
        ({"polynomial": 0x1021, "initial": 0xFFFF}, 0x29B1),  # CRC-16/IBM-3740, "CCITT-FALSE"
        ({"polynomial": 0x1021}, 0x31C3),  # CRC-16/XMODEM
        ({"polynomial": 0x1021, "reflected": True}, 0x2189),  # CRC-16/KERMIT
        ({"polynomial": 0x1021, "initial": 0xFFFF, "reflected": True, "xor_out": 0xFFFF}, 0x906E),  # CRC-16/IBM-SDLC
        ({"polynomial": 0x1021, "initial": 0xB2AA, "reflected": True}, 0x63D0),  # CRC-16/RIELLO
        ({"polynomial": 0x8005, "initial": 0xFFFF, "reflected": True}, 0x4B37),  # CRC-16/MODBUS
        ({"polynomial": 0x8005, "reflected": True}, 0xBB3D),  # CRC-16/ARC
    ],
)
def test_crc16_has_the_check_values_of_the_catalogue(parameters: dict[str, Any], check: int) -> None:
    assert Checksum("crc16", **parameters).of(CHECK) == check


@pytest.mark.parametrize(
    ("kind", "check"),
    [
        ("crc32", 0xCBF43926),  # CRC-32/ISO-HDLC of the catalogue
        ("sum8", 0xDD),  # nine digits, 0x35 on the average: 9 · 0x35 = 0x1DD
        ("sum16", 0x01DD),
        ("xor8", 0x31),  # 0x30 nine times is 0x30, 1 ^ 2 ^ … ^ 9 is 1
    ],
)
def test_the_other_checksums_of_the_same_text(kind: ChecksumKind, check: int) -> None:
    assert Checksum(kind).of(CHECK) == check


def test_a_checksum_covers_what_stands_from_its_first_byte_on_and_has_a_byte_order() -> None:
    frame = bytes.fromhex("AA 55 01 02 FF FF")
    assert Checksum("sum16", first=0, byte_order="big").written(frame, 4) == bytes.fromhex("01 02")  # AA+55 is FF
    assert Checksum("sum16", first=2, byte_order="little").written(frame, 4) == bytes.fromhex("03 00")


@pytest.mark.parametrize(
    ("form", "value", "data"),
    [
        (NumberFormat(0, "u8", scale=0.5), 100.0, "C8"),
        (NumberFormat(0, "i8"), -2.0, "FE"),
        (NumberFormat(0, "u16", "big", 0.01), 400.0, "9C 40"),
        (NumberFormat(0, "i16", "little", 0.1), -40.0, "70 FE"),
        (NumberFormat(0, "u32", "little", 0.001), 40.0, "40 9C 00 00"),
        (NumberFormat(0, "i32", "big", 0.0001), 90.0, "00 0D BB A0"),
        (NumberFormat(0, "i32", "little", -0.0001), 90.0, "60 44 F2 FF"),  # counts the other way
        (NumberFormat(0, "u16", "big", 0.01, -180.0), -90.0, "23 28"),  # 9000 counts above -180
        (NumberFormat(0, "i64", "big", 1e-9), -1.0, "FF FF FF FF C4 65 36 00"),
        (NumberFormat(0, "f32", "big"), 25.5, "41 CC 00 00"),
        (NumberFormat(0, "f64", "little"), -40.0, "00 00 00 00 00 00 44 C0"),
    ],
)
def test_numbers_have_their_bytes(form: NumberFormat, value: float, data: str) -> None:
    frame = bytearray(form.end)
    form.write(frame, form.raw(value))
    assert frame == bytes.fromhex(data)
    assert form.value(form.read(bytes(frame))) == pytest.approx(value)


@pytest.mark.parametrize(
    ("form", "value"),
    [
        (NumberFormat(0, "u8"), 256),
        (NumberFormat(0, "u16"), -1),
        (NumberFormat(0, "i32", scale=1e-9), 3.0),
        (NumberFormat(0, "u8"), float("nan")),
        (NumberFormat(0, "f32"), 1e39),
    ],
)
def test_what_does_not_fit_is_not_written(form: NumberFormat, value: float) -> None:
    with pytest.raises(OverflowError, match="does not fit"):
        form.raw(value)


@pytest.mark.parametrize("data", [struct.pack("<f", float("nan")), struct.pack("<f", float("inf"))])
def test_a_number_that_is_none_is_not_read(data: bytes) -> None:
    with pytest.raises(ValueError, match="at 0"):
        NumberFormat(0, "f32").read(data)


@settings(max_examples=40)
@given(st.integers(-(2**31), 2**31 - 1), st.sampled_from([0.0001, 0.36 / 3600, 1e-6, 360 / 2**24]))
def test_what_was_read_is_written_as_it_was(raw: int, scale: float) -> None:
    form = NumberFormat(0, "i32", scale=scale)
    assert form.raw(raw * scale) == raw


# Frames to the controller

STOP = bytes.fromhex("FA 01 00 01 0D")  # 01 + 00
MOVE = bytes.fromhex("FA 02 00 0D BB A0 07 D0 41 0D")  # 900000, 2000; 02 + 0D + BB + A0 + 07 + D0 is 0x241
TURN = bytes.fromhex("FA 03 FC 18 17 0D")  # -1000; 03 + FC + 18 is 0x117


def built(name: str, **values: float) -> bytes:
    shape = PLAIN.shape(name)
    forms = {key: PLAIN.number(getattr(shape, key)) for key in values}
    return PLAIN.format(name).build((forms[key], forms[key].raw(value)) for key, value in values.items())


def test_commands_have_their_bytes() -> None:
    assert built("stop") == STOP
    assert built("move", angle=90.0, rate=20.0) == MOVE
    assert built("rate", rate=-10.0) == TURN


def long_division(data: bytes) -> int:
    """The remainder of data · x¹⁶ by x¹⁶ + x¹² + x⁵ + 1, bit by bit, its first 16 bits inverted before."""
    remainder = 0xFFFF
    for byte in data:
        for bit in range(7, -1, -1):
            carry = remainder >> 15 ^ byte >> bit & 1
            remainder = remainder << 1 & 0xFFFF ^ (0x1021 if carry else 0)
    return remainder


def test_a_command_of_the_shipped_profile_has_its_bytes() -> None:
    assert long_division(CHECK) == 0x29B1
    frame = FICTIONAL.format("stop").build([])
    assert frame[:6] == bytes.fromhex("AA 55 23 01 00 00")
    assert frame[6:] == long_division(frame[2:6]).to_bytes(2, "big") == bytes.fromhex("1F 62")


# A status

STATUS = bytes.fromhex("FA 05 00 04 93 E0 00 7D 01 02 FC 0D")  # 05 + 04 + 93 + E0 + 7D + 01 + 02 is 0x1FC


def test_a_status_is_read() -> None:
    assert PLAIN.format("status").fits(STATUS, 0)
    status = StatusReader(PLAIN).read(STATUS)
    assert (status.angle_deg, status.rate_dps, status.faults) == (30.0, 1.25, ("encoder",))
    assert (status.moving, status.enabled, status.homed, status.mode) == (True, True, True, "")
    assert StatusReader(PLAIN).counter(STATUS) == 5


def test_a_status_of_the_shipped_profile_is_read() -> None:
    body = bytes.fromhex("90 01 07 00 E9 03 00 00 20 6C FB FF 7D 00 00 00 A0 BB 0D 00 00 00 00 00 01 A7 02 05")
    frame = bytes.fromhex("AA 55") + body + long_division(body).to_bytes(2, "big")
    assert FICTIONAL.format("status").fits(frame, 0)
    reader = StatusReader(FICTIONAL)
    status = reader.read(frame)
    assert (reader.answers(frame), reader.counter(frame), status.serial_number) == (1, 7, 1001)
    assert (status.angle_deg, status.rate_dps, status.target_angle, status.target_rate) == (-30.0, 0.0125, 900_000, 0)
    assert (status.mode, status.enabled, status.homed, status.moving) == ("position", True, True, True)
    assert (status.in_position, status.at_sine, status.remote) == (False, False, True)
    assert status.faults == ("overspeed", "amplifier (5)")
    assert str(status) == "enabled, moving, mode position, overspeed, amplifier (5)"
    pressed = reader.read(frame[:26] + bytes([9, 0x27]) + frame[28:])
    assert (pressed.mode, pressed.faults[0]) == ("9", "emergency stop")


# Where a frame begins

FORM = FrameFormat("f", 6, ((0, b"\xaa\x55"),), Checksum("sum8", 2))
GOOD = bytes.fromhex("AA 55 01 02 03 06")  # 01 + 02 + 03
ALSO = bytes.fromhex("AA 55 10 AA 55 0F")  # the header once more inside it; 10 + AA + 55 is 0x10F


@pytest.mark.parametrize(
    ("received", "found", "dropped"),
    [
        (GOOD, [GOOD], 0),
        (GOOD + GOOD, [GOOD, GOOD], 0),
        (b"\x00\xff" + GOOD, [GOOD], 2),
        (b"\xaa" + GOOD, [GOOD], 1),  # half a header
        (b"\xaa\x55" + GOOD, [GOOD], 2),  # a header without its frame
        (GOOD[:4] + GOOD, [GOOD], 4),  # a frame that was cut
        (bytes.fromhex("AA 55 01 02 03 07") + GOOD, [GOOD], 6),  # a wrong checksum
        (ALSO + GOOD, [ALSO, GOOD], 0),
        (GOOD + b"\x01\x02", [GOOD], 2),
        (GOOD + b"\xaa", [GOOD], 0),  # may go on
        (b"", [], 0),
    ],
)
def test_a_frame_begins_where_one_fits_as_a_whole(received: bytes, found: list[bytes], dropped: int) -> None:
    for portions in ([received], [bytes([byte]) for byte in received]):
        splitter = Splitter([FORM])
        assert [frame for portion in portions for _, frame in splitter.feed(portion)] == found
        assert splitter.dropped == dropped


def test_what_was_begun_can_be_forgotten() -> None:
    splitter = Splitter([FORM])
    splitter.feed(GOOD[:4])
    assert splitter.unfinished
    splitter.forget()
    assert (splitter.unfinished, splitter.dropped, splitter.last_dropped) == (False, 4, GOOD[:4])
    assert splitter.feed(GOOD[4:] + GOOD) == [(FORM, GOOD)]


@settings(max_examples=40)
@given(st.lists(st.one_of(st.binary(max_size=20), st.integers(0, 2**32 - 1)), max_size=12), st.integers(1, 40))
def test_every_frame_is_found_among_other_bytes_and_none_that_was_not_sent(
    pieces: list[bytes | int], portion: int
) -> None:
    counter = NumberFormat(2, "u32", "big")
    form = FrameFormat("f", 10, ((0, b"\xaa\x55"),), Checksum("crc32"))
    message = [form.build([(counter, piece)]) if isinstance(piece, int) else piece for piece in pieces]
    line, splitter = b"".join(message), Splitter([form])
    found = [frame for at in range(0, len(line), portion) for _, frame in splitter.feed(line[at : at + portion])]
    assert found == [each for each, piece in zip(message, pieces, strict=True) if isinstance(piece, int)]
    splitter.forget()
    assert splitter.dropped == sum(len(piece) for piece in pieces if isinstance(piece, bytes))


# The simulator


@pytest.fixture
def world() -> World:
    return quiet_chamber(Clock(), 20.0)


def test_it_answers_a_request_and_no_command(world: World) -> None:
    session = SimulatedFrames(world, FaultPlan(), FICTIONAL).session()
    request = bytes.fromhex("AA 55 10 2A") + long_division(bytes.fromhex("10 2A")).to_bytes(2, "big")
    answer = session.feed(request[:3]) + session.feed(request[3:])
    assert answer[:30].hex(" ") == (
        "aa 55 90 2a 01 00 e9 03 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 aa 00 00"
    )
    assert session.feed(FICTIONAL.format("enable").build([])) == b""
    assert session.feed(b"garbage" + request)[27] == 0xAB


def test_its_own_faults_and_its_emergency_stop_drop_the_motor(world: World) -> None:
    simulated = SimulatedFrames(world, FaultPlan(), FICTIONAL)
    session = simulated.session()
    enable, clear, move = (FICTIONAL.format(name).build([]) for name in ("enable", "clear_fault", "move"))
    for drop, undo in (
        (simulated.trip, lambda: session.feed(clear)),
        (simulated.press_emergency_stop, lambda: simulated.press_emergency_stop(False)),
    ):
        session.feed(enable)
        assert simulated.enabled
        drop()
        session.feed(enable + move)
        assert (simulated.enabled, simulated.mode) == (False, "off")
        undo()
        assert not simulated.enabled


def test_it_homes_and_is_switched_off_by_others(world: World) -> None:
    simulated = SimulatedFrames(world, FaultPlan(), FICTIONAL, homed=False)
    session = simulated.session()
    for name, homed, enabled in (("home", False, False), ("enable", False, True), ("home", True, True),
                                 ("disable", True, False)):  # fmt: skip
        session.feed(FICTIONAL.format(name).build([]))
        assert (simulated.homed, simulated.enabled) == (homed, enabled)
