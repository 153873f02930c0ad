"""Lines of an Agilent 34970A typed by hand, in both directions, and the simulated scanner that speaks them."""

import re
from collections.abc import Callable

import pytest

from drivers.dialects.agilent_34970a import wire
from drivers.dialects.agilent_34970a.wire import Sample, Sensor, State
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.meters.agilent_34970a import SimulatedScanner
from simulators.units.settings import WorldSettings
from simulators.world import World

SENSORS = [Sensor(101, "FRTD", "85"), Sensor(102, "TC", "K"), Sensor(103, "RTD", "91")]


@pytest.fixture
def clock() -> list[float]:
    """What the world's clock shows (s)."""
    return [0.0]


@pytest.fixture
def scanner(clock: list[float]) -> SimulatedScanner:
    world = World(WorldSettings(seed=1, gravity_mps2=9.8), lambda: clock[0])
    return SimulatedScanner(world, FaultPlan(), {101: "x", 102: "y", 103: "z"})


def talk(scanner: SimulatedScanner, *lines: bytes) -> list[bytes]:
    session = scanner.session()
    return [session.feed(line + b"\r\n") for line in lines]


# The driver's side


def test_a_scan_is_set_up_message_by_message_with_its_list_last() -> None:
    assert wire.set_up(SENSORS) == [
        ":ABOR",
        ":TRIG:SOUR IMM;:TRIG:COUN 1",
        ":FORM:READ:UNIT ON;:FORM:READ:TIME ON;:FORM:READ:TIME:TYPE REL;:FORM:READ:CHAN ON;:FORM:READ:ALAR OFF",
        ":CONF:TEMP FRTD,85,(@101)",
        ":CONF:TEMP TC,K,(@102)",
        ":CONF:TEMP RTD,91,(@103)",
        ":UNIT:TEMP C,(@101,102,103)",
        ":ROUT:SCAN (@101,102,103)",
    ]
    assert wire.state_query(SENSORS) == (
        b":ROUT:SCAN?;:TEMP:TRAN:TYPE? (@101,102,103);:UNIT:TEMP? (@101,102,103);:STAT:OPER:COND?"
    )
    assert [wire.type_query(sensor) for sensor in SENSORS[:2]] == [
        b":TEMP:TRAN:FRTD:TYPE? (@101)", b":TEMP:TRAN:TC:TYPE? (@102)",
    ]  # fmt: skip


def test_the_state_is_read() -> None:
    assert wire.read_state(b"#214(@101,102,103);FRTD,TC,RTD;C,C,C;+0") == wire.state_when(SENSORS)
    assert wire.read_state(b"#213(@101,102,103);FRTD,TC,RTD;C,C,F;+272".replace(b"13(", b"14(")) == State(
        (101, 102, 103), ("FRTD", "TC", "RTD"), ("C", "C", "F"), True
    )
    assert wire.read_state(b"#13(@);TC;C;0").channels == ()


@pytest.mark.parametrize(
    "line",
    [
        b"#213(@101,102,103);FRTD,TC,RTD;C,C,C;0",
        b"#014(@101,102,103);FRTD,TC,RTD;C,C,C;0",
        b"#21x(@101,102,103);FRTD,TC,RTD;C,C,C;0",
        b"(@101,102,103);FRTD,TC,RTD;C,C,C;0",
        b"#16(@1o1);TC;C;0",
        b"#213(@101,102,10);TC;C;0",
        b"#16(@101);TC;C",
        b"#16(@101);TC;C;on",
    ],
)
def test_another_state_is_refused(line: bytes) -> None:
    with pytest.raises(ValueError, match=r"block|list of channels|answers|whole number"):
        wire.read_state(line)


def test_a_scan_is_read_with_its_times_and_an_open_sensor_has_no_reading() -> None:
    line = b"+2.12468981E+01 C,00000000.200,101,-5.50000000E+01 C,00000000.400,102,+9.90000000E+37 C,00000000.600,103"
    assert wire.read_scan(line) == [Sample(101, 0.2, 21.2468981), Sample(102, 0.4, -55.0), Sample(103, 0.6, None)]


@pytest.mark.parametrize(
    "line",
    [
        b"+2.12468981E+01 F,00000000.200,101",
        b"+2.12468981E+01,00000000.200,101",
        b"+2.1246898E+01 C,00000000.200,101",
        b"+2.12468981E+01 C,00000000.200",
        b"+2.12468981E+01 C,0.200,101",
        b"+2.12468981E+01 C,00000000.200,401",
        b"+2.12468981E+01 C,00000000.200,101,",
        b"",
    ],
)
def test_another_scan_is_refused(line: bytes) -> None:
    with pytest.raises(ValueError, match=r"fields|reading in C"):
        wire.read_scan(line)


@pytest.mark.parametrize(("line", "found"), [(b"K", "K"), (b"+85", "85"), (b"85", "85"), (b"+9.10000000E+01", "91")])
def test_a_type_is_read_however_it_is_written(line: bytes, found: str) -> None:
    assert wire.read_type(line) == found


def test_a_scan_is_begun_and_fetched_and_can_be_fetched_again() -> None:
    assert (wire.SCAN_ONCE, wire.SCANNED) == (b":INIT;:FETC?", b":FETC?")


def test_who_it_is_and_what_is_in_its_slots() -> None:
    first = wire.read_identity(b"HEWLETT-PACKARD,34970A,0,13-2-2")
    assert (first.model, first.serial, first.firmware, first.verified) == ("34970A", "", "13-2-2", False)
    later = wire.read_identity(b"Agilent Technologies,34972A,MY49018071,1.16-1.12-02-02")
    assert (later.model, later.serial, later.verified) == ("34972A", "MY49018071", True)
    assert wire.read_card(b"HEWLETT-PACKARD,34901A,0,2.3") == "34901A"
    with pytest.raises(ValueError, match="not maker"):
        wire.read_card(b"34901A")


# The simulator's side


def test_a_session_with_a_scanner(scanner: SimulatedScanner) -> None:
    assert talk(scanner, *(line.encode() for line in wire.set_up(SENSORS))) == [b""] * 8
    assert talk(scanner, b"SYST:ERR?", wire.state_query(SENSORS)) == [
        b'+0,"No error"\n', b"#214(@101,102,103);FRTD,TC,RTD;C,C,C;+0\n",
    ]  # fmt: skip
    assert talk(scanner, b"SENS:TEMP:TRAN:FRTD:TYPE? (@101)", b"TEMP:TRAN:TC:TYPE? (@102)") == [b"+85\n", b"K\n"]
    assert scanner.begin_scan() == pytest.approx(0.6)
    assert talk(scanner, b"STAT:OPER:COND?") == [b"+16\n"]
    samples = wire.read_scan(scanner.end_scan().encode())
    assert [(sample.channel, sample.since_s) for sample in samples] == [(101, 0.2), (102, 0.4), (103, 0.6)]
    assert talk(scanner, b"STAT:OPER:COND?", b"SYST:CTYP? 100", b"SYST:CTYP? 200") == [
        b"+0\n", b"HEWLETT-PACKARD,34901A,0,2.3\n", b"HEWLETT-PACKARD,0,0,0\n",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("line", "entry"),
    [
        (b"CONF:TEMP TC,K,(@201)", b'-222,"Data out of range"'),
        (b"ROUT:SCAN (@121)", b'-222,"Data out of range"'),
        (b"CONF:TEMP FRTD,85,(@111)", b'-221,"Settings conflict"'),
        (b"CONF:TEMP TC,X,(@101)", b'-224,"Illegal parameter value"'),
        (b"UNIT:TEMP R,(@101)", b'-224,"Illegal parameter value"'),
        (b"ROUT:SCAN 101", b'-224,"Illegal parameter value"'),
        (b"READ?", b'-221,"Settings conflict"'),
        (b":INIT", b'-221,"Settings conflict"'),
        (b":FETC?", b'-230,"Data corrupt or stale"'),
    ],
)
def test_what_a_scanner_refuses_is_in_its_error_queue(scanner: SimulatedScanner, line: bytes, entry: bytes) -> None:
    assert talk(scanner, line, b"SYST:ERR?", b"SYST:ERR?") == [b"", entry + b"\n", b'+0,"No error"\n']


def test_configuring_a_channel_replaces_the_scan_list_and_a_restart_empties_it(scanner: SimulatedScanner) -> None:
    assert talk(scanner, b"ROUT:SCAN (@103,101)", b"ROUT:SCAN?") == [b"", b"#210(@101,103)\n"]
    assert talk(scanner, b"CONF:TEMP TC,K,(@102)", b"ROUT:SCAN?") == [b"", b"#16(@102)\n"]
    scanner.begin_scan()
    scanner.restart()
    assert scanner.end_scan() == ""
    assert talk(scanner, b"ROUT:SCAN?") == [b"#13(@)\n"]


def asking(scanner: SimulatedScanner, clock: list[float]) -> Callable[[bytes], bytes]:
    """Says a line on one connection: its answers, for which the clock goes on as long as they are waited for."""
    session, waiting = scanner.session(), list[tuple[float, Callable[[], bytes]]]()
    session.answer_by(lambda delay_s, answer: waiting.append((delay_s, answer)))

    def ask(line: bytes) -> bytes:
        message = session.feed(line + b"\n")
        while waiting:
            delay_s, answer = waiting.pop()
            clock[0] += delay_s
            message += answer()
        return message

    return ask


def test_a_scan_that_was_initiated_stays_in_memory_and_one_that_was_read_does_not(
    scanner: SimulatedScanner, clock: list[float]
) -> None:
    ask = asking(scanner, clock)
    assert ask(b"CONF:TEMP TC,K,(@101)") == b""
    readings = ask(b":INIT;:FETC?")
    assert readings.startswith(b"+2.0")
    assert [ask(b":FETC?"), ask(b"FETC?")] == [readings, readings]
    assert ask(b"READ?").startswith(b"+2.0")
    assert ask(b"FETC?") == b""


def test_fahrenheit_and_bare_readings(scanner: SimulatedScanner) -> None:
    talk(scanner, b"CONF:TEMP TC,K,(@101)", b"UNIT:TEMP F,(@101)", b"FORM:READ:UNIT ON")
    scanner.open.add(101)
    scanner.begin_scan()
    assert scanner.end_scan() == "+9.90000000E+37 F"
    scanner.open.clear()
    scanner.begin_scan()
    value, unit = scanner.end_scan().split(" ")
    assert (float(value) - 32) / 1.8 == pytest.approx(20, abs=1)
    assert unit == "F"


def test_a_scan_that_is_under_way_holds_back_the_end_of_all_operations(
    scanner: SimulatedScanner, clock: list[float]
) -> None:
    # As the package dvg-devices has it: init, *opc?, fetc?, in small letters.
    ask = asking(scanner, clock)
    assert ask(b"conf:temp TC,J,(@101:103)") + ask(b"rout:scan:size?") == b"+3\n"
    assert ask(b"init") == b""
    assert ask(b"stat:oper:cond?") == b"+16\n"
    assert (ask(b"*opc?"), clock[0]) == (b"1\n", pytest.approx(0.6))
    assert ask(b"fetc?").count(b",") == 2
    assert ask(b"syst:err?") == b'+0,"No error"\n'
    assert ask(b"init;*opc?;:data:poin?") == b"1;+3\n"
    other = scanner.session()
    assert other.feed(b"READ?\nDATA:POIN?\n") == b""
    assert ask(b"READ?") + ask(b"SYST:ERR?") == b'-221,"Settings conflict"\n'


def test_sweeps_by_the_timer_fill_the_memory_until_they_are_ended(
    scanner: SimulatedScanner, clock: list[float]
) -> None:
    # As the package daqmon has it; the answers to questions are typed from the user's guide, chapter 5.
    ask = asking(scanner, clock)
    for line in (b"ROUT:SCAN (@101,103)", b"TRIG:COUNT INF", b"TRIG:SOURCE TIMER", b"TRIG:TIMER 10.000"):
        assert ask(line) == b""
    assert ask(b"TRIG:SOURCE?;TIMER?;COUNT?") == b"TIM;+1.00000000E+01;+9.90000000E+37\n"
    ask(b"FORM:READ:CHAN ON;:INIT")
    clock[0] = 0.3
    assert ask(b"DATA:POIN?") == b"+1\n"
    clock[0] = 10.5
    assert ask(b"DATA:POIN?") == b"+4\n"
    channels = ask(b"DATA:REM? 3").split(b",")[1::2]
    assert channels == [b"101", b"103", b"101\n"]
    assert ask(b"DATA:REM? 3") + ask(b"SYST:ERR?") == b'-230,"Data corrupt or stale"\n'
    assert ask(b"FETC?").endswith(b",103\n")
    clock[0] = 20.3
    assert ask(b"R?").startswith(b"#239+2.")
    assert ask(b"DATA:POIN?") == b"+0\n"
    ask(b"ABOR")
    clock[0] = 100.0
    assert ask(b"DATA:POIN?;:STAT:OPER:COND?") == b"+0;+0\n"


def test_a_measurement_configures_scans_and_reads(scanner: SimulatedScanner, clock: list[float]) -> None:
    ask = asking(scanner, clock)
    assert float(ask(b"MEAS:TEMP? RTD,85,1,MAX,(@102)")) == pytest.approx(20, abs=1)
    assert clock[0] == pytest.approx(0.2)
    assert ask(b"ROUT:SCAN?;:TEMP:TRAN:TYPE? (@102);:SENS:FUNC? (@102)") == b'#16(@102);RTD;"TEMP"\n'
    assert ask(b"UNIT:TEMP K") == b""
    assert float(ask(b"READ?")) == pytest.approx(293, abs=1)
    assert ask(b"MEAS:TEMP? TC,K,(@301)") + ask(b"SYST:ERR?") == b'-222,"Data out of range"\n'


def test_settings_of_channels_are_kept_and_told(scanner: SimulatedScanner) -> None:
    for line in (
        b"TEMP:NPLC 10,(@101,102)", b"SENS:TEMP:TRAN:TC:RJUN:TYPE FIX,(@101)", b"TEMP:TRAN:TC:CHEC ON,(@101)",
        b"ROUT:CHAN:DEL 2,(@103)",
    ):  # fmt: skip
        assert talk(scanner, line) == [b""]
    asked = (
        b"TEMP:NPLC? (@101:103);:TEMP:TRAN:TC:RJUN:TYPE? (@101,102);:TEMP:TRAN:TC:CHEC? (@101);:ROUT:CHAN:DEL? (@103)"
    )
    assert talk(scanner, asked) == [
        b"+1.00000000E+01,+1.00000000E+01,+1.00000000E+00;FIX,INT;1;+2.00000000E+00\n"
    ]  # fmt: skip
    assert talk(scanner, b"TEMP:NPLC 500,(@101)", b"SYST:ERR?") == [b"", b'-222,"Data out of range"\n']
    assert talk(scanner, b"*RST", b"TEMP:NPLC? (@101)") == [b"", b"+1.00000000E+00\n"]


def test_a_channel_is_monitored(scanner: SimulatedScanner) -> None:
    """User's guide, chapter 5, "Single-Channel Monitoring Overview"."""
    assert talk(scanner, b"ROUT:MON?", b"ROUT:MON:DATA?", b"SYST:ERR?") == [
        b"#13(@)\n", b"", b'-221,"Settings conflict"\n',
    ]  # fmt: skip
    talk(scanner, b"CONF:TEMP FRTD,85,(@103)", b"ROUT:MON (@103)", b"ROUT:MON:STATE ON", b"FORM:READ:UNIT ON")
    mon, state, data = talk(scanner, b"ROUT:MON?", b"ROUT:MON:STAT?", b"ROUT:MON:DATA?")
    assert (mon, state) == (b"#16(@103)\n", b"1\n")
    assert re.fullmatch(rb"\+\d\.\d{8}E\+0\d\n", data)


def test_a_channel_measures_volts_until_it_is_a_thermometer_again(scanner: SimulatedScanner) -> None:
    assert talk(scanner, b"CONF:VOLT:DC 10,0.001,(@101)", b"FUNC? (@101)", b"CONF? (@101)", b"ROUT:SCAN?") == [
        b"", b'"VOLT"\n', b'"VOLT +1.00000000E+01,+3.00000000E-05"\n', b"#16(@101)\n",
    ]  # fmt: skip
    assert talk(scanner, b"CONF:VOLT:DC (@101)", b"CONF:TEMP TC,K,(@101)", b"CONF? (@101)", b"FUNC? (@101)") == [
        b"", b"", b'"TEMP TC,K,+1.00000000E+00,+3.00000000E-06"\n', b'"TEMP"\n',
    ]  # fmt: skip
    assert talk(scanner, b"CONF:VOLT:DC MUCH,(@101)", b"UNIT:TEMP VDC", b"SYST:ERR?", b"SYST:ERR?", b"SYST:ERR?") == [
        b"", b"", *2 * [b'-224,"Illegal parameter value"\n'], b'+0,"No error"\n',
    ]  # fmt: skip


def test_a_measurement_of_volts_scans_and_reads(scanner: SimulatedScanner, clock: list[float]) -> None:
    assert asking(scanner, clock)(b"MEAS:VOLT:DC? AUTO,DEF,(@102)") == b"+0.00000000E+00\n"
