"""Lines of a Yokogawa GS200 typed by hand, in both directions, and the simulated source that speaks them."""

import pytest

from drivers.dialects.yokogawa_gs200 import wire
from drivers.dialects.yokogawa_gs200.wire import Condition, State
from drivers.kinds.source.setting import Setting
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.sources.yokogawa_gs200 import SimulatedGS200
from simulators.units.settings import WorldSettings
from simulators.world import World


@pytest.fixture
def source() -> SimulatedGS200:
    return SimulatedGS200(World(WorldSettings(seed=1, gravity_mps2=9.8), lambda: 0.0), FaultPlan())


def talk(source: SimulatedGS200, *lines: bytes) -> list[bytes]:
    session = source.session()
    return [session.feed(line + b"\n") for line in lines]


# The driver's side


def test_the_question_for_the_state_is_one_message() -> None:
    assert wire.STATE_QUERY == b":SOUR:FUNC?;:SOUR:RANG?;:SOUR:LEV?;:SOUR:PROT:VOLT?;:OUTP?;:STAT:COND?"


@pytest.mark.parametrize(
    ("line", "state"),
    [
        (
            b"CURR;10E-3;-1.2000E-03;10;1;1280",
            State("CURR", Setting(0.01, -0.0012, 10.0, True), Condition.LOW_LIMITING),
        ),  # and ready for a program, which says nothing here
        (
            b"VOLT;+3.00000E+01;+0.00000E+00;30;0;8192",
            State("VOLT", Setting(30.0, 0.0, 30.0, False), Condition.EMERGENCY),
        ),
    ],
)
def test_the_state_is_read(line: bytes, state: State) -> None:
    assert wire.read_state(line) == state


@pytest.mark.parametrize(
    "line",
    [
        b"CURR;10E-3;0;10;1",
        b"CURR;10E-3;0;10;1;1.0",
        b"RES;10E-3;0;10;0;0",
        b"CURR;10E-3;0;10;ON;0",
        b"CURR;10E-3;9.9E37;10;0;0",
        b"YOKOGAWA,GS210,91W000001,2.02",
    ],
)
def test_anything_else_is_refused(line: bytes) -> None:
    with pytest.raises(ValueError, match=r"answers|neither|overflow|whole"):
        wire.read_state(line)


WANTED = Setting(0.01, 0.0012, 10.0, True)


@pytest.mark.parametrize(
    ("now", "command"),
    [
        (State("VOLT", Setting(30, 5.0, 30, True)), ":SOUR:LEV 0"),
        (State("VOLT", Setting(30, 0.0, 30, True)), ":OUTP 0"),
        (State("VOLT", Setting(30, 0.0, 30, False)), ":SOUR:FUNC CURR"),
        (State("CURR", Setting(0.2, 0.05, 30, True)), ":SOUR:LEV 0"),
        (State("CURR", Setting(0.2, 0.0, 30, True)), ":OUTP 0"),
        (State("CURR", Setting(0.2, 0.0, 30, False)), ":SOUR:RANG 0.01"),
        (State("CURR", Setting(0.01, 0.0, 30, False)), ":SOUR:PROT:VOLT 10"),
        (State("CURR", Setting(0.01, 0.0, 10, False)), ":SOUR:LEV 0.0012"),
        (State("CURR", Setting(0.01, -0.0012, 10, True)), ":SOUR:LEV 0"),
        (State("CURR", Setting(0.01, 0.0012, 10, False)), ":OUTP 1"),
        (State("CURR", Setting(0.01, 0.00120004, 10, True)), ""),
        (State("CURR", Setting(0.01, 0.0012002, 10, True)), ":SOUR:LEV 0.0012"),
    ],
)
def test_the_next_command_leads_to_the_setting(now: State, command: str) -> None:
    assert wire.next_step(now, WANTED) == command


@pytest.mark.parametrize(
    ("level", "output", "command"), [(5, True, ":SOUR:LEV 0"), (0, True, ":OUTP 0"), (0, False, "")]
)
@pytest.mark.parametrize("function", ["CURR", "VOLT"])
def test_it_goes_off_at_zero_whatever_it_gives(function: str, level: float, output: bool, command: str) -> None:
    now = State(wire.FUNCTIONS[function], Setting(0.01, level, 10, output))
    assert wire.next_step(now, Setting(0.01, 0.0, 10, False)) == command


@pytest.mark.parametrize(
    ("range_a", "most_a", "step_a"), [(1e-3, 1.2e-3, 10e-9), (0.01, 0.012, 100e-9), (0.1, 0.12, 1e-6), (0.2, 0.2, 1e-6)]
)
def test_a_range_has_its_largest_level_and_its_step(range_a: float, most_a: float, step_a: float) -> None:
    assert wire.max_a(range_a) == pytest.approx(most_a)
    assert wire.step_a(range_a) == pytest.approx(step_a)


# The simulator's side


def test_a_session_with_a_source(source: SimulatedGS200) -> None:
    assert talk(source, b"*IDN?", wire.STATE_QUERY) == [
        b"YOKOGAWA,GS210,SIM-GS200-01,2.02\n", b"VOLT;30E+0;+0.00000E+00;+30E+0;0;0\n",
    ]  # fmt: skip
    assert talk(source, b":SOUR:FUNC CURR;:SOUR:RANG 10E-3;:SOUR:LEV 0.0012;:SOUR:PROT:VOLT 5;:OUTP 1") == [b""]
    assert talk(source, wire.STATE_QUERY, b":SYST:ERR?") == [
        b"CURR;10E-3;+1.20000E-03;+5E+0;1;0\n", b'0,"No error"\n',
    ]  # fmt: skip
    assert source.current_a == pytest.approx(0.0012)
    talk(source, b":SOUR:FUNC VOLT")
    assert talk(source, b"OUTP?;SOUR:LEV?") == [b"0;+0.00000E+00\n"]
    talk(source, b"SOUR:RANG 1", b"SOUR:LEV 1", b"OUTP ON")
    assert source.current_a == pytest.approx(0.01)
    talk(source, b"*RST")
    assert source.feeds_a is None


@pytest.mark.parametrize(
    ("lines", "entry"),
    [
        ([b"SOUR:LEV 0.21"], b'-222,"Data out of range"'),
        ([b"SOUR:RANG 1E-3", b"SOUR:LEV 0.00121"], b'-222,"Data out of range"'),
        ([b"SOUR:LEV:AUTO 0.02", b"SOUR:RANG 1E-3"], b'-221,"Settings conflict"'),
        ([b"SOUR:PROT:VOLT 31"], b'-222,"Data out of range"'),
        ([b"SOUR:PROT:CURR 0.3"], b'-222,"Data out of range"'),
        ([b"SOUR:FUNC RES"], b'-224,"Illegal parameter value"'),
        ([b"SOUR:LIMIT 1"], b'-113,"Undefined header"'),
    ],
)
def test_what_a_source_refuses_is_in_its_error_queue(source: SimulatedGS200, lines: list[bytes], entry: bytes) -> None:
    talk(source, b"SOUR:FUNC CURR;:SOUR:RANG 0.2", *lines)
    assert talk(source, b"SYST:ERR?", b"SYST:ERR?") == [entry + b"\n", b'0,"No error"\n']


def test_a_range_takes_twenty_per_cent_more_and_rounds_to_its_step(source: SimulatedGS200) -> None:
    talk(source, b"SOUR:FUNC CURR", b"SOUR:RANG 1E-3", b"SOUR:LEV 0.0012")
    assert talk(source, b"SOUR:LEV?") == [b"+1.20000E-03\n"]
    talk(source, b"SOUR:LEV 0.001000014")
    assert talk(source, b"SOUR:LEV?") == [b"+1.00001E-03\n"]
    talk(source, b"SOUR:LEV:AUTO 0.0121")
    assert talk(source, b"SOUR:RANG?;LEV?") == [b"100E-3;+1.21000E-02\n"]


def test_its_voltage_limit_keeps_a_current_from_flowing_and_its_condition_tells(source: SimulatedGS200) -> None:
    talk(source, b"SOUR:FUNC CURR;:SOUR:RANG 0.01;:SOUR:LEV 0.01;:SOUR:PROT:VOLT 2;:OUTP 1")
    source.load_ohm = 1000
    assert source.current_a == pytest.approx(0.002)
    assert talk(source, wire.STATE_QUERY) == [b"CURR;10E-3;+1.00000E-02;+2E+0;1;2048\n"]
    assert talk(source, b"SOUR:LEV -0.01", b"STAT:COND?") == [b"", b"1024\n"]
    source.emergency = True
    assert talk(source, b"OUTP 0", b"STAT:COND?") == [b"", b"8192\n"]


def test_restarts_and_faults(source: SimulatedGS200) -> None:
    talk(source, b"*CLS;:SOUR:FUNC CURR;:SOUR:LEV:AUTO 0.01;:OUTP 1")
    source.faults.begin("stuck")
    assert talk(source, b"SOUR:LEV 0;:OUTP 0", b"SOUR:LEV?;:OUTP?;*ESR?") == [b"", b"+1.00000E-02;1;0\n"]
    source.restart()
    assert talk(source, b"SOUR:FUNC?;LEV?;:OUTP?;*ESR?") == [b"VOLT;+0.00000E+00;0;128\n"]


def test_ranges_and_limits_are_told_as_manual_and_programs_of_other_people_have_them(source: SimulatedGS200) -> None:
    # The limits as in the user's manual, page 13-12; the ranges as exopy's driver compares them.
    assert talk(source, b"SOUR:PROT:VOLT? MIN", b"SOUR:PROT:VOLT? MAX") == [b"+1E+0\n", b"+30E+0\n"]
    assert talk(source, b"SOUR:PROT:VOLT? SOME", b"SYST:ERR?") == [b"", b'-108,"Parameter not allowed"\n']
    talk(source, b"SOUR:FUNC CURR")
    for range_ in (b"1E-3", b"10E-3", b"100E-3", b"200E-3"):
        assert talk(source, b"SOUR:RANG " + range_, b"SOUR:RANG?") == [b"", range_ + b"\n"]
    messages = {b"UP": b"200E-3", b"DOWN": b"100E-3", b"MIN": b"1E-3", b"MAX": b"200E-3"}
    assert [talk(source, b"SOUR:RANG " + word, b"SOUR:RANG?")[1].strip() for word in messages] == list(
        messages.values()
    )
    talk(source, b"SOUR:FUNC VOLT")
    for range_ in (b"10E-3", b"1E+0", b"30E+0"):
        assert talk(source, b"SOUR:RANG " + range_, b"SOUR:RANG?") == [b"", range_ + b"\n"]


def test_settings_that_change_nothing_here_are_kept(source: SimulatedGS200) -> None:
    asked = b"SENS:REM?;:SENS:GUAR?;:ROUT:BNCO?;:ROUT:BNCI?;:SYST:LFR?"
    assert talk(source, asked) == [b"0;0;TRIG;TRIG;50\n"]
    talk(source, b"SENS:REM 1", b":ROUT:BNCO ready")
    assert talk(source, asked) == [b"1;0;READ;TRIG;50\n"]


def test_a_program_ramps_the_level_and_tells_its_end() -> None:
    # As PyMeasure's driver and QCoDeS's ramp a level.
    clock = [0.0]
    source = SimulatedGS200(World(WorldSettings(seed=1, gravity_mps2=9.8), lambda: clock[0]), FaultPlan())
    talk(source, b"SOUR:FUNC CURR;:SOUR:RANG 10E-3;:SOUR:LEV 0.001")
    program = b":program:edit:start;:source:level 0.005;:program:edit:end;:program:interval 4;:program:slope 2"
    assert talk(source, program, b":program:run", b"SYST:ERR?") == [b"", b"", b'-221,"Settings conflict"\n']
    assert talk(source, b"SOUR:LEV?", b"OUTP 1", b":program:repeat 0;:program:run", b"STAT:EVEN?") == [
        b"+1.00000E-03\n", b"", b"", b"0\n",
    ]  # fmt: skip
    clock[0] = 1.0
    assert talk(source, b"SOUR:LEV?", b"STAT:EVEN?") == [b"+3.00000E-03\n", b"0\n"]
    assert source.current_a == pytest.approx(0.003)
    clock[0] = 3.0
    assert talk(source, b"SOUR:LEV?", b"STAT:EVEN?") == [b"+5.00000E-03\n", b"0\n"]
    clock[0] = 5.0
    assert talk(source, b"SOUR:LEV?", b"STAT:EVEN?", b"STAT:EVEN?") == [b"+5.00000E-03\n", b"192\n", b"0\n"]
    talk(source, b"PROG:RUN;:PROG:HOLD", b"PROG:EDIT:STAR;:SOUR:LEV 0;:SOUR:LEV 0.01;:PROG:EDIT:END")
    talk(source, b"PROG:REP 1;SLOP 0;RUN")
    clock[0] = 6.0
    assert talk(source, b"SOUR:LEV?") == [b"+0.00000E+00\n"]
    clock[0] = 10.0
    assert talk(source, b"SOUR:LEV?") == [b"+1.00000E-02\n"]
    clock[0] = 14.0
    assert talk(source, b"SOUR:LEV?", b"SOUR:LEV 0.002", b"SOUR:LEV?") == [b"+0.00000E+00\n", b"", b"+2.00000E-03\n"]
    talk(source, b"PROG:RUN")
    clock[0] = 20.0
    assert talk(source, b"SOUR:LEV?;:OUTP 0;:SOUR:LEV?") == [b"+1.00000E-02;+1.00000E-02\n"]
    assert talk(source, b"PROG:EDIT:STAR;:PROG:RUN;:SYST:ERR?") == [b'-221,"Settings conflict"\n']


def test_errors_are_asked_by_the_question_of_its_maker_too(source: SimulatedGS200) -> None:
    assert talk(source, b"NONSENSE", b":STAT:ERR?", b":STATUS:ERROR?", b"STAT:QUE?", b":SYST:ERR?") == [
        b"", b'-113,"Undefined header"\n', b'0,"No error"\n', b"", b'-113,"Undefined header"\n',
    ]  # fmt: skip


def test_a_ramp_in_one_message_as_a_curve_tracer_sends_it(source: SimulatedGS200) -> None:
    program = b"*CLS;:PROG:REP 0;SLOP 2.0;INT 2.0;EDIT:STAR;:SOUR:LEV 5.000000E-03;:PROG:EDIT:END;:PROG:RUN"
    assert talk(source, b":OUTP 1;:ROUT:BNCO TRIG", program, b":STAT:EVEN?", b":STAT:ERR?")[-1] == b'0,"No error"\n'
