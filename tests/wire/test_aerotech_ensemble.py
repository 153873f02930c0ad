"""Ensemble lines typed by hand, in both directions, and the simulated controller that speaks them."""

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.dialects.aerotech_ensemble import wire
from drivers.dialects.aerotech_ensemble.wire import AxisFault, AxisStatus, Command, Move, Outcome, Reply
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.axes.aerotech_ensemble import SimulatedEnsemble
from simulators.units.settings import WorldSettings
from simulators.world import World


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def head(clock: Clock) -> SimulatedEnsemble:
    return SimulatedEnsemble(World(WorldSettings(seed=1, gravity_mps2=9.8), clock), FaultPlan(now_s=clock))


def talk(head: SimulatedEnsemble, *lines: bytes) -> list[bytes]:
    session = head.session()
    return [session.feed(line + b"\n") for line in lines]


# The driver's side


@pytest.mark.parametrize(
    ("command", "line"),
    [
        (wire.ENABLE.format("X"), "ENABLE X"),
        (wire.move_absolute("X", 90.0, 5.0), "MOVEABS X 90.0 F5"),
        (wire.move_absolute("X", -0.000278, 0.5), "MOVEABS X -0.000278 F0.5"),
        (wire.move_absolute("X", -1e-9, 30.0), "MOVEABS X 0.0 F30"),
        (wire.ABORT.format("X"), "ABORT X"),
        (wire.FEEDBACK_QUERY.format("X"), "PFBK X"),
        (wire.STATUS_QUERY.format("X"), "AXISSTATUS X"),
        (wire.FAULT_QUERY.format("X"), "AXISFAULT X"),
        (wire.FINGERPRINT_QUERY.format("X"), "GETPARM(X, CountsPerUnit)"),
    ],
)
def test_commands_are_spelled_as_documented(command: str, line: str) -> None:
    assert command == line


@pytest.mark.parametrize(
    ("line", "reply"),
    [
        (b"%", Reply(Outcome.DONE)),
        (b"%90.000012", Reply(Outcome.DONE, "90.000012")),
        (b"!", Reply(Outcome.INVALID)),
        (b"#", Reply(Outcome.FAULT)),
        (b"$", Reply(Outcome.TIMEOUT)),
    ],
)
def test_the_first_character_says_how_it_went(line: bytes, reply: Reply) -> None:
    assert wire.read_reply(line) == reply
    assert wire.render(reply) == line + b"\n"


@pytest.mark.parametrize("line", [b"", b"90.0", b" %90.0", b"\xff", b"OK"])
def test_other_lines_are_no_answers(line: bytes) -> None:
    with pytest.raises(ValueError, match=r"valid Outcome|codec"):
        wire.read_reply(line)


@pytest.mark.parametrize(
    ("data", "angle_deg"), [("90.000012", 90.000012), ("-1,250000", -1.25), ("7", 7.0), ("1.5e-05", 1.5e-5)]
)
def test_an_angle_may_have_a_point_or_a_comma(data: str, angle_deg: float) -> None:
    assert wire.read_angle(data) == angle_deg


@pytest.mark.parametrize("data", ["", "nan", "1,234.5", "1.234,5", "1,2,3", "90.0 ", "0x5", "1_0", "%1"])
def test_what_could_be_another_number_is_refused(data: str) -> None:
    with pytest.raises(ValueError, match="not an angle"):
        wire.read_angle(data)


def test_status_is_a_signed_number() -> None:
    # As an instrument answered: bits 0, 1, 2 and others, and the sign bit.
    status = wire.read_status("-1791485433")
    assert status == AxisStatus.ENABLED | AxisStatus.HOMED | AxisStatus.IN_POSITION
    assert wire.read_status("8") == AxisStatus.MOVING
    assert wire.signed(1 << 31 | 1) == "-2147483647"


@pytest.mark.parametrize("data", ["", "1.0", "4294967296", "-2147483649", "0x1"])
def test_what_is_no_register_is_refused(data: str) -> None:
    with pytest.raises(ValueError, match="not a 32-bit number"):
        wire.read_status(data)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ("0", ""),
        ("2048", "emergency stop"),
        ("33", "position error, negative software limit"),
        ("16392", "negative hardware limit, bit 14"),
        ("-2147483648", "bit 31"),
    ],
)
def test_faults_are_named(data: str, words: str) -> None:
    assert wire.name_faults(wire.read_fault(data)) == words


@given(st.integers(0, (1 << 32) - 1))
def test_registers_come_back_as_they_were_sent(bits: int) -> None:
    assert int(wire.read_fault(wire.signed(bits))) == bits


# The simulator's side


@pytest.mark.parametrize(
    ("line", "command"),
    [
        (b"PFBK X", Command("PFBK", ("X",))),
        (b"PFBK(X)", Command("PFBK", ("X",))),
        (b"moveabs x 90.0 f5", Command("MOVEABS", ("X", "90.0", "F5"))),
        (b"GETPARM(X, CountsPerUnit)", Command("GETPARM", ("X", "COUNTSPERUNIT"))),
    ],
)
def test_a_line_is_taken_apart(line: bytes, command: Command) -> None:
    assert wire.parse_command(line) == command


@pytest.mark.parametrize(
    ("arguments", "move"),
    [
        (("X", "90.0", "F5"), Move("X", 90.0, 5.0)),
        (("X", "90.0", "F", "5"), Move("X", 90.0, 5.0)),
        (("X", "-90", "XF5.5"), Move("X", -90.0, 5.5)),
        (("X", "90.0"), Move("X", 90.0, None)),
    ],
)
def test_a_move_may_spell_its_rate_in_several_ways(arguments: tuple[str, ...], move: Move) -> None:
    assert wire.parse_move(arguments) == move


@pytest.mark.parametrize("arguments", [("X",), ("X", "ninety"), ("X", "9", "YF5"), ("X", "9", "5"), ("X", "9", "F")])
def test_other_moves_are_refused(arguments: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match="not an axis"):
        wire.parse_move(arguments)


def test_a_session_with_a_controller(head: SimulatedEnsemble, clock: Clock) -> None:
    assert talk(head, b"AXISSTATUS X", b"MOVEABS X 20.0 F10", b"ENABLE X", b"AXISSTATUS(X)") == [
        b"%2\n", b"!\n", b"%\n", b"%7\n",
    ]  # fmt: skip
    assert talk(head, b"WAIT MODE NOWAIT", b"MOVEABS X 20.0 F10", b"AXISSTATUS X") == [b"%\n", b"%\n", b"%11\n"]
    clock.now_s = 0.125 + 1.0
    assert talk(head, b"PFBK X") == [b"%10.000000\n"]
    clock.now_s = 2.25
    assert talk(head, b"PFBK X", b"AXISSTATUS X") == [b"%20.000000\n", b"%7\n"]


def test_lines_may_come_in_any_portions(head: SimulatedEnsemble) -> None:
    session = head.session()
    answers = [session.feed(bytes([byte])) for byte in b"PFBK X\nENABLE X\n"]
    assert b"".join(answers) == b"%0.000000\n%\n"


@pytest.mark.parametrize(
    "line",
    [b"", b"PFBK", b"PFBK Y", b"FLY X", b"MOVEABS X", b"GETPARM(X, Colour)", b"\xff", b"WAIT MODE MOVEDONE"],
)
def test_what_the_controller_does_not_know_is_invalid(head: SimulatedEnsemble, line: bytes) -> None:
    assert talk(head, line) == [b"!\n"]


def test_a_move_beyond_the_software_limits_is_a_fault_that_stays(head: SimulatedEnsemble) -> None:
    assert talk(head, b"ENABLE X", b"MOVEABS X 400.0 F10", b"AXISFAULT X") == [b"%\n", b"#\n", b"%16\n"]
    assert talk(head, b"ENABLE X", b"MOVEABS X 10.0 F10", b"HOMEASYNC X") == [b"!\n", b"!\n", b"!\n"]
    assert talk(head, b"FAULTACK X", b"AXISFAULT X", b"ENABLE X", b"MOVEABS X -400.0 F10", b"AXISFAULT X") == [
        b"%\n", b"%0\n", b"%\n", b"#\n", b"%32\n",
    ]  # fmt: skip


def test_homing_stopping_and_disabling(head: SimulatedEnsemble, clock: Clock) -> None:
    head.homed = False
    assert talk(head, b"ENABLE X", b"MOVEABS X 40.0 F10", b"AXISSTATUS X") == [b"%\n", b"%\n", b"%9\n"]
    clock.now_s = 2.0
    assert talk(head, b"ABORT X", b"AXISSTATUS X", b"HOMEASYNC X", b"AXISSTATUS X") == [
        b"%\n", b"%5\n", b"%\n", b"%11\n",
    ]  # fmt: skip
    clock.now_s = 20.0
    assert talk(head, b"PFBK X", b"DISABLE X", b"AXISSTATUS X") == [b"%0.000000\n", b"%\n", b"%2\n"]


def test_a_fault_stops_the_axis_where_it_is(head: SimulatedEnsemble, clock: Clock) -> None:
    talk(head, b"ENABLE X", b"MOVEABS X 40.0 F10")
    clock.now_s = 1.125
    head.trip(AxisFault.EMERGENCY_STOP)
    clock.now_s = 60.0
    assert talk(head, b"PFBK X", b"AXISSTATUS X", b"AXISFAULT X") == [b"%10.000000\n", b"%2\n", b"%2048\n"]


def test_a_frozen_feedback_and_a_stuck_axis(head: SimulatedEnsemble, clock: Clock) -> None:
    head.faults.begin("frozen")
    talk(head, b"ENABLE X", b"MOVEABS X 40.0 F10")
    clock.now_s = 60.0
    assert talk(head, b"PFBK X") == [b"%0.000000\n"]
    head.faults.begin("stuck")
    assert talk(head, b"MOVEABS X 10.0 F10", b"AXISSTATUS X") == [b"%\n", b"%7\n"]


def test_words_that_other_programs_say(head: SimulatedEnsemble, clock: Clock) -> None:
    # As ESRF's BLISS says them when it begins, moves, turns and looks; parameters by its numbers.
    assert talk(head, b"ACKNOWLEDGEALL", b"RAMP MODE RATE", b"WAIT MODE NOWAIT", b"VERSION", b"ENABLE X") == [
        b"%\n", b"%\n", b"%\n", b"%5.06.001\n", b"%\n",
    ]  # fmt: skip
    assert talk(head, b"GETPARM(X,67)", b"SETPARM(X,67,4)", b"GETPARM(X,67)", b"GETPARM(X,2)", b"GETPARM(X,9999)") == [
        b"%1\n", b"%\n", b"%4\n", b"%1000000\n", b"!\n",
    ]  # fmt: skip
    assert talk(head, b"RAMP RATE X 10", b"RAMP RATE X -1", b"MOVEABS X 10.000000 XF 10.000000", b"CMDPOS(X)") == [
        b"%\n", b"!\n", b"%\n", b"%0.000000\n",
    ]  # fmt: skip
    clock.now_s = 1.0  # up to 10 deg/s within 1 s
    assert talk(head, b"PFBK(X)", b"VFBK X", b"VCMD X") == [b"%5.000000\n", b"%10.000000\n", b"%10.000000\n"]
    clock.now_s = 5.0
    assert talk(head, b"CMDPOS(X)", b"PERR X", b"MOVEINC X -4 F10") == [b"%10.000000\n", b"%0.000000\n", b"%\n"]
    clock.now_s = 10.0
    assert talk(head, b"PFBK X", b"FREERUN X 5.0") == [b"%6.000000\n", b"%\n"]
    clock.now_s = 20.0
    assert talk(head, b"VFBK X", b"AXISSTATUS X", b"FREERUN X 0") == [b"%5.000000\n", b"%11\n", b"%\n"]
    clock.now_s = 30.0
    assert talk(head, b"VFBK X", b"AXISSTATUS X", b"DISABLE X", b"FREERUN X 5") == [
        b"%0.000000\n", b"%7\n", b"%\n", b"!\n",
    ]  # fmt: skip


def test_a_software_limit_is_a_parameter(head: SimulatedEnsemble) -> None:
    assert talk(head, b"ENABLE X", b"GETPARM(X, SoftwareLimitHigh)", b"SETPARM(X, SoftwareLimitHigh, 90)") == [
        b"%\n", b"%370\n", b"%\n",
    ]  # fmt: skip
    assert talk(head, b"MOVEABS X 90.5 F10", b"ACKNOWLEDGEALL", b"AXISFAULT X") == [b"#\n", b"%\n", b"%0\n"]


def test_homing_is_answered_when_it_is_over_and_holds_back_what_follows(head: SimulatedEnsemble, clock: Clock) -> None:
    session, later = head.session(), list[tuple[float, Callable[[], bytes]]]()
    session.answer_by(lambda delay_s, answer: later.append((delay_s, answer)))
    assert session.feed(b"HOME X\nENABLE X\nMOVEABS X 20.0 F10\n") == b"!\n%\n%\n"
    clock.now_s = 10.0
    assert session.feed(b"HOME X\nPFBK X\n") == b""
    ((delay_s, answer),) = later
    clock.now_s += delay_s
    assert answer() == b"%\n%0.000000\n"


@pytest.mark.parametrize(
    "messages",
    [  # as drivers of other people spell a move: by the axis' number, with or without spaces, with the rate's axis
        b"MOVEABS @0 12.000000 @0F 5.000000",
        b"MOVEABS X12.0 XF5.0",
        b"MOVEABS X 12 F5",
        b"MOVEABS X 12 XF 5",
        b"moveinc x12 f5",
        b"LINEAR X12.0 F5",
        b"ABSOLUTE\nLINEAR X 12 F 5",
        b"INCREMENTAL\nLINEAR @0 12 F5",
    ],
)
def test_an_axis_by_its_number_and_without_a_space_is_the_same_axis(
    head: SimulatedEnsemble, clock: Clock, messages: bytes
) -> None:
    assert talk(head, b"ENABLE @0", messages)[1].endswith(b"%\n")
    assert talk(head, b"AXISSTATUS(@0)", b"AXISFAULT @0") == [b"%11\n", b"%0\n"]
    clock.now_s = 60.0
    assert talk(head, b"PFBK(@0)", b"PFBK X", b"PFBK @1") == [b"%12.000000\n", b"%12.000000\n", b"!\n"]


@pytest.mark.parametrize(("mode", "there_deg"), [(b"INCREMENTAL", 42.0), (b"ABSOLUTE", 12.0)])
def test_a_linear_move_counts_from_where_the_axis_is_in_incremental_mode_alone(
    head: SimulatedEnsemble, clock: Clock, mode: bytes, there_deg: float
) -> None:
    assert talk(head, b"ENABLE X", b"MOVEABS X30 F5")[1].endswith(b"%\n")
    clock.now_s = 60.0
    assert talk(head, mode + b"\nLINEAR X12 F5")[0].endswith(b"%\n")
    clock.now_s = 120.0
    assert talk(head, b"PFBK X") == [b"%%%f\n" % there_deg]


def test_a_rate_and_a_stop_without_a_space(head: SimulatedEnsemble, clock: Clock) -> None:
    assert talk(head, b"ENABLE X", b"FREERUN X5", b"FREERUN @0 0", b"RAMP RATE X10") == [b"%\n"] * 4
