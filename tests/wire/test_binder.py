"""Frames and words of Binder's controllers typed by hand from register lists, in both directions."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.dialects.binder.wire import Kind, Mode, mode_of, registers_of, value_c, words
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.chambers.binder import ANSWER_AFTER_S, SimulatedBinder
from simulators.instruments.modbus import crc16
from simulators.world import World
from tests.support.clock import Clock, quiet_chamber


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def world(clock: Clock) -> World:
    return quiet_chamber(clock, 23.5)


def a_binder(world: World, kind: Kind = "mb1") -> SimulatedBinder:
    return SimulatedBinder(world, FaultPlan(), kind=kind)


def ask(binder: SimulatedBinder, request: str) -> str:
    session, delays_s, answers = binder.session(), [], []
    session.answer_by(lambda delay_s, answer: (delays_s.append(delay_s), answers.append(answer())))
    assert session.feed(bytes.fromhex(request)) == b""
    assert delays_s == [ANSWER_AFTER_S] * len(answers)
    return b"".join(answers).hex(" ")


def ask_body(binder: SimulatedBinder, body: str) -> str:
    """Function and data of the answer to function and data."""
    frame = bytes.fromhex(f"01 {body}")
    answer = bytes.fromhex(ask(binder, (frame + crc16(frame).to_bytes(2, "little")).hex()))
    assert crc16(answer) == 0
    return answer[1:-2].hex(" ")


# Numbers and words


@pytest.mark.parametrize(("temperature_c", "pair"), [(23.5, (0x0000, 0x41BC)), (40.0, (0x0000, 0x4220)), (0.0, (0, 0))])
def test_temperatures_have_their_low_word_first(temperature_c: float, pair: tuple[int, int]) -> None:
    assert words(temperature_c) == pair
    assert value_c(pair) == temperature_c


@pytest.mark.parametrize(
    "pair",
    [
        (0x41BC, 0x0000),  # 23.5 with its words exchanged: 2.4e-41
        (0x4220, 0x0000),
        (0x0000, 0x7FC0),  # not a number
        (0x0000, 0x7F80),  # infinity
        (0x0000, 0x4780),  # 65536 °C
        (0x0000, 0xC3C8),  # -400 °C
    ],
)
def test_what_is_no_temperature_is_refused(pair: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match=r"no temperature|not a finite number"):
        value_c(pair)


@given(st.floats(-200, 1000, width=32).filter(lambda number: number == 0 or abs(number) > 1e-3))
def test_every_temperature_comes_back(temperature_c: float) -> None:
    assert value_c(words(temperature_c)) == temperature_c


def test_basic_and_manual_can_be_exchanged_with_their_modes_kept() -> None:
    assert registers_of("mb1", "manual", swapped=False).set_point == 0x1581
    assert registers_of("mb1", "basic", swapped=False).set_point == 0x156F
    assert registers_of("mb1", "manual", swapped=True).set_point == 0x156F
    assert registers_of("mb1", "basic", swapped=True).set_point == 0x1581
    assert (mode_of("manual"), mode_of("basic")) == (Mode.MANUAL, Mode.BASIC) == (0x0800, 0x1000)


# Whole frames, through the parser of the simulator


def test_the_frames_of_the_register_list(world: World) -> None:
    binder = a_binder(world)
    assert ask(binder, "01 03 11 a9 00 02 11 17") == "01 03 04 00 00 41 bc cb d2"
    assert ask(binder, "01 10 15 81 00 02 04 00 00 42 20 f9 eb") == "01 10 15 81 00 02 15 ec"
    assert world.thermal.set_point_c == 23.5
    assert ask(binder, "01 06 1a 22 08 00 29 18") == "01 06 1a 22 08 00 29 18"
    assert world.thermal.set_point_c == 40.0


def test_a_frame_with_a_wrong_checksum_gets_no_answer(world: World) -> None:
    assert ask(a_binder(world), "01 03 11 a9 00 02 11 18") == ""


@pytest.mark.parametrize(
    ("kind", "body", "answer"),
    [
        ("mb1", "03 10 77 00 02", "03 04 00 00 41 bc"),  # active set point
        ("mb1", "03 1a 22 00 01", "03 02 08 00"),  # manual mode
        ("mb1", "03 12 3d 00 01", "03 02 00 00"),  # no alarm
        ("mb1", "03 10 07 00 01", "03 02 00 00"),  # door closed
        ("mb2", "03 10 04 00 02", "03 04 00 00 41 bc"),  # process value
        ("mb2", "03 10 b2 00 02", "03 04 00 00 41 bc"),  # active set point
        ("mb2", "03 12 92 00 01", "03 02 00 00"),  # operation lines
        ("mb1", "03 10 04 00 02", "83 02"),  # a register of the other one
        ("mb2", "03 1a 22 00 01", "83 02"),
        ("mb1", "06 1a 22 00 07", "86 03"),  # no mode
        ("mb1", "06 15 81 42 20", "86 03"),  # half a temperature
        ("mb1", "10 15 81 00 02 04 00 00 43 c8", "90 03"),  # 400 °C is beyond the range
        ("mb1", "10 15 81 00 02 04 00 00 7f c0", "90 03"),  # not a number
        ("mb1", "10 11 a9 00 02 04 00 00 42 20", "90 02"),  # the process value is only read
        ("mb2", "06 10 b2 00 00", "86 02"),
        ("mb1", "04 11 a9 00 02", "84 01"),
    ],
)
def test_registers_answer_as_listed(world: World, kind: Kind, body: str, answer: str) -> None:
    assert ask_body(a_binder(world, kind), body) == answer


def test_the_mode_before_its_set_point_brings_back_the_old_one(world: World) -> None:
    binder = a_binder(world)
    ask_body(binder, "06 1a 22 08 00")
    ask_body(binder, "10 15 81 00 02 04 00 00 42 20")
    assert world.thermal.set_point_c == 23.5


def test_an_idle_mb2_keeps_a_set_point_until_it_is_awake(world: World) -> None:
    binder = a_binder(world, "mb2")
    ask_body(binder, "06 11 58 00 42")  # idle, and anti-condensation
    ask_body(binder, "10 11 4c 00 02 04 00 00 42 20")
    assert world.thermal.set_point_c == 23.5
    ask_body(binder, "06 11 58 00 40")
    assert world.thermal.set_point_c == 40.0


def test_a_program_moves_the_set_point_in_force_until_it_is_stopped(world: World, clock: Clock) -> None:
    binder = a_binder(world, "mb2")
    binder.start_program()
    clock.now_s = 30.0
    assert ask_body(binder, "03 10 b2 00 02") == "03 04 00 00 41 c0"  # 24.0
    ask_body(binder, "06 11 4a 00 01")
    assert world.thermal.set_point_c == 23.5


def test_after_a_restart_the_set_point_is_another(world: World, clock: Clock) -> None:
    binder = SimulatedBinder(world, FaultPlan({"restart": 10.0}, clock))
    clock.now_s = 11.0
    assert ask_body(binder, "03 15 81 00 02") == "03 04 00 00 41 c8"
