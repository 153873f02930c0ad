"""Lines of an ESPEC P300 typed by hand, in both directions, and the simulated controller that speaks them."""

import pytest

from drivers.dialects.espec_p300 import wire
from drivers.dialects.espec_p300.wire import Monitor, Temperatures
from drivers.kinds.chamber.refusal import Refusal
from drivers.kinds.chamber.tenths import as_stored
from simulators.instruments.chambers.espec_p300 import SimulatedP300
from tests.support.chambers_ascii import at_25_c
from tests.support.clock import Clock


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def chamber(clock: Clock) -> SimulatedP300:
    return at_25_c(SimulatedP300, clock)


def talk(chamber: SimulatedP300, *lines: bytes) -> list[bytes]:
    session = chamber.session()
    return [session.feed(line + b"\r\n") for line in lines]


# The driver's side


@pytest.mark.parametrize(
    ("temperature_c", "command"),
    [(25.0, "TEMP, S25.0"), (-40.04, "TEMP, S-40.0"), (100.26, "TEMP, S100.3"), (-0.04, "TEMP, S0.0")],
)
def test_a_set_point_is_sent_with_one_decimal(temperature_c: float, command: str) -> None:
    assert wire.set_point(temperature_c) == command
    assert as_stored(temperature_c) == float(command.rpartition("S")[2])


def test_a_command_may_carry_an_address() -> None:
    assert wire.addressed("TEMP?", None) == "TEMP?"
    assert wire.addressed("TEMP?", 3) == "3,TEMP?"


def test_answers_are_read() -> None:
    assert wire.read_temperatures("23.1,25.0,100.0,-40.0") == Temperatures(23.1, 25.0, 100.0, -40.0)
    assert wire.read_monitor("23.1,50,CONSTANT,0") == Monitor(23.1, "CONSTANT", 0)
    assert wire.read_monitor("-3.0,,RUN END HOLD,2") == Monitor(-3.0, "RUN END HOLD", 2)
    assert wire.read_alarms("0") == ()
    assert wire.read_alarms("2,1,17") == (1, 17)
    assert wire.read_type("T,T,S2,160.0") == "S2"
    assert wire.read_type("T,S2,160.0") == "S2"
    assert wire.read_rom("P3T001.10 ") == "P3T001.10"
    wire.read_done("OK:TEMP, S25.0")


@pytest.mark.parametrize(
    ("read", "line"),
    [
        (wire.read_temperatures, "23.1,25.0,100.0"),
        (wire.read_temperatures, "23.1,25.0,100.0,-40.0,"),
        (wire.read_temperatures, "23.1,25,100.0,-40.0"),
        (wire.read_temperatures, "3.1,25.0,100.0,-4O.0"),
        (wire.read_temperatures, "nan,25.0,100.0,-40.0"),
        (wire.read_monitor, "23.1,50,CONSTANT"),
        (wire.read_monitor, "23.1,50,constant,0"),
        (wire.read_alarms, "2,1"),
        (wire.read_alarms, "one"),
        (wire.read_type, "S2"),
        (wire.read_rom, ""),
        (wire.read_rom, "P3\x00"),
        (wire.read_done, "TEMP, S25.0"),
    ],
)
def test_anything_else_is_no_answer(read, line: str) -> None:
    with pytest.raises(ValueError, match=r"not |neither|alarms and"):
        read(line)


def test_a_refusal_says_why() -> None:
    read = wire.unless_refused(wire.read_temperatures)
    assert read(b"23.1,25.0,100.0,-40.0") == Temperatures(23.1, 25.0, 100.0, -40.0)
    assert isinstance(read(b"NA:PROTECT ON"), Refusal)
    assert str(read(b"NA:PROTECT ON")) == "NA:PROTECT ON, its settings are protected at the front panel"
    assert str(read(b"NA:CONT NOT READY-3")) == "NA:CONT NOT READY-3"
    with pytest.raises(ValueError, match="ascii"):
        read(b"23.1,25.0,100.0,\xb240.0")


# The simulator's side


def test_a_session(chamber: SimulatedP300, clock: Clock) -> None:
    assert talk(chamber, b"TYPE?", b"ROM?", b"TEMP?", b"MON?", b"MODE?", b"ALARM?") == [
        b"T,S2,180.0\r\n", b"P300 1.04\r\n", b"25.0,25.0,180.0,-70.0\r\n", b"25.0,,CONSTANT,0\r\n", b"CONSTANT\r\n",
        b"0\r\n",
    ]  # fmt: skip
    assert talk(chamber, b"TEMP, S-40.0", b"TEMP?") == [b"OK:TEMP, S-40.0\r\n", b"25.0,-40.0,180.0,-70.0\r\n"]
    clock.now_s = 7200.0
    assert talk(chamber, b"TEMP?") == [b"-40.0,-40.0,180.0,-70.0\r\n"]


def test_with_humidity_it_says_more(clock: Clock) -> None:
    chamber = at_25_c(SimulatedP300, clock, humidity_percent=45)
    assert talk(chamber, b"TYPE?", b"MON?", b"HUMI?") == [
        b"T,T,S2,180.0\r\n", b"25.0,45,CONSTANT,0\r\n", b"45,OFF,100,0\r\n",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (b"TEMPERATURE?", b"CMD ERR"),
        (b"TEMP, X25.0", b"PARA ERR"),
        (b"TEMP, S25", b"PARA ERR"),
        (b"TEMP, S180.1", b"DATA OUT OF RANGE"),
        (b"TEMP, S90.0 H80.0 L0.0", b"DATA OUT OF RANGE"),
        (b"MODE,FAST", b"PARA ERR"),
        (b"PRGM,RUN,RAM:9,STEP1", b"DATA NOT READY"),
    ],
)
def test_what_it_does_not_do_is_refused(chamber: SimulatedP300, line: bytes, reason: bytes) -> None:
    assert talk(chamber, line) == [b"NA:" + reason + b"\r\n"]


def test_limits_are_set_alone_and_together(chamber: SimulatedP300) -> None:
    assert talk(chamber, b"TEMP, H80.0", b"TEMP, L-10.0", b"TEMP?") == [
        b"OK:TEMP, H80.0\r\n", b"OK:TEMP, L-10.0\r\n", b"25.0,25.0,80.0,-10.0\r\n",
    ]  # fmt: skip
    assert talk(chamber, b"TEMP, S30.0 H90.0 L-20.0", b"TEMP?")[1] == b"25.0,30.0,90.0,-20.0\r\n"


def test_an_address_is_asked_for(clock: Clock) -> None:
    chamber = at_25_c(SimulatedP300, clock, address=3)
    assert talk(chamber, b"3,MODE?", b"4,MODE?", b"MODE?") == [b"CONSTANT\r\n", b"", b""]


def test_off_it_keeps_a_set_point_until_it_runs(chamber: SimulatedP300, clock: Clock) -> None:
    talk(chamber, b"MODE,OFF", b"TEMP, S60.0")
    clock.now_s = 3600.0
    assert talk(chamber, b"TEMP?", b"MON?") == [b"25.0,60.0,180.0,-70.0\r\n", b"25.0,,OFF,0\r\n"]
    assert talk(chamber, b"PRGM,RUN,RAM:1,STEP1") == [b"NA:CHB NOT READY\r\n"]
    assert talk(chamber, b"POWER,ON", b"MODE?", b"MODE,CONSTANT") == [
        b"OK:POWER,ON\r\n", b"STANDBY\r\n", b"OK:MODE,CONSTANT\r\n",
    ]  # fmt: skip
    clock.now_s = 10800.0
    assert talk(chamber, b"TEMP?") == [b"60.0,60.0,180.0,-70.0\r\n"]
    chamber.restart()
    assert talk(chamber, b"MODE?") == [b"OFF\r\n"]


def test_a_program_has_a_set_point_of_its_own(chamber: SimulatedP300, clock: Clock) -> None:
    talk(chamber, b"PRGM,RUN,RAM:1,STEP1")
    clock.now_s = 600.0
    assert talk(chamber, b"TEMP?", b"MODE?")[0].split(b",")[1] == b"35.0"
    talk(chamber, b"TEMP, S20.0", b"PRGM,END,CONSTANT")
    assert talk(chamber, b"TEMP?", b"MODE?")[1] == b"CONSTANT\r\n"
    assert talk(chamber, b"TEMP?")[0].split(b",")[1] == b"20.0"


def test_alarms_stop_it_until_they_are_gone(chamber: SimulatedP300) -> None:
    chamber.alarm(7)
    assert talk(chamber, b"MON?", b"ALARM?", b"MODE,CONSTANT") == [
        b"25.0,,STANDBY,1\r\n", b"1,7\r\n", b"NA:CHB NOT READY\r\n",
    ]  # fmt: skip
    chamber.alarms.clear()
    assert talk(chamber, b"MODE,CONSTANT") == [b"OK:MODE,CONSTANT\r\n"]


def test_protected_it_answers_questions_only(chamber: SimulatedP300) -> None:
    chamber.protected = True
    assert talk(chamber, b"TEMP, S30.0", b"KEYPROTECT?") == [b"NA:PROTECT ON\r\n", b"ON\r\n"]


def test_the_keys_are_protected_by_a_command_too(chamber: SimulatedP300) -> None:
    """As the maker's own library spells it, with one word in small letters."""
    assert talk(chamber, b"KEYPROTECT,ON", b"POWER,OFF", b"KEYPROTECT,off", b"KEYPROTECT?", b"KEYPROTECT,MAYBE") == [
        b"OK:KEYPROTECT,ON\r\n", b"NA:PROTECT ON\r\n", b"OK:KEYPROTECT,off\r\n", b"OFF\r\n", b"NA:PARA ERR\r\n",
    ]  # fmt: skip


def test_it_counts_lines_that_come_too_soon(chamber: SimulatedP300, clock: Clock) -> None:
    talk(chamber, b"TEMP, S30.0")
    for clock.now_s, hurried in ((0.4, 1), (0.7, 1), (0.8, 2)):
        talk(chamber, b"TEMP?")
        assert chamber.hurried == hurried


@pytest.mark.parametrize(
    ("other", "agrees"),
    [
        (Temperatures(20.25, 25.0, 100.0, -40.0), True),
        (Temperatures(19.75, 25.0, 100.0, -40.0), True),
        (Temperatures(20.3, 25.0, 100.0, -40.0), False),
        (Temperatures(20.0, 25.1, 100.0, -40.0), False),
        (Temperatures(20.0, 25.0, 100.0, -40.1), False),
    ],
)
def test_two_answers_agree_whose_air_alone_is_a_little_different(other: Temperatures, agrees: bool) -> None:
    assert wire.agree(Temperatures(20.0, 25.0, 100.0, -40.0), other) is agrees
