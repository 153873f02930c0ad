"""Frames and words of an F4 typed by hand from its register list, in both directions."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.dialects.watlow_f4.wire import Measured, TemperatureFormat, event_output
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.chambers.watlow_f4 import SimulatedF4
from simulators.instruments.modbus import crc16
from simulators.world import World
from tests.support.clock import Clock, quiet_chamber

READ_100 = "01 03 00 64 00 01 c5 d5"
WRITE_MINUS_40 = "01 06 01 2c fe 70 08 7b"


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def world(clock: Clock) -> World:
    return quiet_chamber(clock, 25.3)


@pytest.fixture
def f4(world: World) -> SimulatedF4:
    return SimulatedF4(world, FaultPlan(), power_event=2)


def ask(f4: SimulatedF4, request: str) -> str:
    return f4.session().feed(bytes.fromhex(request)).hex(" ")


def ask_body(f4: SimulatedF4, body: str) -> str:
    """Function and data of the answer to function and data."""
    frame = bytes.fromhex(f"01 {body}")
    answer = f4.session().feed(frame + crc16(frame).to_bytes(2, "little"))
    assert crc16(answer) == 0
    return answer[1:-2].hex(" ")


# Numbers and words


@pytest.mark.parametrize(
    ("decimals", "temperature_c", "word"),
    [(1, 25.3, 0x00FD), (1, -40.0, 0xFE70), (0, -40.0, 0xFFD8), (2, 100.0, 0x2710), (3, -1.5, 0xFA24)],
)
def test_a_temperature_is_a_signed_word_with_an_implied_point(decimals: int, temperature_c: float, word: int) -> None:
    form = TemperatureFormat(decimals)
    assert form.word(temperature_c) == word
    assert form.value_c(word) == temperature_c


@given(st.integers(0, 0xFFFF), st.integers(0, 3))
def test_every_word_is_a_temperature_that_becomes_that_word(word: int, decimals: int) -> None:
    form = TemperatureFormat(decimals)
    assert form.word(form.value_c(word)) == word


@pytest.mark.parametrize("temperature_c", [3276.8, -3276.9, 1e9])
def test_what_no_word_holds_is_an_error_and_not_another_temperature(temperature_c: float) -> None:
    with pytest.raises(OverflowError):
        TemperatureFormat(1).word(temperature_c)


def test_one_block_from_100_to_106_holds_process_value_sensor_error_and_alarms() -> None:
    form = TemperatureFormat(1)
    assert form.measured([0x00FD, 0, 0, 4000, 550, 0, 0]) == Measured(25.3, 0, "")
    assert form.measured([0xFE70, 3, 1, 0, 0, 0, 2]) == Measured(-40.0, 3, "alarm 1 high, alarm 2 low")


def test_event_outputs_are_ten_registers_apart() -> None:
    assert [event_output(number) for number in (1, 2, 8)] == [2000, 2010, 2070]


# Whole frames, through the parser of the simulator


def test_the_process_value_and_a_set_point_have_the_bytes_of_the_register_list(f4: SimulatedF4, world: World) -> None:
    assert ask(f4, READ_100) == "01 03 02 00 fd 79 c5"
    assert ask(f4, WRITE_MINUS_40) == WRITE_MINUS_40
    assert world.thermal.set_point_c == -40.0


def test_a_frame_with_a_wrong_checksum_gets_no_answer_at_all(f4: SimulatedF4, world: World) -> None:
    assert ask(f4, WRITE_MINUS_40[:-2] + "7c") == ""
    assert world.thermal.set_point_c == 25.3


@pytest.mark.parametrize(
    ("body", "answer"),
    [
        ("03 00 00 00 05", "03 0a 14 96 00 0c 0d 80 00 03 00 c9"),  # model 5270, serial 12 3456, software 3, 2.01
        ("03 02 5a 00 02", "03 04 fd 44 07 08"),  # set points from -70.0 to 180.0
        ("03 02 5e 00 01", "03 02 00 01"),  # one decimal
        ("03 03 85 00 01", "03 02 00 01"),  # °C
        ("03 00 c8 00 01", "03 02 00 00"),  # the static set point controls
        ("03 07 da 00 01", "03 02 00 01"),  # event output 2 is on
        ("03 00 68 00 01", "03 02 00 00"),  # input 2, a feature that is switched off
        ("10 01 2c 00 01 02 fe 70", "10 01 2c 00 01"),
        ("06 07 da 00 00", "06 07 da 00 00"),
        ("03 00 c9 00 01", "83 02"),  # no such register
        ("06 00 64 00 00", "86 02"),  # the process value is only read
        ("06 01 2c 07 09", "86 03"),  # 180.1 °C is beyond the set-point limits
        ("06 07 da 00 02", "86 03"),  # an event is 0 or 1
        ("04 00 64 00 01", "84 01"),  # input registers are no function of this controller
    ],
)
def test_registers_answer_as_listed(f4: SimulatedF4, body: str, answer: str) -> None:
    assert ask_body(f4, body) == answer


def test_a_profile_decides_the_set_point_until_it_is_terminated(f4: SimulatedF4, world: World, clock: Clock) -> None:
    for body in ("06 0f a0 00 02", "06 0f a1 00 01", "06 0f a2 00 05"):  # profile 2, step 1, start
        assert ask_body(f4, body) == body
    assert ask_body(f4, "03 00 c8 00 01") == "03 02 00 02"
    assert ask_body(f4, "03 0f a0 00 02") == "03 04 00 02 00 01"
    clock.now_s = 60.0
    assert ask_body(f4, "03 10 1a 00 01") == "03 02 01 07"  # 26.3 after a minute
    assert ask_body(f4, "03 01 2c 00 01") == "03 02 00 fd"
    assert ask_body(f4, "06 04 ba 00 01") == "06 04 ba 00 01"
    assert ask_body(f4, "03 00 c8 00 01") == "03 02 00 03"  # on hold
    ask_body(f4, "06 04 b9 00 01")
    assert ask_body(f4, "03 00 c8 00 01") == "03 02 00 02"
    ask_body(f4, "06 04 c1 00 01")
    assert ask_body(f4, "03 00 c8 00 01") == "03 02 00 00"
    assert ask_body(f4, "03 01 2c 00 01") == "03 02 fd 43"  # off, below the lowest set point
    ask_body(f4, "06 04 c1 00 01")
    assert ask_body(f4, "03 01 2c 00 01") == "03 02 fd 43"


def test_while_its_power_event_is_off_a_set_point_waits(f4: SimulatedF4, world: World) -> None:
    ask_body(f4, "06 07 da 00 00")
    ask_body(f4, "06 01 2c fe 70")
    assert world.thermal.set_point_c == 25.3
    ask_body(f4, "06 07 da 00 01")
    assert world.thermal.set_point_c == -40.0


def test_every_write_to_a_setting_wears_out_the_memory(f4: SimulatedF4) -> None:
    for body in ("06 01 2c 00 fa", "06 01 2c 00 fa", "06 02 5b 06 40", "06 07 da 00 01"):
        ask_body(f4, body)
    assert f4.memory_writes == 3


def test_after_a_restart_the_set_point_is_another(world: World, clock: Clock) -> None:
    f4 = SimulatedF4(world, FaultPlan({"restart": 10.0}, clock))
    ask(f4, WRITE_MINUS_40)
    clock.now_s = 11.0
    assert ask_body(f4, "03 01 2c 00 01") == "03 02 00 fa"
    ask(f4, WRITE_MINUS_40)
    assert ask_body(f4, "03 01 2c 00 01") == "03 02 fe 70"
