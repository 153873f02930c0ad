"""Frames and words of an F4T typed by hand from its register list, in both directions."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.dialects.watlow_f4t.wire import BLOCK_COUNT, BLOCK_FIRST, LoopBlock, LoopFormat, LoopRegister, mode_name
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.chambers.watlow_f4t import SimulatedF4T
from simulators.physics.thermal import ChamberPhysics
from simulators.units.settings import WorldSettings
from simulators.world import World

LOW_FIRST, HIGH_FIRST = LoopFormat(), LoopFormat(word_order="high_first")
QUIET = ChamberPhysics(start_c=25.0, limit_cycle_c=0.0)


class Clock:
    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def a_world(clock: Clock, chamber: ChamberPhysics = QUIET) -> World:
    return World(WorldSettings(seed=1, gravity_mps2=9.8, chamber=chamber), clock)


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def world(clock: Clock) -> World:
    return a_world(clock)


@pytest.fixture
def f4t(world: World) -> SimulatedF4T:
    return SimulatedF4T(world, FaultPlan())


def ask(f4t: SimulatedF4T, request: str) -> str:
    return f4t.session().feed(bytes.fromhex(request)).hex(" ")


# Numbers and words


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (25.0, (0x0000, 0x41C8)),
        (25.5, (0x0000, 0x41CC)),
        (-40.0, (0x0000, 0xC220)),
        (0.1, (0xCCCD, 0x3DCC)),
    ],
)
def test_floats_have_their_low_word_first_by_default(value: float, words: tuple[int, int]) -> None:
    assert LOW_FIRST.words(value) == words
    assert LOW_FIRST.value(words) == pytest.approx(value, rel=1e-7)
    assert HIGH_FIRST.words(value) == words[::-1]
    assert HIGH_FIRST.value(words[::-1]) == LOW_FIRST.value(words)


@given(st.integers(0, 0xFFFF), st.integers(0, 0xFFFF), st.sampled_from([LOW_FIRST, HIGH_FIRST]))
def test_every_pair_of_words_is_a_finite_number_or_an_error(first: int, second: int, form: LoopFormat) -> None:
    high = second if form is LOW_FIRST else first
    if high & 0x7F80 == 0x7F80:  # all ones in the exponent: infinity or NaN
        with pytest.raises(ValueError, match="not a finite number"):
            form.value((first, second))
    else:
        assert form.words(form.value((first, second))) == (first, second)


@pytest.mark.parametrize("words", [(0x0000, 0x7F80), (0x0000, 0xFF80), (0x0000, 0x7FC0), (0x0001, 0x7F80)])
def test_infinity_and_nan_are_no_temperatures(words: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match=r"(inf|nan) is not a finite number"):
        LOW_FIRST.value(words)


def test_a_number_beyond_float32_cannot_be_written() -> None:
    with pytest.raises(OverflowError):
        LOW_FIRST.words(1e39)


def test_one_block_from_2810_to_2821_holds_set_point_mode_and_process_value() -> None:
    words = [0x0000, 0x41C8, 0, 0, 10, 0, 0, 0, 0, 0, 0x0000, 0x41CC]
    assert (BLOCK_FIRST, BLOCK_FIRST + BLOCK_COUNT - 1) == (2810, 2821)
    assert LOW_FIRST.block(words) == LoopBlock(set_point_in_force=25.0, mode=10, process_value=25.5)
    with pytest.raises(ValueError, match="nan"):
        LOW_FIRST.block([*words[:-2], 0x0000, 0x7FC0])


def test_the_second_loop_lies_160_registers_higher() -> None:
    second = LoopFormat(loop=2)
    assert second.address(LoopRegister.SET_POINT) == 2942
    assert second.address(LoopRegister.SET_POINT_IN_FORCE) == 2970


@pytest.mark.parametrize(("mode", "name"), [(10, "auto"), (54, "manual"), (62, "off"), (99, "unknown (99)")])
def test_modes_have_the_names_of_the_display(mode: int, name: str) -> None:
    assert mode_name(mode) == name


# Whole frames, through the parser of the simulator


def test_the_chamber_temperature_is_read_with_the_bytes_of_the_manual(f4t: SimulatedF4T) -> None:
    assert ask(f4t, "00 01 00 00 00 06 01 03 6b c2 00 02") == "00 01 00 00 00 07 01 03 04 00 00 41 c8"


def test_a_set_point_is_written_with_the_bytes_of_the_manual(f4t: SimulatedF4T, world: World) -> None:
    answer = ask(f4t, "00 02 00 00 00 0b 01 10 0a de 00 02 04 00 00 c2 20")
    assert answer == "00 02 00 00 00 06 01 10 0a de 00 02"
    assert ask(f4t, "00 03 00 00 00 06 01 03 0a de 00 02") == "00 03 00 00 00 07 01 03 04 00 00 c2 20"
    assert world.thermal.set_point_c == -40.0


def test_high_word_first_is_the_other_way_round(world: World) -> None:
    f4t = SimulatedF4T(world, FaultPlan(), word_order="high_first")
    assert ask(f4t, "00 01 00 00 00 06 01 03 6b c2 00 02") == "00 01 00 00 00 07 01 03 04 41 c8 00 00"


@pytest.mark.parametrize(
    ("register", "word"),
    [
        ("1a 4a", "00 0f"),  # 6730, display unit: 15 is °C
        ("0a aa", "00 0a"),  # 2730, control mode wanted: 10 is auto
        ("0a fe", "00 0a"),  # 2814, control mode in force
        ("0a ea", "00 3e"),  # 2794, ramp action: 62 is off
        ("0a ec", "00 27"),  # 2796, ramp scale: 39 is hours
        ("40 d2", "00 3e"),  # 16594, event output 1: 62 is off
    ],
)
def test_enumerations_are_one_word(f4t: SimulatedF4T, register: str, word: str) -> None:
    assert ask(f4t, f"00 01 00 00 00 06 01 03 {register} 00 01") == f"00 01 00 00 00 05 01 03 02 {word}"


def test_half_a_float_is_read_as_it_is(f4t: SimulatedF4T) -> None:
    assert ask(f4t, "00 01 00 00 00 06 01 03 0a df 00 01") == "00 01 00 00 00 05 01 03 02 41 c8"


def test_a_block_across_unused_registers_is_read_in_one_request(f4t: SimulatedF4T) -> None:
    words = "00 00 41 c8 00 00 00 00 00 0a 00 00 00 00 00 00 00 00 00 00 00 00 41 c8"
    assert ask(f4t, "00 01 00 00 00 06 01 03 0a fa 00 0c") == f"00 01 00 00 00 1b 01 03 18 {words}"


def test_the_registers_of_another_loop_are_not_there(world: World) -> None:
    second = SimulatedF4T(world, FaultPlan(), loop=2)
    assert ask(second, "00 01 00 00 00 06 01 03 0b 7e 00 02").endswith("03 04 00 00 41 c8")  # 2942
    assert ask(second, "00 01 00 00 00 06 01 03 0a de 00 02") == "00 01 00 00 00 03 01 83 02"


def test_a_ramp_written_as_registers_moves_the_set_point_in_force(f4t: SimulatedF4T, clock: Clock) -> None:
    for request in (
        "00 01 00 00 00 06 01 06 0a ec 00 39",  # ramp scale 57: minutes
        "00 02 00 00 00 0b 01 10 0a ee 00 02 04 00 00 40 00",  # ramp rate 2.0
        "00 03 00 00 00 06 01 06 0a ea 00 55",  # ramp action 85: at a change of the set point
    ):
        assert ask(f4t, request)[: 3 * 4] == request[: 3 * 4]
    ask(f4t, "00 04 00 00 00 0b 01 10 0a de 00 02 04 00 00 41 d8")  # set point 27.0
    clock.now_s = 30.0
    assert ask(f4t, "00 05 00 00 00 06 01 03 0a fa 00 02").endswith("04 00 00 41 d0")  # 26.0 after half a minute
    clock.now_s = 60.0
    assert ask(f4t, "00 06 00 00 00 06 01 03 0a fa 00 02").endswith("04 00 00 41 d8")


def test_a_ramp_per_hour_is_sixty_times_slower(f4t: SimulatedF4T, clock: Clock, world: World) -> None:
    ask(f4t, "00 01 00 00 00 0b 01 10 0a ee 00 02 04 00 00 41 f0")  # 30.0, per hour as it is
    ask(f4t, "00 02 00 00 00 06 01 06 0a ea 00 0d")  # ramp action 13: both
    ask(f4t, "00 03 00 00 00 0b 01 10 0a de 00 02 04 00 00 42 5c")  # set point 55.0
    clock.now_s = 1800.0
    world.look()
    assert world.thermal.set_point_c == pytest.approx(40.0)


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        ("00 06 01 04 0a de 00 02", "84 01"),  # input registers are no function of this controller
        ("00 06 01 03 00 00 00 01", "83 02"),  # no such register
        ("00 06 01 03 0b 04 00 04", "83 02"),  # begins in the process value and ends behind it
        ("00 0b 01 10 0a fa 00 02 04 00 00 41 c8", "90 02"),  # the active set point is only read
        ("00 06 01 06 0a df 41 c8", "86 02"),  # the upper half of the set point
        ("00 0b 01 10 0a de 00 02 04 00 00 43 fa", "90 03"),  # 500 °C is beyond the set-point limits
        ("00 0b 01 10 0a de 00 02 04 00 00 7f c0", "90 03"),  # not a number
        ("00 06 01 06 0a de 00 00", "86 03"),  # half a set point
        ("00 06 01 06 0a ea 00 05", "86 03"),  # no ramp action
        ("00 0b 01 10 0a ee 00 02 04 00 00 00 00", "90 03"),  # a ramp rate of zero
        ("00 06 01 03 0a de 00 00", "83 03"),  # no registers at all
    ],
)
def test_what_it_refuses_it_refuses_with_the_code_and_does_not_do(
    f4t: SimulatedF4T, world: World, request_: str, code: str
) -> None:
    assert ask(f4t, f"00 07 00 00 {request_}") == f"00 07 00 00 00 03 01 {code}"
    assert world.thermal.set_point_c == 25.0


def test_a_request_over_two_values_is_done_whole_or_not_at_all(f4t: SimulatedF4T) -> None:
    both = "00 01 00 00 00 0f 01 10 0a ea 00 04 08 00 55 00 00 00 {} 00 00"
    assert ask(f4t, both.format("01")) == "00 01 00 00 00 03 01 90 03"  # 1 is no ramp scale
    assert ask(f4t, "00 02 00 00 00 06 01 03 0a ea 00 01").endswith("02 00 3e")
    assert ask(f4t, both.format("39")) == "00 01 00 00 00 06 01 10 0a ea 00 04"
    assert ask(f4t, "00 02 00 00 00 06 01 03 0a ea 00 03").endswith("06 00 55 00 00 00 39")


def test_out_of_auto_a_set_point_waits_until_auto_is_back(f4t: SimulatedF4T, world: World) -> None:
    ask(f4t, "00 01 00 00 00 06 01 06 0a aa 00 3e")  # off
    ask(f4t, "00 02 00 00 00 0b 01 10 0a de 00 02 04 00 00 c2 20")
    assert world.thermal.set_point_c == 25.0
    assert ask(f4t, "00 03 00 00 00 06 01 03 0a f8 00 02").endswith("04 00 00 00 00")  # no power
    ask(f4t, "00 04 00 00 00 06 01 06 0a aa 00 0a")
    assert world.thermal.set_point_c == -40.0


def power_percent(f4t: SimulatedF4T) -> float:
    words = bytes.fromhex(ask(f4t, "00 01 00 00 00 06 01 03 0a f8 00 02"))[9:]
    return float(struct.unpack(">f", words[2:] + words[:2])[0])


def test_power_follows_the_deviation_in_auto_and_the_operator_in_manual(f4t: SimulatedF4T) -> None:
    assert power_percent(f4t) == 0.0
    ask(f4t, "00 02 00 00 00 0b 01 10 0a de 00 02 04 00 00 c2 20")
    assert power_percent(f4t) == -100.0
    ask(f4t, "00 03 00 00 00 06 01 06 0a aa 00 36")  # manual
    ask(f4t, "00 04 00 00 00 0b 01 10 0a e0 00 02 04 00 00 41 c8")  # manual power 25.0
    assert power_percent(f4t) == 25.0


def test_a_frozen_sensor_repeats_its_last_value(clock: Clock) -> None:
    faults = FaultPlan({"frozen": 100.0}, clock)
    f4t = SimulatedF4T(a_world(clock, ChamberPhysics()), faults)
    read = "00 01 00 00 00 06 01 03 0b 04 00 02"
    first = ask(f4t, read)
    clock.now_s = 50.0
    second = ask(f4t, read)
    clock.now_s = 150.0
    assert first != second == ask(f4t, read)


def test_a_stuck_set_point_is_acknowledged_and_not_taken(world: World) -> None:
    f4t = SimulatedF4T(world, FaultPlan({"stuck": 0.0}))
    answer = ask(f4t, "00 02 00 00 00 0b 01 10 0a de 00 02 04 00 00 c2 20")
    assert answer == "00 02 00 00 00 06 01 10 0a de 00 02"
    assert ask(f4t, "00 03 00 00 00 06 01 03 0a de 00 02").endswith("04 00 00 41 c8")
    assert world.thermal.set_point_c == 25.0


def test_air_follows_the_set_point_whoever_looks(f4t: SimulatedF4T, clock: Clock) -> None:
    ask(f4t, "00 02 00 00 00 0b 01 10 0a de 00 02 04 00 00 c2 20")
    clock.now_s = 7200.0
    words = bytes.fromhex(ask(f4t, "00 01 00 00 00 06 01 03 0b 04 00 02"))[9:]
    assert math.isclose(struct.unpack(">f", words[2:] + words[:2])[0], -40.0, abs_tol=1e-3)
