"""Lines of a Keithley 6220 typed by hand, in both directions, and the simulated source that speaks them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.dialects.keithley_6220 import wire
from drivers.dialects.keithley_6220.wire import Condition, State
from drivers.kinds.source.setting import Setting
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.sources.keithley_6220 import SimulatedKeithley
from simulators.units.settings import WorldSettings
from simulators.world import World


def a_source(**settings: object) -> SimulatedKeithley:
    world = World(WorldSettings(seed=1, gravity_mps2=9.8), lambda: 0.0)
    return SimulatedKeithley(world, FaultPlan(), **{"terminator": "cr", **settings})  # type: ignore[arg-type]  # a test's own settings


@pytest.fixture
def source() -> SimulatedKeithley:
    return a_source()


def talk(source: SimulatedKeithley, *lines: bytes) -> list[bytes]:
    session = source.session()
    return [session.feed(line + b"\r") for line in lines]


# The driver's side


def test_the_question_for_the_state_is_one_message() -> None:
    assert wire.STATE_QUERY == (
        b":SOUR:CURR:RANG?;:SOUR:CURR:RANG:AUTO?;:SOUR:CURR?;:SOUR:CURR:COMP?;:OUTP?;:STAT:MEAS:COND?"
    )


def test_the_state_is_read() -> None:
    line = b"2.000000E-02; 0; -1.200000E-03; 1.000000E+01; 1; 8"
    assert wire.read_state(line) == State(Setting(0.02, -0.0012, 10.0, True), False, Condition.COMPLIANCE)
    line = b"2E-02;1;0;10;0;38"  # bits 1 and 2, and reading-ready, which says nothing here
    assert wire.read_state(line).condition == Condition.INTERLOCK | Condition.OVER_TEMPERATURE


@pytest.mark.parametrize(
    "line",
    [
        b"2E-02;0;1.2E-03;10;1",
        b"2E-02;0;9.9E37;10;1;0",
        b"2E-02;0;1.2E-03;10;on;0",
        b"2E-02;0;1.2E-03;10;1;8.0",
        b"KEITHLEY INSTRUMENTS INC.,MODEL 6220,1,A02",
    ],
)
def test_anything_else_is_refused(line: bytes) -> None:
    with pytest.raises(ValueError, match=r"answers|overflow|neither|whole"):
        wire.read_state(line)


WANTED = Setting(0.02, 0.0012, 10.0, True)


@pytest.mark.parametrize(
    ("range_a", "auto", "level_a", "compliance_v", "output", "command"),
    [
        (0.1, False, 0.05, 10.0, True, ":SOUR:CURR 0"),
        (0.1, False, 0.0, 10.0, True, ":OUTP OFF"),
        (0.1, False, 0.05, 10.0, False, ":SOUR:CURR 0"),
        (0.1, False, 0.0, 10.0, False, ":SOUR:CURR:RANG 0.02"),
        (0.02, True, 0.05, 10.0, True, ":SOUR:CURR:RANG:AUTO 0"),
        (0.02, False, 0.0, 9.99, False, ":SOUR:CURR:COMP 10"),
        (0.02, False, 0.0, 10.0, False, ":SOUR:CURR 0.0012"),
        (0.02, False, -0.0012, 10.0, True, ":SOUR:CURR 0"),
        (0.02, False, 0.0005, 10.0, True, ":SOUR:CURR 0.0012"),
        (0.02, False, 0.0012, 10.0, False, ":OUTP ON"),
        (0.02, False, 0.0012005, 10.004, True, ""),
        (0.02, False, 0.001201, 10.0, True, ":SOUR:CURR 0.0012"),
    ],
)
def test_the_next_command_leads_to_the_setting(
    range_a: float, auto: bool, level_a: float, compliance_v: float, output: bool, command: str
) -> None:
    now = State(Setting(range_a, level_a, compliance_v, output), auto, Condition(0))
    assert wire.next_step(now, WANTED) == command


@pytest.mark.parametrize(
    ("level_a", "output", "command"),
    [(0.0012, True, ":SOUR:CURR 0"), (0.0, True, ":OUTP OFF"), (0.0012, False, ":SOUR:CURR 0"), (0.0, False, "")],
)
def test_it_goes_off_at_zero(level_a: float, output: bool, command: str) -> None:
    now = State(Setting(0.02, level_a, 10.0, output), False, Condition(0))
    assert wire.next_step(now, Setting(0.02, 0.0, 10.0, False)) == command


@pytest.mark.parametrize(("range_a", "step_a"), [(0.002, 100e-9), (0.02, 1e-6), (0.1, 10e-6)])
def test_a_level_is_rounded_as_the_specification_says(range_a: float, step_a: float) -> None:
    assert wire.step_a(range_a) == pytest.approx(step_a)


levels_a = st.floats(-0.1, 0.1)


@given(was=levels_a, range_a=st.sampled_from(wire.RANGES_A), output=st.booleans(), auto=st.booleans(), data=st.data())
def test_on_the_way_to_any_setting_range_and_polarity_change_at_zero(
    was: float, range_a: float, output: bool, auto: bool, data: st.DataObject
) -> None:
    source = a_source()
    source.level_a, source.range_a, source.auto_range = max(-range_a, min(was, range_a)), range_a, auto
    source.output = output
    wanted_range_a = data.draw(st.sampled_from(wire.RANGES_A))
    level_a = data.draw(st.floats(-1.05 * wanted_range_a, 1.05 * wanted_range_a))
    wanted = Setting(wanted_range_a, level_a, data.draw(st.floats(0.1, 105)), True)
    sent = 0
    while step := wire.next_step(wire.read_state(talk(source, wire.STATE_QUERY)[0].strip()), wanted):
        before_a, was_on, range_before_a = source.level_a, source.output, source.range_a
        talk(source, step.encode())
        assert before_a * source.level_a >= 0
        if source.range_a != range_before_a:
            assert (before_a, was_on) == (0, False)
        if was_on and not source.output:
            assert before_a == 0
        sent += 1
        assert sent <= 7
    assert source.output
    assert source.level_a == pytest.approx(level_a, abs=0.6 * wire.step_a(wanted_range_a))
    assert talk(source, b"SYST:ERR?") == [b'0,"No error"\r']


# The simulator's side


def test_a_session_with_a_source(source: SimulatedKeithley) -> None:
    assert talk(source, b"*IDN?", b":SOUR:CURR:RANG 0.02;:SOUR:CURR 0.0012;:SOUR:CURR:COMP 10;:OUTP ON") == [
        b"KEITHLEY INSTRUMENTS INC.,MODEL 6220,SIM-6220-01,D04  /700x\r", b"",
    ]  # fmt: skip
    assert talk(source, b"SOURce:CURRent:RANGe?", b"CURR?;:OUTP?", b"SOUR:CURR:COMP?", b"SYST:ERR?") == [
        b"2.000000E-02\r", b"1.200000E-03; 1\r", b"1.000000E+01\r", b'0,"No error"\r',
    ]  # fmt: skip
    assert source.current_a == pytest.approx(0.0012)
    assert talk(source, b"*RST", b"OUTP?;:CURR?;:CURR:RANG:AUTO?") == [b"", b"0; 0.000000E+00; 1\r"]
    assert source.current_a == 0


@pytest.mark.parametrize("terminator", ["lf", "crlf"])
def test_over_tcp_it_acts_on_an_lf(terminator: str) -> None:
    session = a_source(terminator=terminator, is_serial_line=False).session()
    assert session.feed(b"OUTP?\n").strip() == b"0"


@pytest.mark.parametrize(
    ("terminator", "silent", "received", "answer"),
    [
        ("cr", b"OUTP?\n", b"OUTP?\r", b"0\r"),
        ("lf", b"OUTP?\r", b"OUTP?\n", b"0\n"),
        ("crlf", b"OUTP?\n", b"OUTP?\r\n", b"0\r\n"),
    ],
)
def test_it_acts_on_its_own_terminator_only(terminator: str, silent: bytes, received: bytes, answer: bytes) -> None:
    assert a_source(terminator=terminator).session().feed(silent) == b""
    assert a_source(terminator=terminator).session().feed(received) == answer


@pytest.mark.parametrize(
    ("lines", "entry"),
    [
        ([b"CURR 0.2"], b'-222,"Data out of range"'),
        ([b"CURR:RANG 0.002", b"CURR 0.0022"], b'-222,"Data out of range"'),
        ([b"CURR 0.02", b"CURR:RANG 0.002"], b'-221,"Settings conflict"'),
        ([b"CURR:COMP 106"], b'-222,"Data out of range"'),
        ([b"CURR twelve"], b'-104,"Data type error"'),
        ([b"CURR:LIMIT 1"], b'-113,"Undefined header"'),
    ],
)
def test_what_a_source_refuses_is_in_its_error_queue(
    source: SimulatedKeithley, lines: list[bytes], entry: bytes
) -> None:
    talk(source, *lines)
    assert talk(source, b"STAT:QUE?", b"SYST:ERR?") == [entry + b"\r", b'0,"No error"\r']


def test_a_range_takes_five_per_cent_more_and_rounds_to_its_step(source: SimulatedKeithley) -> None:
    talk(source, b"CURR:RANG 0.002;:CURR 0.0021")
    assert talk(source, b"CURR?") == [b"2.100000E-03\r"]
    talk(source, b"CURR 0.00123456")
    assert talk(source, b"CURR?") == [b"1.234600E-03\r"]


def test_auto_range_follows_the_level(source: SimulatedKeithley) -> None:
    talk(source, b"CURR 0.0012")
    assert talk(source, b"CURR:RANG?;RANG:AUTO?") == [b"2.000000E-03; 1\r"]
    talk(source, b"CURR:RANG 0.1", b"CURR:RANG:AUTO 1")
    assert talk(source, b"CURR:RANG?") == [b"2.000000E-03\r"]


def test_an_open_load_is_in_compliance(source: SimulatedKeithley) -> None:
    talk(source, b"CURR 0.01;:CURR:COMP 2;:OUTP ON")
    assert talk(source, b"STAT:MEAS:COND?") == [b"0\r"]
    source.load_ohm = 1000
    assert talk(source, b"STAT:MEAS:COND?") == [b"8\r"]
    assert source.current_a == pytest.approx(0.002)


def test_an_open_interlock_forces_the_output_off_and_keeps_it_off(source: SimulatedKeithley) -> None:
    talk(source, b"CURR 0.01;:OUTP ON")
    source.interlock_closed = False
    assert talk(source, b"OUTP?;:STAT:MEAS:COND?") == [b"0; 2\r"]
    assert talk(source, b"OUTP ON", b"SYST:ERR?", b"OUTP?") == [b"", b'-221,"Settings conflict"\r', b"0\r"]
    source.interlock_closed = True
    source.hot = True
    assert talk(source, b"OUTP ON", b"OUTP?;:STAT:MEAS:COND?") == [b"", b"1; 4\r"]


def test_restarts_and_faults(source: SimulatedKeithley) -> None:
    talk(source, b"*CLS;:CURR 0.01;:OUTP ON")
    source.faults.begin("stuck")
    assert talk(source, b"CURR 0;:OUTP OFF", b"CURR?;:OUTP?;*ESR?") == [b"", b"1.000000E-02; 1; 0\r"]
    source.restart()
    assert talk(source, b"CURR?;:OUTP?;*ESR?") == [b"0.000000E+00; 0; 128\r"]


def test_a_setting_is_compared_as_it_was_sent() -> None:
    source = a_source()
    talk(source, b"CURR:RANG 0.02;:CURR:COMP 100.915;:OUTP ON")
    state = wire.read_state(talk(source, wire.STATE_QUERY)[0].strip())
    assert state.setting.compliance_v == pytest.approx(100.92)
    assert wire.next_step(state, Setting(0.02, 0.0, 100.91489474311184, True)) == ""


def test_settings_that_change_nothing_here_are_kept_and_told(source: SimulatedKeithley) -> None:
    # As PyMeasure's driver of a 6221 sends them, and InstrumentKit's of a 6220 (SOUR:CLE:IMM).
    messages = b"OUTP:ISH?;:OUTP:LTE?;:SOUR:DEL?;:STAT:OPER:ENAB?;:DISP:ENAB?;*SRE?"
    assert talk(source, messages) == [b"OLOW; 0; 1.000000E+00; 0; 1; 0\r"]
    talk(source, b":OUTPut:ISHield GUAR", b"OUTP:LTE 1", b":SOUR:DEL 0.5", b":STAT:OPER:ENAB 128", b"*SRE 128")
    assert talk(source, messages) == [b"GUAR; 1; 5.000000E-01; 128; 1; 128\r"]
    assert talk(source, b"OUTP:ISH EARTH", b"SYST:ERR?") == [b"", b'-224,"Illegal parameter value"\r']
    talk(source, b"CURR 0.0012;:OUTP ON", b"SOUR:CLE:IMM")
    assert talk(source, b"OUTP?;:CURR?", b"*RST;:SOUR:DEL?") == [b"0; 0.000000E+00\r", b"1.000000E+00\r"]


def test_a_6220_makes_no_waves(source: SimulatedKeithley) -> None:
    assert talk(source, b":SOUR:WAVE:FREQ?", b"SYST:ERR?") == [b"", b'-113,"Undefined header"\r']


def test_a_wave_is_armed_begun_and_ended() -> None:
    # Commands as PyMeasure's driver sends them; bit 4 of the operation register is in the manual, 7 in that driver.
    clock = [0.0]
    world = World(WorldSettings(seed=1, gravity_mps2=9.8), lambda: clock[0])
    source = SimulatedKeithley(world, FaultPlan(), terminator="cr", model="6221")
    assert talk(source, b"*IDN?") == [b"KEITHLEY INSTRUMENTS INC.,MODEL 6221,SIM-6220-01,D04  /700x\r"]
    assert talk(source, b":SOUR:WAVE:FUNC?;FREQ?;DUR:TIME?;:SOUR:WAVE:PMAR?") == [
        b"SIN; 1.000000E+03; 9.900000E+37; 1.800000E+02\r"
    ]
    talk(source, b":SOUR:WAVE:FUNC SQU;AMPL 0.01;OFFS 0.002;FREQ 100;DUR:CYCL 50", b"STAT:OPER:ENAB 128;*SRE 128;*CLS")
    assert talk(source, b":SOUR:WAVE:INIT", b"SYST:ERR?") == [b"", b'-221,"Settings conflict"\r']
    assert talk(source, b":SOUR:WAVE:ARM;:STAT:OPER:COND?", b":SOUR:WAVE:FUNC SIN") == [b"0\r", b""]
    assert talk(source, b":SOUR:WAVE:FREQ 100;:SYST:ERR?;ERR?") == [b'-221,"Settings conflict"; 0,"No error"\r']
    assert talk(source, b":SOUR:WAVE:INIT", b"OUTP?;:STAT:OPER:COND?;:STAT:OPER?") == [b"", b"1; 16; 16\r"]
    assert source.current_a == pytest.approx(0.002)
    assert talk(source, b"*STB?") == [b"0\r"]
    clock[0] = 0.6
    assert talk(source, b"*STB?") == [b"192\r"]
    assert talk(source, b"STAT:OPER:EVEN?;:OUTP?", b"STAT:OPER?") == [b"128; 0\r", b"0\r"]
    assert source.current_a == 0
    talk(source, b":SOUR:WAVE:DUR:CYCL INF;:SYST:ERR?", b":SOUR:WAVE:ABOR", b":SOUR:WAVE:DUR:CYCL INF")
    talk(source, b":SOUR:WAVE:ARM;:SOUR:WAVE:INIT")
    clock[0] = 1000.0
    assert source.current_a == pytest.approx(0.002)
    assert talk(source, b":SOUR:WAVE:ABOR", b"STAT:OPER:COND?;:OUTP?;:SYST:ERR?") == [b"", b'1024; 0; 0,"No error"\r']


def test_a_wave_needs_the_interlock_and_a_range_that_it_fits_in() -> None:
    source = a_source(model="6221")
    talk(source, b":SOUR:WAVE:AMPL 0.1;OFFS 0.01;:SOUR:WAVE:ARM")
    assert talk(source, b"SYST:ERR?", b"SYST:ERR?") == [b'-221,"Settings conflict"\r', b'0,"No error"\r']
    source.interlock_closed = False
    talk(source, b":SOUR:WAVE:OFFS 0;:SOUR:WAVE:ARM;INIT")
    assert talk(source, b"SYST:ERR?", b"OUTP?;:STAT:OPER:COND?") == [b'-221,"Settings conflict"\r', b"0; 0\r"]
