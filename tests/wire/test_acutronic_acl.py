"""ACL messages typed by hand, in both directions, and the simulated controller that speaks them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.dialects.acutronic_acl import wire
from drivers.dialects.acutronic_acl.wire import (
    Dynamics,
    Interlock,
    InterlockInput,
    Mode,
    Reply,
    SoftwareFault,
    Supervisor,
)
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.axes.acutronic_acl import SimulatedAcutrol
from simulators.units.settings import WorldSettings
from simulators.world import World

NO_INPUTS = InterlockInput(0)
OK = b"\x00\x00\x00\x00\x02\x00\x00\x00OK"


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def table(clock: Clock) -> SimulatedAcutrol:
    return SimulatedAcutrol(World(WorldSettings(seed=1, gravity_mps2=9.8), clock), FaultPlan(now_s=clock))


def talk(table: SimulatedAcutrol, *messages: bytes) -> list[str]:
    """What the answers say: their text, or `error N`."""
    session, expected_text = table.session(), []
    for message in messages:
        answer = session.feed(message + b"\n")
        code, length = (int.from_bytes(answer[at : at + 4], "little") for at in (0, 4))
        assert len(answer) == 8 + length
        expected_text.append(f"error {code}" if code else answer[8:].decode())
    return expected_text


# The driver's side


@pytest.mark.parametrize(
    ("message", "spelled"),
    [
        (wire.IDENTITY_QUERY, "*IDN?"),
        (wire.lock_out(True), (":UTIL:LOCKOUT ON", ":UTIL:REMOTELOCKOUT ON")),
        (wire.lock_out(False), (":UTIL:LOCKOUT OFF", ":UTIL:REMOTELOCKOUT OFF")),
        (wire.ENERGISE.format(1), ":INTERLOCK:CLOSE 1"),
        (wire.enter(Mode.POSITION, 1), ":MODE:POSITION 1"),
        (wire.enter(Mode.RATE, 2), ":MODE:RATE 2"),
        (wire.enter(Mode.SYNTHESIS, 1), ":MODE:SYNTHESIS 1"),
        (wire.enter(Mode.OFF, 1), ":MODE:OFF 1"),
        (wire.limit(Mode.POSITION, 1, 100.0, 4200.0), (":LIM:RATE P,1,100", ":LIM:ACC P,1,4200")),
        (wire.limit(Mode.OFF, 3, 0.5, 40.0), (":LIM:RATE O,3,0.5", ":LIM:ACC O,3,40")),
        (wire.demand_position(3, 10.5), ":DEM:POS 3,10.5"),
        (wire.demand_position(1, -0.0001), ":DEM:POS 1,-0.0001"),
        (wire.demand_rate(1, -1e-9), ":DEM:RATE 1,0"),
        (wire.demand_rate(1, -1000.0), ":DEM:RATE 1,-1000"),
        (wire.configure_sine(1, 0.5, 2.5), ":CONFIG:OSC 1,Enable,0.5,2.5,Pos,Lin"),
        (wire.demand_sine(1, 1.06, 10.0), ":DEM:OSC 1,1.06,10,0"),
        (wire.STATE_QUERY.format(1), ":READ:POS? 1;RATE? 1;:INTERLOCK? 1;:MODE? 1;:STAT:CSR? A1DYN;CSR? SUP0"),
        (wire.FAULTS_QUERY.format(2), ":STAT:CSR? A2SWFAULT;CSR? A2INTLK"),
    ],
)
def test_messages_are_spelled_as_documented(message: object, spelled: object) -> None:
    assert message == spelled


@pytest.mark.parametrize(
    ("answer", "order", "reply"),
    [
        (OK, "little", Reply(0, "OK")),
        (b"\x00\x00\x00\x00\x00\x00\x00\x02OK", "big", Reply(0, "OK")),
        (b"\x00\x00\x00\x00\x0a\x00\x00\x00-179.99964", "little", Reply(0, "-179.99964")),
        (b"\x83\xff\xff\xff\x03\x00\x00\x00bad", "little", Reply(-125, "bad")),
        (b"\x07\x00\x00\x00\x00\x00\x00\x00", "little", Reply(7, "")),
    ],
)
def test_an_answer_has_a_code_and_a_length_before_its_text(answer: bytes, order: wire.ByteOrder, reply: Reply) -> None:
    assert wire.whole_answer(answer, order) == (len(answer), len(answer))
    assert wire.read_reply(answer, order) == reply
    assert wire.render(reply, order) == answer


def test_a_text_may_have_a_line_end() -> None:
    assert wire.read_reply(b"\x00\x00\x00\x00\x04\x00\x00\x00OK\r\n", "little") == Reply(0, "OK")


@pytest.mark.parametrize("length", range(10))
def test_an_answer_is_waited_for_until_it_is_whole(length: int) -> None:
    assert wire.whole_answer(OK[:length], "little") is None


def test_what_follows_an_answer_is_not_part_of_it() -> None:
    assert wire.whole_answer(OK + OK, "little") == (10, 10)


def test_the_other_byte_order_is_noticed_at_once() -> None:
    assert wire.whole_answer(OK, "big") == (10, 10)
    with pytest.raises(
        ValueError, match=r"the prefix states 33554432 bytes, 2 were received; is byte_order of the bench file"
    ):
        wire.read_reply(OK, "big")


def test_an_identity_without_a_serial_number() -> None:
    found = wire.read_identity("Acutronic R&D USA,Acutrol3000,0,A8800-1.2")
    assert (found.maker, found.model, found.firmware) == ("Acutronic R&D USA", "Acutrol3000", "A8800-1.2")
    assert (found.serial, found.verified) == ("", False)
    assert wire.read_identity("Acutronic,Acutrol3000e,1234,A8800").serial == "1234"


@pytest.mark.parametrize("text", ["OK", "Acutronic,Acutrol3000", "KEITHLEY,MODEL 6220,1,A03"])
def test_others_are_no_acutrol(text: str) -> None:
    with pytest.raises(ValueError, match="not"):
        wire.read_identity(text)


@pytest.mark.parametrize(
    ("text", "state"),
    [
        (
            "10.50000;-3.00000;Close;Rate;512;12",
            (10.5, -3.0, Interlock.CLOSED, Mode.RATE, Dynamics.RATE_COMPLETE, wire.LOCKED_OUT),
        ),
        (  # drivers of others saw modes as initials; bits that are not used here
            "-0.00001; 0 ;FAULT;S;3103;4103",
            (-1e-5, 0.0, Interlock.FAULT, Mode.SYNTHESIS, Dynamics.AT_AMPLITUDE | Dynamics.AT_FREQUENCY,
             Supervisor.LOCKOUT),
        ),
        ("180;1e-3;open;Off;0;0", (180.0, 1e-3, Interlock.OPEN, Mode.OFF, Dynamics(0), Supervisor(0))),
    ],
)  # fmt: skip
def test_a_state_is_read(text: str, state: object) -> None:
    assert wire.read_state(text) == state


@pytest.mark.parametrize(
    "text",
    [
        "", "OK", "1;2;Close;Rate;512", "1;2;Close;Rate;512;12;0", "nan;2;Close;Rate;512;12", "1;2;Shut;Rate;512;12",
        "1;2;Close;;512;12", "1;2;Close;Ratel;512;12", "1;2;Close;Rate;0x200;12",
    ],
)  # fmt: skip
def test_what_is_no_state_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"answers to|not a number|none of|not a whole number"):
        wire.read_state(text)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("0;0", ""),
        ("6;512", "rate trip, tracking error, master interlock"),
        ("1;3", "abort, user inputs"),
        ("0;1088", "amplifier, watchdogs"),
    ],
)
def test_faults_are_named(text: str, words: str) -> None:
    assert wire.read_faults(text) == words


@given(
    st.integers(-(1 << 31), (1 << 31) - 1), st.text("ABCdef0123;,.", max_size=60), st.sampled_from(["little", "big"])
)
def test_answers_come_back_as_they_were_sent(code: int, text: str, order: wire.ByteOrder) -> None:
    answer = wire.render(Reply(code, text), order)
    assert wire.whole_answer(answer, order) == (len(answer), len(answer))
    assert wire.read_reply(answer, order) == Reply(code, text)


# The simulator's side


def test_every_message_is_answered_with_a_prefix(table: SimulatedAcutrol) -> None:
    session = table.session()
    assert session.feed(b":UTIL:LOCKOUT ON\r\n") == OK
    assert session.feed(b":MODE? 1\n") == b"\x00\x00\x00\x00\x03\x00\x00\x00Off"
    assert session.feed(b"*IDN?\n") == b"\x00\x00\x00\x00\x29\x00\x00\x00Acutronic R&D USA,Acutrol3000,0,A8800-SIM"


def test_messages_may_come_in_any_portions(table: SimulatedAcutrol) -> None:
    session = table.session()
    answers = [session.feed(bytes([byte])) for byte in b":INTERLOCK:CLOSE 1\nmode? 1\n"]
    assert b"".join(answers) == OK + b"\x00\x00\x00\x00\x03\x00\x00\x00Off"
    assert session.feed(b"x" * 40_000) == b""
    assert session.feed(b"mode? 1\n") == b"\x00\x00\x00\x00\x03\x00\x00\x00Off"


def test_mnemonics_may_be_cut_and_groups_continued(table: SimulatedAcutrol, clock: Clock) -> None:
    assert talk(table, b":int:close 1", b":d:p 1,10.5", b":m:p 1", b":Mode? 1") == ["OK", "OK", "OK", "Position"]
    clock.now_s = 10.0
    assert talk(table, b":READ:POS? 1;RATE? 1", b":read:rate 1", b"READ:POSITION? 1;:INTERLOCK? 1") == [
        "10.50000;0.00000", "0.00000", "10.50000;Close",
    ]  # fmt: skip


@pytest.mark.parametrize(
    "message",
    [
        b":FLY 1", b":MODE? 2", b":MODE?", b":DEM:RATE 1", b":DEM:RATE 1,fast", b":LIM:RATE X,1,5", b":LIM:RATE R,1,0",
        b":LIM:ACC R,2,5", b":UTIL:LOCKOUT MAYBE", b":STAT:CSR? A9DYN", b":INTERLOCK:CLOSE 2", b":READ:", b"MODE",
        b":CONFIG:OSC 1,Enable,1,1,Rate,Lin", b":MODE:TRACK 1", b":*OPC",
    ],
)  # fmt: skip
def test_what_the_controller_does_not_know_is_an_error(table: SimulatedAcutrol, message: bytes) -> None:
    talk(table, b":INTERLOCK:CLOSE 1")
    (expected_text,) = talk(table, message)
    assert expected_text.startswith("error ")


def test_a_rate_is_reached_at_the_acceleration_of_its_mode(table: SimulatedAcutrol, clock: Clock) -> None:
    talk(table, b":INTERLOCK:CLOSE 1", b":LIM:RATE R,1,50", b":LIM:ACC R,1,20", b":DEM:RATE 1,0")
    assert talk(table, b":MODE:RATE 1", b":DEM:RATE 1,40", b":STAT:CSR? A1DYN") == ["OK", "OK", "0"]
    clock.now_s = 1.0
    assert talk(table, b":READ:POS? 1;RATE? 1;:STAT:CSR? A1DYN") == ["10.00000;20.00000;0"]
    clock.now_s = 2.0
    assert talk(table, b":READ:POS? 1;RATE? 1;:STAT:CSR? A1DYN") == ["40.00000;40.00000;512"]
    clock.now_s = 6.0
    assert talk(table, b":READ:POS? 1", b":DEM:RATE 1,-90", b":MODE:POSITION 1") == ["-160.00000", "OK", "error 3"]
    clock.now_s = 20.0
    assert talk(table, b":READ:RATE? 1", b":LIM:ACC O,1,100", b":MODE:OFF 1") == ["-50.00000", "OK", "OK"]
    clock.now_s = 20.5
    assert talk(table, b":READ:RATE? 1;:STAT:CSR? A1DYN") == ["0.00000;0"]


def test_a_position_is_gone_to_the_shorter_way(table: SimulatedAcutrol, clock: Clock) -> None:
    talk(table, b":INTERLOCK:CLOSE 1", b":DEM:POS 1,350", b":MODE:POSITION 1")
    clock.now_s = 0.2
    assert talk(table, b":READ:POS? 1;RATE? 1") == ["-2.00000;-20.00000"]
    clock.now_s = 5.0
    assert talk(table, b":READ:POS? 1;:STAT:CSR? A1DYN") == ["-10.00000;256"]


def test_a_sine_grows_about_where_the_table_stands(table: SimulatedAcutrol, clock: Clock) -> None:
    talk(table, b":INTERLOCK:CLOSE 1", b":CONFIG:OSC 1,Enable,2,1,Pos,Lin", b":DEM:OSC 1,2,2,0", b":MODE:SYNTHESIS 1")
    clock.now_s = 1.0  # 2° by now; half a turn of phase, at 1 Hz
    assert talk(table, b":READ:POS? 1;RATE? 1;:STAT:CSR? A1DYN") == ["0.00000;-12.56637;0"]
    clock.now_s = 2.125  # 4 pi by 2 s, then a quarter of a turn
    assert talk(table, b":READ:POS? 1;RATE? 1;:STAT:CSR? A1DYN") == ["2.00000;0.00000;3072"]
    assert talk(table, b":DEM:OSC 1,1,1,0", b":STAT:CSR? A1DYN") == ["OK", "0"]  # at 2 °/s and 1 Hz/s from there
    clock.now_s = 3.125  # one and a half turns of phase later
    assert talk(table, b":READ:POS? 1;RATE? 1;:STAT:CSR? A1DYN") == ["-1.00000;0.00000;3072"]
    assert talk(table, b":DEM:OSC 1,0,0,0", b":MODE:OFF 1") == ["OK", "OK"]


def test_a_fault_drops_the_drive_and_stays_until_it_is_reset(table: SimulatedAcutrol, clock: Clock) -> None:
    talk(table, b":INTERLOCK:CLOSE 1", b":MODE:RATE 1", b":DEM:RATE 1,80")
    clock.now_s = 5.0
    table.trip(SoftwareFault.RATE_TRIP, InterlockInput.MASTER_INTERLOCK)
    clock.now_s = 5.2
    assert talk(table, b":INTERLOCK? 1;:MODE? 1;:READ:RATE? 1", b":STAT:CSR? A1SWFAULT;CSR? A1INTLK;CSR? A1DYN") == [
        "Fault;Off;0.00000", "2;512;512",
    ]  # fmt: skip
    assert talk(table, b":INTERLOCK:CLOSE 1", b":MODE:RATE 1", b":INTERLOCK:OPEN 1", b":INTERLOCK? 1") == [
        "error 3", "error 3", "OK", "Fault",
    ]  # fmt: skip
    assert talk(table, b":INTERLOCK:RESET", b":INTERLOCK? 1", b":STAT:CSR? A1SWFAULT;CSR? A1DYN") == [
        "OK",
        "Open",
        "0;0",
    ]
    assert talk(table, b":INTERLOCK:CLOSE 1", b":INTERLOCK? 1", b":INTERLOCK:RESET 1", b":INTERLOCK? 1") == [
        "OK", "Close", "OK", "Close",
    ]  # fmt: skip


def test_opening_the_interlock_stops_the_table_in_an_orderly_way(table: SimulatedAcutrol, clock: Clock) -> None:
    talk(table, b":INTERLOCK:CLOSE 1", b":MODE:RATE 1", b":DEM:RATE 1,80", b":LIM:ACC O,1,80")
    clock.now_s = 5.0
    talk(table, b":INTERLOCK:OPEN 1")
    clock.now_s = 5.5
    assert talk(table, b":READ:RATE? 1", b":MODE? 1", b":INTERLOCK? 1") == ["40.00000", "Off", "Open"]


def test_a_lock_out_keeps_the_front_panel_away(table: SimulatedAcutrol) -> None:
    assert table.at_panel(":INTERLOCK:CLOSE 1") == Reply(0, "OK")
    assert talk(table, b":UTIL:LOCKOUT ON", b":UTIL:REMOTELOCKOUT ON", b":STAT:CSR? SUP0") == ["OK", "OK", "12"]
    assert table.at_panel(":MODE:RATE 1").code != 0
    assert talk(table, b":UTIL:LOCKOUT OFF", b":STAT:CSR? SUP0") == ["OK", "8"]
    assert table.at_panel(":MODE:RATE 1") == Reply(0, "OK")


def test_frozen_readings(table: SimulatedAcutrol, clock: Clock) -> None:
    talk(table, b":INTERLOCK:CLOSE 1", b":MODE:RATE 1", b":DEM:RATE 1,80")
    table.faults.begin("frozen")
    clock.now_s = 5.0
    assert talk(table, b":READ:POS? 1;RATE? 1") == ["0.00000;0.00000"]


@pytest.mark.parametrize(
    ("demand", "mode"),
    [
        (b":DEM:RATE 1,80", b":MODE:RATE 1"),
        (b":DEM:POS 1,80", b":MODE:POSITION 1"),
        (b":DEM:OSC 1,5,1,0", b":MODE:SYNT 1"),
    ],
)
def test_a_stuck_table_accepts_a_demand_and_does_not_follow(
    table: SimulatedAcutrol, clock: Clock, demand: bytes, mode: bytes
) -> None:
    table.faults.begin("stuck")
    assert talk(table, b":INTERLOCK:CLOSE 1", demand, mode) == ["OK", "OK", "OK"]
    clock.now_s = 5.3
    assert talk(table, b":READ:POS? 1;RATE? 1") == ["0.00000;0.00000"]
    if mode == b":MODE:SYNT 1":
        assert talk(table, b":STAT:CSR? A1DYN") == ["0"]


def test_readings_are_asked_as_a_program_for_gpib_cuts_them_short(table: SimulatedAcutrol, clock: Clock) -> None:
    """As williamsea's Acutrol sends them: decimals first, then one reading."""
    assert talk(table, b":u:f f ; :R:P 1", b":u:f f ; :R:R 1", b":u:f f ; :R:A 1", b":D:A 1, 20") == [
        "0.00000", "0.00000", "0.00000", "OK",
    ]  # fmt: skip
    talk(table, b":INT:CLOSE 1", b":M:R 1", b":L:A R,1,50", b":D:R 1, 100")
    clock.now_s = 1.0
    assert talk(table, b":read:pos? 1;rate? 1;acc? 1") == ["25.00000;50.00000;50.00000"]
    assert talk(table, b":u:f b") == ["error 2"]


def test_a_session_of_a_program_in_python(table: SimulatedAcutrol, clock: Clock) -> None:
    """As IEAv's acutrol3000 sends it: to rest by a sine of nothing, modes by number and name, limits asked."""
    assert talk(table, b"*stb?", b":Interlock:Reset", b":mode:off 1", b":int:close 1", b":interlock? 1") == [
        "0", "OK", "OK", "OK", "Close",
    ]  # fmt: skip
    assert talk(table, b":mode:synt 1", b":dem:osc 1,0,0,0", b":mode:rate 1", b":dem:rate 1,0") == ["OK"] * 4
    assert talk(table, b":lim:acc pos,1,8300", b":limit:acc? pos,1") == ["OK", "8300.00000"]
    assert talk(table, b":lim:rate synt,1,1000", b":limit:rate? synt,1") == ["OK", "1000.00000"]
    assert len(talk(table, b":limit:absolute? 1")[0].split(",")) == 6
    assert talk(table, b":con:osc 1,Enable,2.0,0.1,Pos,Lin", b":con:osc? 1") == ["OK", "Enable,2,0.1,Pos,Lin"]
    assert talk(table, b":mode 1,pos", b":dem:delta 1,-30", b":mode? 1", b":dem:delta 1,190") == [
        "OK", "OK", "Position", "error 2",
    ]  # fmt: skip
    clock.now_s = 10.0
    assert talk(table, b":read:pos? 1", b":mode 1,synt", b":dem:osc 1,2,0.5,0") == ["-30.00000", "OK", "OK"]
    clock.now_s = 30.0
    assert table._driven.moving(clock.now_s)
    talk(table, b":dem:osc 1,0,0,0")
    clock.now_s = 40.0
    assert not table._driven.moving(clock.now_s)


def test_the_status_byte_tells_an_interlock_fault(table: SimulatedAcutrol) -> None:
    table.trip(SoftwareFault.ABORT, NO_INPUTS)
    assert talk(table, b"*stb?") == ["65"]
