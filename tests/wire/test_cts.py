"""Frames of a CTS chamber typed by hand, in both directions, and the simulated chamber that speaks them."""

import pytest

from drivers.dialects.cts import wire
from drivers.dialects.cts.wire import Ramp, Status, Temperatures
from simulators.instruments.chambers.cts import SimulatedCts
from tests.support.chambers_ascii import at_25_c
from tests.support.clock import Clock

QUESTION = bytes.fromhex("02 81 c1 b0 f0 03")  # A0 to address 1
ANSWER = bytes.fromhex("02 81 c1 b0 a0 b0 b2 b5 ae b0 a0 b0 b2 b5 ae b0 f0 03")  # A0 025.0 025.0


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def chamber(clock: Clock) -> SimulatedCts:
    return at_25_c(SimulatedCts, clock)


# Frames


@pytest.mark.parametrize(
    ("address", "text", "sent"),
    [
        (1, b"A0", "02 81 c1 b0 f0 03"),
        (1, b"S", "02 81 d3 d2 03"),
        (1, b"s1 1", "02 81 f3 b1 a0 b1 d2 03"),
        (1, b"a0 -40.0", "02 81 e1 b0 a0 ad b4 b0 ae b0 c7 03"),
        (32, b"A0", "02 a0 c1 b0 d1 03"),
    ],
)
def test_a_text_on_the_wire(address: int, text: bytes, sent: str) -> None:
    assert wire.frame(address, text) == bytes.fromhex(sent)
    assert wire.text_of(address, bytes.fromhex(sent)[:-1]) == text.decode()


@pytest.mark.parametrize("at", range(len(ANSWER) - 1))
def test_a_frame_with_a_byte_lost_or_garbled_is_none(at: int) -> None:
    frame = ANSWER[:-1]
    for bit in range(8):
        with pytest.raises(ValueError, match=r"not a frame|checksum|address"):
            wire.text_of(1, frame[:at] + bytes([frame[at] ^ 1 << bit]) + frame[at + 1 :])
    with pytest.raises(ValueError, match=r"not a frame|checksum|address"):
        wire.text_of(1, frame[:at] + frame[at + 1 :])


def test_a_frame_of_another_address_is_none() -> None:
    with pytest.raises(ValueError, match="from address 2"):
        wire.text_of(1, bytes.fromhex("02 82 d3 d1"))


# The driver's side


def test_commands_are_spelled() -> None:
    assert [wire.set_point(value) for value in (25.0, -40.04, 99.96, -5.0, -0.04)] == [
        "a0 025.0", "a0 -40.0", "a0 100.0", "a0 -05.0", "a0 000.0",
    ]  # fmt: skip
    assert wire.ramp_rates(1, 0.5) == ("u1 000.5", "d1 000.5")
    assert wire.ramp_rates(0, 10.0) == ("u0 010.0", "d0 010.0")
    assert [wire.can_be_set(rate) for rate in (0.5, 0.3, 5 / 60, 0.25)] == [True, True, False, False]


def test_answers_are_read() -> None:
    assert wire.of_address(1, wire.read_temperatures)(ANSWER[:-1]) == Temperatures(25.0, 25.0)
    assert wire.read_temperatures("A0 023.5 -40.0") == Temperatures(23.5, -40.0)
    assert wire.read_ramp("R1 11 0001.50 0002.00 -40.00") == Ramp(True, 1.5, 2.0, -40.0)
    assert wire.read_ramp("R0 00 0999.90 0999.90 0025.00") == Ramp(False, 999.9, 999.9, 25.0)
    assert wire.read_status("S101000000") == Status(running=True, paused=False, error="")
    assert wire.read_status("S010000002") == Status(running=False, paused=True, error="2")
    assert wire.read_status("S01100000?") == Status(running=False, paused=False, error="?")
    assert wire.read_versions("C2.41;1.07;123456;") == "2.41;1.07;123456"
    assert wire.read_done("a0 025.0")("a")
    assert wire.read_done("s1 1")("s1")


@pytest.mark.parametrize(
    ("read", "text"),
    [
        (wire.read_temperatures, "A0 23.5 40.0"),
        (wire.read_temperatures, "A1 023.5 040.0"),
        (wire.read_temperatures, "A0 023.5 040.0 "),
        (wire.read_ramp, "R1 1 0001.50 0002.00 -40.00"),
        (wire.read_ramp, "R2 11 0001.50 0002.00 -40.00"),
        (wire.read_status, "S10100000"),
        (wire.read_status, "S201000000"),
        (wire.read_versions, "C;;"),
        (wire.read_versions, "c1"),
        (wire.read_done("a0 025.0"), "s1"),
        (wire.read_done("a0 025.0"), ""),
    ],
)
def test_anything_else_is_no_answer(read, text: str) -> None:
    with pytest.raises(ValueError, match="not "):
        read(text)


# The simulator's side


def test_it_answers_frames_in_any_pieces(chamber: SimulatedCts) -> None:
    assert chamber.session().feed(QUESTION) == ANSWER
    session = chamber.session()
    assert [session.feed(bytes([byte])) for byte in QUESTION][-1] == ANSWER
    assert session.feed(QUESTION + QUESTION) == ANSWER + ANSWER
    assert session.feed(b"\x00\xff" + QUESTION) == ANSWER


@pytest.mark.parametrize(
    "request_",
    ["02 81 c1 b0 f1 03", "02 82 c1 b0 f3 03", "81 c1 b0 f0 03", "02 81 d8 d9 03", "03"],
    ids=["checksum", "address", "no STX", "unknown", "nothing"],
)
def test_to_anything_else_it_says_nothing(chamber: SimulatedCts, request_: str) -> None:
    assert chamber.session().feed(bytes.fromhex(request_)) == b""


def test_a_session(chamber: SimulatedCts, clock: Clock) -> None:
    assert [chamber.execute(text) for text in ("S", "C", "A0", "R1", "R0")] == [
        "S101000000", "C2.41;1.07;123456;", "A0 025.0 025.0", "R1 00 0999.90 0999.90 0025.00", "",
    ]  # fmt: skip
    assert [chamber.execute(text) for text in ("a0 -40.0", "A0")] == ["a", "A0 025.0 -40.0"]
    clock.now_s = 7200.0
    assert [chamber.execute(text) for text in ("A0", "R1")] == ["A0 -40.0 -40.0", "R1 00 0999.90 0999.90 -40.00"]
    assert [chamber.execute(text) for text in ("a0 200.0", "A0", "a0 20", "u1 000.0", "u2 001.0", "x")] == [
        "a", "A0 -40.0 -40.0", "", "", "", "",
    ]  # fmt: skip


@pytest.mark.parametrize(("reads", "messages"), [("in_force", "A0 025.1 030.0"), ("target", "A0 025.1 035.0")])
def test_rates_ramp_the_set_point(clock: Clock, reads: str, messages: str) -> None:
    chamber = at_25_c(SimulatedCts, clock, set_point_reads=reads)
    assert [chamber.execute(text) for text in ("u1 001.0", "d1 000.5", "a0 035.0")] == ["u", "d", "a"]
    assert chamber.execute("R1") == "R1 11 0001.00 0000.50 0035.00"
    clock.now_s = 300.0
    assert chamber.execute("A0")[-5:] == messages[-5:]
    chamber.execute("s3 0")
    assert chamber.execute("S") == "S100000000"
    clock.now_s = 600.0
    assert chamber.execute("R1") == "R1 10 0001.00 0000.50 0035.00"
    assert chamber._world.thermal.set_point_c == pytest.approx(30.0)
    assert [chamber.execute(text) for text in ("s3 1", "a0 020.0")] == ["s3", "a"]
    clock.now_s = 660.0
    chamber.execute("S")
    assert chamber._world.thermal.set_point_c == pytest.approx(29.5)


def test_off_a_set_point_waits_until_it_is_started(chamber: SimulatedCts, clock: Clock) -> None:
    assert [chamber.execute(text) for text in ("s1 0", "S", "a0 060.0")] == ["s1", "S001000000", "a"]
    clock.now_s = 3600.0
    assert [chamber.execute(text) for text in ("A0", "s1 1", "S")] == ["A0 025.0 060.0", "s1", "S101000000"]
    clock.now_s = 10800.0
    assert chamber.execute("A0") == "A0 060.0 060.0"
    chamber.restart()
    assert chamber.execute("S") == "S001000000"


def test_an_error_stops_it(chamber: SimulatedCts) -> None:
    chamber.fail("2")
    assert [chamber.execute(text) for text in ("S", "s1 1", "S")] == ["S011000002", "s1", "S011000002"]


def test_a_program_sets_its_own(chamber: SimulatedCts, clock: Clock) -> None:
    chamber.start_program()
    clock.now_s = 600.0
    assert chamber.execute("R1").endswith("0080.00")
    assert chamber.execute("A0")[-5:] == "035.0"
