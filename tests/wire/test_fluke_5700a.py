"""Lines of a Fluke 5700A typed by hand, in both directions, and the simulated calibrator that speaks them."""

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.dialects.fluke_5700a import wire
from drivers.dialects.fluke_5700a.wire import OFF, Event, Setting, State, Status
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.sources.fluke_5700a import ILLEGAL_LIMIT, SimulatedFluke
from simulators.units.settings import WorldSettings
from simulators.world import World


class Clock:
    now_s = 0.0


def a_calibrator(clock: Clock | None = None, **settings: object) -> SimulatedFluke:
    clock = clock or Clock()
    world = World(WorldSettings(seed=1, gravity_mps2=9.8), lambda: clock.now_s)
    return SimulatedFluke(world, FaultPlan(), **{"terminator": "cr", **settings})  # type: ignore[arg-type]  # a test's own settings


@pytest.fixture
def source() -> SimulatedFluke:
    return a_calibrator()


def talk(source: SimulatedFluke, *lines: bytes) -> list[bytes]:
    session = source.session()
    return [session.feed(line + b"\r") for line in lines]


# The driver's side


@pytest.mark.parametrize(
    ("level_a", "command"),
    [
        (0.0012, "OUT 0.0012 A, 0 HZ"),
        (-0.0144, "OUT -0.0144 A, 0 HZ"),
        (0.01234567, "OUT 0.01234567 A, 0 HZ"),
        (14.4e-6, "OUT 1.44E-05 A, 0 HZ"),
        (0.0, "OUT 0 A, 0 HZ"),
        (-0.0, "OUT 0 A, 0 HZ"),
    ],
)
def test_a_level_is_sent_in_plain_amperes(level_a: float, command: str) -> None:
    assert wire.set_level(level_a) == command


def test_commands_and_questions_are_words_of_the_manual() -> None:
    assert (wire.OPERATE, wire.STANDBY, wire.REMOTE, wire.ZERO) == ("OPER", "STBY", "REMOTE", "OUT 0 A, 0 HZ")
    assert (wire.LOCK_RANGE, wire.FREE_RANGE) == ("RANGELCK ON", "RANGELCK OFF")
    assert (wire.IDENTITY_QUERY, wire.STATUS_QUERY, wire.OUTPUT_QUERY) == (b"*IDN?", b"ISR?", b"OUT?")
    assert (wire.EVENTS_QUERY, wire.MINUTES_QUERY, wire.FAULT_QUERY) == (b"*ESR?", b"ETIME?", b"FAULT?")
    assert wire.EXPLAIN_QUERY.format(725) == "EXPLAIN? 725"


@pytest.mark.parametrize(
    ("line", "status"),
    [
        (b"0", Status(0)),
        (b"1", Status.OPERATING),
        (b"4096", Status.SETTLED),
        (b"2048", Status.REMOTE),
        (b"6177", Status.OPERATING | Status.RANGE_LOCKED | Status.REMOTE | Status.SETTLED),
        (b"776", Status.BOOST | Status.OFFSET | Status.SCALE),
        (b"9430", Status(0)),  # report busy, wide band, phase lock and shift, compensation, guard, sense
    ],
)
def test_the_status_is_read(line: bytes, status: Status) -> None:
    assert wire.read_status(line) == status


@pytest.mark.parametrize(
    ("line", "level_a"),
    [
        (b"1.2000000E-03,A,0.00E+00", 0.0012),
        (b"-0.0144, A, 0", -0.0144),
        (b"0.0144,A,0,22E-3", 0.0144),
        (b"10,V,0", None),
        (b"1.2E-03,A,60", None),
        (b"1.9E+01,OHM,0", None),
    ],
)
def test_the_output_is_read(line: bytes, level_a: float | None) -> None:
    assert wire.read_output(line) == level_a


@pytest.mark.parametrize(
    ("read", "line"),
    [
        (wire.read_output, b"1,0"),
        (wire.read_output, b"1.2,0,A"),
        (wire.read_output, b"9.9E37,A,0"),
        (wire.read_output, b"4096"),
        (wire.read_output, b"OUT?"),
        (wire.read_status, b"ISR?"),
        (wire.read_status, b"4096.0"),
        (wire.read_status, b"\x134096"),
        (wire.read_integer, b""),
        (wire.read_text, b"ILLEGAL LIMIT SETTING"),
        (wire.read_text, b'"'),
    ],
)
def test_anything_else_is_refused(read: Callable[[bytes], object], line: bytes) -> None:
    with pytest.raises(ValueError, match=r"not|overflow"):
        read(line)


def test_events_and_texts_are_read() -> None:
    assert wire.read_events(b"140") == Event.QUERY_ERROR | Event.DEVICE_ERROR | Event.POWER_ON
    assert wire.read_text(b'"ILLEGAL LIMIT SETTING"') == "ILLEGAL LIMIT SETTING"
    assert wire.read_integer(b"725") == 725


def test_what_flows_and_is_settled_needs_an_output_that_operates() -> None:
    assert State(Status.OPERATING | Status.SETTLED, 0.0012).settled
    assert not State(Status.SETTLED, 0.0012).settled
    assert not State(Status.OPERATING, 0.0012).settled
    assert State(Status.OPERATING, 0.0012).flowing_a == 0.0012
    assert State(Status.SETTLED, 0.0012).flowing_a == 0
    assert State(Status.OPERATING, None).flowing_a == 0
    assert str(State(Status.REMOTE, None)) == "no DC current, in standby, remote (ISR 2048)"


ON, LOCKED, REMOTE = Status.OPERATING, Status.RANGE_LOCKED, Status.REMOTE
WANTED = Setting(0.0012, True, True)


@pytest.mark.parametrize(
    ("status", "level_a", "command"),
    [
        (ON | LOCKED, 0.0012, "REMOTE"),
        (REMOTE | ON, 0.0012, "OUT 0 A, 0 HZ"),
        (REMOTE | ON, 0.0, "STBY"),
        (REMOTE | ON | LOCKED, None, "STBY"),
        (REMOTE, 0.0, "RANGELCK ON"),
        (REMOTE | LOCKED, None, "OUT 0.0012 A, 0 HZ"),
        (REMOTE | LOCKED, -0.0012, "OUT 0.0012 A, 0 HZ"),
        (REMOTE | ON | LOCKED, -0.0012, "OUT 0 A, 0 HZ"),
        (REMOTE | ON | LOCKED, 0.0144, "OUT 0.0012 A, 0 HZ"),
        (REMOTE | LOCKED, 0.0012, "OPER"),
        (REMOTE | ON | LOCKED, 0.00120002, ""),
        (REMOTE | ON | LOCKED, 0.00120003, "OUT 0.0012 A, 0 HZ"),
    ],
)
def test_the_next_command_leads_to_the_setting(status: Status, level_a: float | None, command: str) -> None:
    assert wire.next_step(State(status, level_a), WANTED, wire.band_a(0.022)) == command


@pytest.mark.parametrize(
    ("status", "level_a", "command"),
    [
        (ON, 0.0012, "REMOTE"),
        (REMOTE | ON | LOCKED, 0.0012, "OUT 0 A, 0 HZ"),
        (REMOTE | ON, 0.0, "STBY"),
        (REMOTE | ON, None, "STBY"),
        (REMOTE | LOCKED, 0.0012, "OUT 0 A, 0 HZ"),
        (REMOTE | LOCKED, 0.0, ""),
        (REMOTE, None, ""),
    ],
)
def test_it_goes_to_standby_at_zero(status: Status, level_a: float | None, command: str) -> None:
    assert wire.next_step(State(status, level_a), OFF, wire.band_a(0.022)) == command


def test_a_range_is_chosen_by_a_level_that_the_range_below_does_not_take() -> None:
    free, locked = wire.choosing_range(0.022)
    assert (free.level_a, free.output, free.range_locked) == (pytest.approx(0.00231), False, False)
    assert (locked.level_a, locked.output, locked.range_locked) == (free.level_a, False, True)


@given(
    status=st.sets(st.sampled_from([ON, LOCKED, REMOTE])), unit=st.sampled_from("AV"), was=st.floats(-0.02, 0.02),
    wanted_a=st.floats(-0.0219, 0.0219),
)  # fmt: skip
def test_on_the_way_from_any_state_ranges_change_in_standby_and_polarity_at_zero(
    status: set[Status], unit: str, was: float, wanted_a: float
) -> None:
    clock = Clock()
    source = a_calibrator(clock)
    source.level, source.unit, source.range_a = was, unit, 0.22
    source.output, source.range_locked, source.remote = ON in status, LOCKED in status, REMOTE in status
    for wanted in (*wire.choosing_range(0.022), Setting(wanted_a, True, True)):
        for _ in range(9):
            clock.now_s += 1
            registers, output = (answer.strip() for answer in talk(source, b"ISR?", b"OUT?"))
            now = State(wire.read_status(registers), wire.read_output(output))
            if not (step := wire.next_step(now, wanted, wire.band_a(0.022))):
                break
            before, was_on, range_before_a = source.level, source.output, source.range_a
            was_unit = source.unit
            talk(source, step.encode())
            if was_on:
                assert source.range_a == range_before_a or source.level == 0
                assert source.unit == was_unit
                assert before * source.level >= 0
                assert source.output or was_unit == "V" or before == pytest.approx(0, abs=wire.band_a(0.022))
        else:
            pytest.fail(f"does not come to {wanted}")
    assert (source.output, source.range_a, source.range_locked) == (True, 0.022, True)
    assert source.level == pytest.approx(wanted_a, abs=wire.band_a(0.022))
    assert talk(source, b"FAULT?") == [b"0\r"]


# The simulator's side


def test_a_session_with_a_calibrator() -> None:
    clock = Clock()
    source = a_calibrator(clock)
    assert talk(source, b"*IDN?", b"ISR?", b"OUT?") == [
        b"FLUKE,5720A,SIM-5720A-01,1.4+A,1.1,0.0\r", b"0\r", b"0.0000000E+00,V,0.00E+00\r",
    ]  # fmt: skip
    assert talk(source, b"REMOTE", b"OUT 0.0012 A, 0 HZ", b"OPER", b"OUT?") == [
        b"", b"", b"", b"1.2000000E-03,A,0.00E+00\r",
    ]  # fmt: skip
    assert source.current_a == 0.0012
    assert talk(source, b"ISR?") == [b"2048\r"]
    clock.now_s = 0.1
    assert talk(source, b"ISR?") == [b"2049\r"]
    clock.now_s = 2.9
    assert talk(source, b"ISR?") == [b"2049\r"]
    clock.now_s = 3.0
    assert talk(source, b"ISR?") == [b"6145\r"]
    talk(source, b"OUT 0.0013 A, 0 HZ")
    assert talk(source, b"ISR?", b"STBY", b"FAULT?") == [b"2049\r", b"", b"0\r"]
    assert source.current_a == 0
    clock.now_s = 4.0
    assert talk(source, b"ISR?") == [b"2048\r"]


def test_in_local_only_questions_are_heard(source: SimulatedFluke) -> None:
    talk(source, b"OUT 0.0012 A, 0 HZ", b"OPER", b"RANGELCK ON")
    assert talk(source, b"ISR?", b"OUT?", b"FAULT?") == [b"0\r", b"0.0000000E+00,V,0.00E+00\r", b"0\r"]
    assert talk(source, b"REMOTE", b"ISR?", b"LOCAL", b"ISR?", b"LOCKOUT", b"ISR?") == [
        b"", b"2048\r", b"", b"0\r", b"", b"2048\r",
    ]  # fmt: skip
    source.local()
    assert talk(source, b"ISR?") == [b"0\r"]


def test_a_locked_range_takes_no_more(source: SimulatedFluke) -> None:
    talk(source, b"REMOTE", b"OUT 0.00231 A, 0 HZ;RANGELCK ON", b"OUT 0.0219 A")
    assert (source.range_a, source.level) == (0.022, 0.0219)
    assert talk(source, b"OUT 0.022 A", b"FAULT?", b"OUT?") == [b"", b"903\r", b"2.1900000E-02,A,0.00E+00\r"]
    talk(source, b"RANGELCK OFF", b"OUT 0.022 A", b"OUT 1 A")
    assert (source.range_a, source.level) == (2.2, 1.0)
    assert talk(source, b"OUT 2.2 A", b"EXPLAIN? 903") == [b"", b'"OUTSIDE LOCKED RANGE"\r']


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        (b"OUT", b"902"),
        (b"OUT ,0 HZ", b"902"),
        (b"OUT twelve A", b"902"),
        (b"OUT 1 XA", b"902"),
        (b"OUT 1", b"902"),
        (b"OUT 1 KHZ, 1 V", b"902"),
        (b"OUT 1 A, 0 HZ, 0", b"902"),
        (b"RANGELCK 1", b"902"),
        (b"SOUR:CURR 1", b"901"),
        (b"SYST:ERR?", b"901"),
        (b"EXPLAIN? x", b"901"),
    ],
)
def test_what_a_calibrator_refuses_is_in_its_fault_queue(source: SimulatedFluke, line: bytes, fault: bytes) -> None:
    talk(source, b"REMOTE", b"*CLS", line)
    assert talk(source, b"FAULT?", b"FAULT?", b"*ESR?", b"*ESR?") == [fault + b"\r", b"0\r", b"32\r", b"0\r"]


def test_what_changes_nothing_here_is_taken_as_the_manual_has_it(source: SimulatedFluke) -> None:
    talk(source, b"REMOTE", b"*CLS")
    messages = b"EXTGUARD ON;EXTSENSE OFF;CUR_POST AUX;LIMIT 10 V, -10 V;*WAI;*OPC"
    assert talk(source, messages, b"FAULT?") == [b"", b"0\r"]
    assert talk(source, b"EXTGUARD", b"CUR_POST FRONT", b"FAULT?", b"FAULT?", b"FAULT?") == [
        b"", b"", b"902\r", b"902\r", b"0\r",
    ]  # fmt: skip


def test_the_fault_queue_keeps_the_first_faults(source: SimulatedFluke) -> None:
    source.fault(ILLEGAL_LIMIT)
    talk(source, *[b"NONSENSE"] * 20)
    codes = [answer.strip() for answer in talk(source, *[b"FAULT?"] * 17)]
    assert codes == [b"725", *[b"901"] * 14, b"905", b"0"]
    assert talk(source, b"EXPLAIN? 725", b"EXPLAIN? 7") == [b'"ILLEGAL LIMIT SETTING"\r', b'"UNKNOWN FAULT"\r']
    source.fault(ILLEGAL_LIMIT)
    assert talk(source, b"*CLS", b"FAULT?;*OPC?") == [b"", b"0\r1\r"]


def test_an_open_load_trips_it(source: SimulatedFluke) -> None:
    talk(source, b"REMOTE", b"OUT 0.01 A, 0 HZ", b"OPER")
    assert source.current_a == 0.01
    source.load_ohm = 1001
    assert source.current_a == 0
    assert talk(source, b"FAULT?", b"*ESR?") == [b"904\r", b"136\r"]


def test_other_functions_are_no_current(source: SimulatedFluke) -> None:
    talk(source, b"REMOTE", b"OUT 10 V, 0 HZ", b"OPER")
    assert source.current_a == 0
    assert talk(source, b"OUT?") == [b"1.0000000E+01,V,0.00E+00\r"]
    talk(source, b"*RST")
    assert (source.level, source.output, source.remote) == (0, False, True)


def test_the_minutes_of_its_life_are_counted() -> None:
    clock = Clock()
    source = a_calibrator(clock)
    assert talk(source, b"ETIME?") == [b"123456\r"]
    clock.now_s = 7199.0
    assert talk(source, b"ETIME?") == [b"123575\r"]


def test_restarts_and_faults(source: SimulatedFluke) -> None:
    talk(source, b"REMOTE", b"*CLS", b"OUT 0.01 A, 0 HZ", b"OPER")
    source.faults.begin("stuck")
    assert talk(source, b"STBY", b"OUT 0 A, 0 HZ", b"FAULT?", b"*ESR?") == [b"", b"", b"0\r", b"0\r"]
    assert source.current_a == 0.01
    source.restart()
    assert source.current_a == 0
    assert talk(source, b"ISR?", b"OUT?", b"*ESR?") == [b"0\r", b"0.0000000E+00,V,0.00E+00\r", b"128\r"]


@pytest.mark.parametrize(("terminator", "end"), [("cr", b"\r"), ("lf", b"\n"), ("crlf", b"\r\n")])
def test_it_hears_every_terminator_and_answers_with_its_own(terminator: str, end: bytes) -> None:
    session = a_calibrator(terminator=terminator).session()
    assert [session.feed(line) for line in (b"ISR?\r", b"ISR?\n", b"IS", b"R?\r\n", b"ISR?")] == [
        b"0" + end, b"0" + end, b"", b"0" + end, b"",
    ]  # fmt: skip


def test_in_terminal_mode_it_repeats_what_it_hears(source: SimulatedFluke) -> None:
    source.terminal = True
    assert talk(source, b"ISR?") == [b"ISR?\r0\r"]


def test_its_input_buffer_asks_for_a_pause_and_loses_what_does_not_fit(source: SimulatedFluke) -> None:
    source.busy = True
    session = source.session()
    assert session.feed(b"ISR?\r" * 19) == b""
    assert session.feed(b"ISR?\r") == b"\x13"
    assert session.feed(b"ISR?\r" * 10) == b""
    source.busy = False
    assert session.feed(b"\r") == b"\x11" + b"0\r" * 25  # 125 of 128 bytes, and a piece of the 26th question
    assert session.feed(b"ISR?\r") == b"0\r"


def test_a_line_without_an_end_is_cut_at_the_buffer(source: SimulatedFluke) -> None:
    session = source.session()
    session.feed(b"REMOTE;" + b" " * 117)
    assert session.feed(b"ISR?ISR?ISR?") == b""
    assert session.feed(b"\r") == b"2048\r"


@pytest.mark.parametrize(
    ("messages", "output"),
    [  # operators manual of the 5700A/5720A Series II, 5-9 "Parameter Syntax Rules", and what PyVISA programs send
        (b"OUT 10V", b"1.0000000E+01,V,0.00E+00"),
        (b"OUT 10 MA", b"1.0000000E-02,A,0.00E+00"),
        (b"out 0.001A, 0Hz", b"1.0000000E-03,A,0.00E+00"),
        (b"OUT -1.2 MA,0 HZ", b"-1.2000000E-03,A,0.00E+00"),
        (b"OUT 150UA", b"1.5000000E-04,A,0.00E+00"),
        (b"OUT 1 V, 100 HZ", b"1.0000000E+00,V,1.00E+02"),
        (b"OUT 1.000000e+00 V,1000.000000 Hz", b"1.0000000E+00,V,1.00E+03"),
        (b"OUT 1 V, 0.1 MHZ", b"1.0000000E+00,V,1.00E+05"),
        (b"OUT 10 V;OUT 60 HZ", b"1.0000000E+01,V,6.00E+01"),
        (b"OUT 1.9 MOHM", b"1.9000000E+06,OHM,0.00E+00"),
        (b"OUT 1.9MAOHM", b"1.9000000E+06,OHM,0.00E+00"),
        (b"OUT 100 MV", b"1.0000000E-01,V,0.00E+00"),
    ],
)
def test_units_and_multipliers_are_those_of_the_manual(source: SimulatedFluke, messages: bytes, output: bytes) -> None:
    assert talk(source, b"REMOTE", messages, b"FAULT?", b"OUT?") == [b"", b"", b"0\r", output + b"\r"]


def test_a_level_and_operate_in_one_message_energise_what_was_told(source: SimulatedFluke) -> None:
    """As a published driver of the 5730A sends it; `*CLS` would hide that a level was refused."""
    talk(source, b"REMOTE", b"OUT 5 MA;OPER", b"OUT 0.001A, 0Hz;*CLS;OPER")
    assert source.current_a == 1e-3
    talk(source, b"OUT 1 MA, 60 HZ")
    assert source.current_a == 0.0  # no direct current


def test_the_status_byte_sums_the_events_up_that_are_enabled(source: SimulatedFluke) -> None:
    assert talk(source, b"*CLS", b"*ESE 32;*SRE 32", b"*ESE?", b"NONSENSE") == [b"", b"", b"32\r", b""]
    assert talk(source, b"*STB?", b"*ESR?", b"*STB?", b"*ESE 256", b"FAULT?") == [
        b"32\r", b"32\r", b"0\r", b"", b"901\r",
    ]  # fmt: skip
