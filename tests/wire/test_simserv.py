"""SIMSERV messages typed by hand, in both directions, and the simulated chamber that speaks them."""

import pytest

from drivers.dialects.simserv import wire
from drivers.dialects.simserv.wire import Function, Info, Status
from drivers.kinds.chamber.refusal import Refusal
from simulators.instruments.chambers.simserv import SimulatedSimserv
from tests.support.chambers_ascii import at_25_c
from tests.support.clock import Clock


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def chamber(clock: Clock) -> SimulatedSimserv:
    return at_25_c(SimulatedSimserv, clock)


def talk(chamber: SimulatedSimserv, *messages: str) -> list[str]:
    """Messages and answers as hexadecimal bytes, or as text whose fields are split by a vertical bar."""
    session = chamber.session()
    answers = [session.feed(message.replace("|", "\xb6").encode("latin-1") + b"\r") for message in messages]
    assert all(answer.endswith(b"\r\n") for answer in answers)
    return [answer[:-2].decode("latin-1").replace("\xb6", "|") for answer in answers]


# The driver's side


@pytest.mark.parametrize(
    ("message", "sent"),
    [
        (wire.message(Function.PROCESS_VALUE, 1), "31 31 30 30 34 b6 31 b6 31"),
        (wire.message(Function.STATUS), "31 30 30 31 32 b6 31"),
        (wire.message(Function.SET_SET_POINT, 1, "-40.5"), "31 31 30 30 31 b6 31 b6 31 b6 2d 34 30 2e 35"),
        (wire.message(Function.SWITCH, 1, 1), "31 34 30 30 31 b6 31 b6 31 b6 31"),
        (wire.message(Function.INFO, Info.SERIAL), "39 39 39 39 37 b6 31 b6 33"),
    ],
)
def test_a_message_on_the_wire(message: str, sent: str) -> None:
    assert message.encode("latin-1") == bytes.fromhex(sent)


def test_numbers_are_spelled_as_they_are_kept() -> None:
    assert [wire.temperature(value) for value in (25.0, -40.04, 99.96, -0.04)] == ["25.0", "-40.0", "100.0", "0.0"]
    assert [wire.gradient(rate) for rate in (0.5, 3.0, 0.0833333)] == ["0.5", "3", "0.083"]


def test_answers_are_read() -> None:
    assert wire.unless_refused(wire.number)(b"1\xb6-12.5") == -12.5
    assert wire.unless_refused(wire.number)(b"1\xb60.5 ") == 0.5
    assert wire.unless_refused(wire.whole)(b"1\xb611") == 11
    assert wire.unless_refused(wire.status)(b"1\xb611") == Status.AVAILABLE | Status.RUNNING | Status.ERROR
    assert wire.unless_refused(wire.text)(b"1\xb6WT3-180/70") == "WT3-180/70"
    assert wire.unless_refused(wire.text)(b"1\xb6\xb0C") == "°C"
    assert wire.unless_refused(wire.nothing)(b"1") is None


@pytest.mark.parametrize(
    ("read", "line"),
    [
        (wire.number, b"1\xb6"),
        (wire.number, b"1"),
        (wire.number, b"1\xb623.5\xb60"),
        (wire.number, b"1\xb623,5"),
        (wire.number, b"1\xb6nan"),
        (wire.number, b"1\xb61e3"),
        (wire.whole, b"1\xb6-1"),
        (wire.whole, b"1\xb61.0"),
        (wire.nothing, b"2"),
        (wire.nothing, b""),
        (wire.nothing, b"\xb61"),
    ],
)
def test_anything_else_is_no_answer(read, line: bytes) -> None:
    with pytest.raises(ValueError, match=r"not a|fields, expected 1|neither"):
        wire.unless_refused(read)(line)


def test_a_refusal_says_why() -> None:
    read = wire.unless_refused(wire.number)
    assert isinstance(read(b"-5"), Refusal)
    assert str(read(b"-5")) == "-5, unknown function"
    assert str(read(b"-77")) == "-77"


# The simulator's side


def test_a_session(chamber: SimulatedSimserv, clock: Clock) -> None:
    assert chamber.session().feed(bytes.fromhex("31 31 30 30 34 b6 31 b6 31 0d")) == b"1\xb625.0\r\n"
    assert talk(chamber, "99997|1|1", "99997|1|2", "99997|1|3", "10012|1", "11023|1|1") == [
        "1|WT3-180/70", "1|26", "1|59226001", "1|3", "1|°C",
    ]  # fmt: skip
    assert talk(chamber, "11007|1|1", "11009|1|1", "11001|1|1|-40.0", "11002|1|1") == [
        "1|-75.0", "1|185.0", "1", "1|-40.0",
    ]  # fmt: skip
    clock.now_s = 7200.0
    assert talk(chamber, "11004|1|1") == ["1|-40.0"]


def test_a_message_may_come_in_pieces(chamber: SimulatedSimserv) -> None:
    session = chamber.session()
    assert [session.feed(bytes([byte])) for byte in b"10012\xb61\r"][-1] == b"1\xb63\r\n"


@pytest.mark.parametrize(
    ("message", "code"),
    [
        ("12345|1", "-5"),
        ("10012", "-6"),
        ("status|1", "-6"),
        ("10012|2", "-4"),
        ("11001|1|1", "-6"),
        ("11001|1|1|hot", "-6"),
        ("11001|1|1|185.1", "-6"),
        ("11001|1|2|20.0", "-6"),
        ("11068|1|1|-1", "-6"),
        ("14001|1|0|1", "-6"),
        ("14001|1|17|1", "-6"),
        ("14003|1|17", "-6"),
        ("14003|1|0", "-6"),
        ("14001|1|1|2", "-6"),
        ("99997|1|4", "-8"),
        ("17007|1|9", "-8"),
        ("19014|1|7|1", "-8"),
    ],
)
def test_what_it_does_not_do_is_refused(chamber: SimulatedSimserv, message: str, code: str) -> None:
    assert talk(chamber, message) == [code]


@pytest.mark.parametrize(("reads", "reported"), [("target", "1|35.0"), ("in_force", "1|30.0")])
def test_gradients_ramp_the_set_point(clock: Clock, reads: str, reported: str) -> None:
    chamber = at_25_c(SimulatedSimserv, clock, set_point_reads=reads)
    assert talk(chamber, "11068|1|1|1.0", "11072|1|1|0.5", "11066|1|1", "11070|1|1") == ["1", "1", "1|1", "1|0.5"]
    talk(chamber, "11001|1|1|35.0")
    clock.now_s = 300.0
    assert talk(chamber, "11002|1|1") == [reported]
    talk(chamber, "11001|1|1|20.0")
    clock.now_s = 900.0
    chamber.execute("10012\xb61")
    assert chamber._world.thermal.set_point_c == pytest.approx(25.0, abs=1e-6)


def test_off_a_set_point_waits_until_it_is_started(chamber: SimulatedSimserv, clock: Clock) -> None:
    assert talk(chamber, "14001|1|1|0", "14003|1|1", "10012|1", "11001|1|1|60.0") == ["1", "1|0", "1|1", "1"]
    clock.now_s = 3600.0
    assert talk(chamber, "11004|1|1", "11002|1|1", "14001|1|1|1", "14003|1|1") == ["1|25.0", "1|60.0", "1", "1|1"]
    clock.now_s = 10800.0
    assert talk(chamber, "11004|1|1") == ["1|60.0"]
    chamber.restart()
    assert talk(chamber, "10012|1") == ["1|1"]


def test_further_outputs_are_switches(chamber: SimulatedSimserv) -> None:
    assert talk(chamber, "14001|1|7|1", "14003|1|7", "14003|1|8") == ["1", "1|1", "1|0"]  # dry air, dryer


def test_a_program_has_a_set_point_of_its_own(chamber: SimulatedSimserv, clock: Clock) -> None:
    assert talk(chamber, "19210|1", "19014|1|1|1", "19210|1", "10012|1") == ["1|0", "1", "1|1", "1|3"]
    clock.now_s = 600.0
    assert talk(chamber, "11002|1|1", "19015|1", "19210|1", "10012|1") == ["1|35.0", "1", "1|0", "1|1"]
    assert talk(chamber, "19015|1") == ["1"]


def test_an_error_stops_it_until_it_is_cleared(chamber: SimulatedSimserv) -> None:
    chamber.error(2)
    assert talk(chamber, "10012|1", "17002|1", "17009|1|1", "17009|1|2", "17007|1|2") == [
        "1|9", "1|3", "1|0", "1|1", "1|Temperature limiter",
    ]  # fmt: skip
    assert talk(chamber, "14001|1|1|1", "19014|1|1|1") == ["-9", "-9"]
    assert talk(chamber, "17012|1", "10012|1", "14001|1|1|1") == ["1", "1|1", "1"]


def test_a_set_point_keeps_its_decimals_and_outputs_are_as_they_are_switched(chamber: SimulatedSimserv) -> None:
    assert talk(chamber, "11001|1|1|23.75", "11002|1|1", "11001|1|1|-5", "11002|1|1") == ["1", "1|23.75", "1", "1|-5.0"]
    assert talk(chamber, "14003|1|7", "14001|1|7|1", "14003|1|7", "14003|1|8") == ["1|0", "1", "1|1", "1|0"]


def test_what_programs_of_other_people_ask_besides(chamber: SimulatedSimserv) -> None:
    """By the numbers of functions of SengerM's VotschTechnikClimateChamber, which name the manual of 2019."""
    asked = ("11018|1", "11026|1|1", "11016|1|1", "11017|1|1", "12012|1", "14007|1", "14010|1|8", "15004|1", "19204|1")
    assert talk(chamber, *asked) == [
        "1|1", "1|Temperature", "1|-75.0", "1|185.0", "1|0", "1|16", "1|Dryer", "1|0", "1|0",
    ]  # fmt: skip
