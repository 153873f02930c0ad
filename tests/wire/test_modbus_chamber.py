"""Words of a described controller typed by hand, and the frames that its simulator answers."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.dialects.modbus_chamber.wire import ValueFormat, ValueType
from drivers.kinds.chamber.words import WordOrder
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.chambers.modbus_chamber import SimulatedProfile
from simulators.world import World
from tests.support.chambers_modbus import FICTIONAL, PLAIN
from tests.support.clock import Clock, quiet_chamber


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def world(clock: Clock) -> World:
    return quiet_chamber(clock, 25.3)


@pytest.fixture
def simulated(world: World) -> SimulatedProfile:
    return SimulatedProfile(world, FaultPlan(), FICTIONAL)


def ask(simulated: SimulatedProfile, body: str) -> str:
    """Function and data of the answer to function and data, over TCP."""
    data = bytes.fromhex(f"01 {body}")
    request = b"\x00\x07\x00\x00" + len(data).to_bytes(2, "big") + data
    return simulated.session().feed(request)[7:].hex(" ")


@pytest.mark.parametrize(
    ("kind", "scale", "order", "value", "words"),
    [
        ("int16", 0.1, "high_first", 25.3, (0x00FD,)),
        ("int16", 0.1, "high_first", -40.0, (0xFE70,)),
        ("int16", 1.0, "low_first", -1.0, (0xFFFF,)),
        ("uint16", 0.01, "high_first", 400.0, (0x9C40,)),
        ("int32", 0.001, "high_first", -40.0, (0xFFFF, 0x63C0)),
        ("int32", 0.001, "low_first", -40.0, (0x63C0, 0xFFFF)),
        ("uint32", 1.0, "high_first", 4294967295.0, (0xFFFF, 0xFFFF)),
        ("float32", 1.0, "low_first", -40.0, (0x0000, 0xC220)),
        ("float32", 1.0, "high_first", 25.5, (0x41CC, 0x0000)),
        ("float32", 0.1, "high_first", 2.55, (0x41CC, 0x0000)),
    ],
)
def test_values_have_their_words(
    kind: ValueType, scale: float, order: WordOrder, value: float, words: tuple[int, ...]
) -> None:
    form = ValueFormat(kind, scale, order)
    assert form.words(value) == words
    assert form.value(words) == pytest.approx(value, rel=1e-7)
    assert form.count == len(words)


@given(
    st.sampled_from(["int16", "uint16", "int32", "uint32"]), st.sampled_from(["low_first", "high_first"]),
    st.sampled_from([1.0, 0.1, 0.01, 0.001, 0.5]), st.integers(0, 0xFFFF), st.integers(0, 0xFFFF),
)  # fmt: skip
def test_every_word_is_a_number_that_becomes_that_word(
    kind: ValueType, order: WordOrder, scale: float, first: int, second: int
) -> None:
    form = ValueFormat(kind, scale, order)
    words = (first, second)[: form.count]
    assert form.words(form.value(words)) == words


@pytest.mark.parametrize(
    ("kind", "value"), [("int16", 3276.8), ("uint16", -0.1), ("int32", 3e8), ("uint32", -1.0), ("float32", 1e39)]
)
def test_what_does_not_fit_is_an_error_and_not_another_number(kind: ValueType, value: float) -> None:
    with pytest.raises(OverflowError):
        ValueFormat(kind, 0.1).words(value)


def test_a_float_that_is_not_finite_is_no_number() -> None:
    with pytest.raises(ValueError, match="not a finite number"):
        ValueFormat("float32", word_order="low_first").value((0x0000, 0x7FC0))


@pytest.mark.parametrize(
    ("body", "answer"),
    [
        ("04 00 00 00 01", "04 02 00 fd"),  # the process value, an input register: 25.3
        ("03 00 00 00 01", "03 02 12 67"),  # the holding register of the same number: the model code
        ("03 00 66 00 02", "03 04 66 66 41 ca"),  # active set point, 25.3, low word first
        ("03 00 6e 00 02", "03 04 fd 44 07 08"),  # set points from -70.0 to 180.0
        ("03 00 78 00 01", "03 02 00 01"),  # the set point decides
        ("06 00 78 00 02", "06 00 78 00 02"),
        ("10 00 64 00 02 04 00 00 c2 20", "10 00 64 00 02"),
        ("03 00 65 00 04", "83 02"),  # two values, and a register that is not there
        ("10 00 66 00 02 04 00 00 c2 20", "90 02"),  # the active set point is only read
        ("10 00 64 00 02 04 00 00 43 fa", "90 03"),  # 500 °C is beyond the limits
        ("10 00 64 00 02 04 00 00 7f c0", "90 03"),  # not a number
        ("06 00 64 00 00", "86 03"),  # half a set point
        ("06 00 78 00 09", "86 03"),  # no mode of the profile
        ("06 00 82 00 00", "86 03"),  # a ramp rate of zero
        ("06 00 00 00 00", "86 02"),
    ],
)
def test_the_simulator_answers_as_the_profile_says(simulated: SimulatedProfile, body: str, answer: str) -> None:
    assert ask(simulated, body) == answer


def test_a_function_that_the_profile_does_not_use_is_refused(world: World) -> None:
    plain = SimulatedProfile(world, FaultPlan(), PLAIN)
    assert ask(plain, "10 00 07 00 01 02 fe 70") == "10 00 07 00 01"  # by 16, as it says
    assert world.thermal.set_point_c == -40.0
    simulated = SimulatedProfile(world, FaultPlan(), PLAIN.model_copy(update={"mode": None}))
    assert ask(simulated, "06 00 07 fe 70") == "86 01"


def test_its_ramp_goes_at_the_rate_once_it_is_switched_on(
    simulated: SimulatedProfile, world: World, clock: Clock
) -> None:
    assert ask(simulated, "06 00 82 00 c8") == "06 00 82 00 c8"  # 2.00 °C in a minute
    assert ask(simulated, "06 00 83 00 01") == "06 00 83 00 01"
    ask(simulated, "10 00 64 00 02 04 66 66 41 da")  # 27.3
    clock.now_s = 30.0
    world.look()
    assert world.thermal.set_point_c == pytest.approx(26.3)


def test_while_something_else_decides_a_set_point_waits(simulated: SimulatedProfile, world: World) -> None:
    ask(simulated, "06 00 78 00 00")
    ask(simulated, "10 00 64 00 02 04 00 00 c2 20")
    assert world.thermal.set_point_c == pytest.approx(25.3)
    ask(simulated, "06 00 78 00 01")
    assert world.thermal.set_point_c == -40.0


def test_after_a_restart_the_set_point_is_another(world: World, clock: Clock) -> None:
    simulated = SimulatedProfile(world, FaultPlan({"restart": 10.0}, clock), FICTIONAL)
    clock.now_s = 11.0
    assert ask(simulated, "03 00 64 00 02") == "03 04 00 00 41 c8"
