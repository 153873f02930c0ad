"""Bytes as in the manual, never made by our own encoder."""

import pytest
from simulators.faults.instrument_faults import FaultPlan
from simulators.units.settings import WorldSettings
from simulators.world import World

from toy_chamber import wire
from toy_chamber.simulator import SimulatedToyChamber
from toy_chamber.wire import Mode, State


def test_a_set_point_is_sent_with_one_decimal():
    assert wire.set_point(25) == "SETP 25.0"
    assert wire.set_point(-12.34) == "SETP -12.3"


def test_a_mode_is_sent_by_its_word():
    assert wire.mode(Mode.ON) == "MODE ON"


def test_a_state_is_read():
    assert wire.read_state(b"23.41;25.0;ON") == State(23.41, 25.0, Mode.ON)
    assert wire.read_state(b"-40.00;-40.0;PROG") == State(-40.0, -40.0, Mode.PROGRAM)


@pytest.mark.parametrize("line", [b"", b"23.41;25.0", b"23.41;25.0;ON;1", b"23.41;NAN;ON", b"23.41;25.0;on", b"\xb0"])
def test_what_is_no_state_is_refused(line):
    with pytest.raises(ValueError, match=r"."):
        wire.read_state(line)


def test_limits_are_read():
    assert wire.read_limits(b"-40.0,120.0") == (-40.0, 120.0)


@pytest.mark.parametrize(
    ("sent", "answered"),
    [
        (b"*IDN?\n", b"MAKER,TC-100,0001,1.0\n"),
        (b"TEMP?;:SETP?;:MODE?\n", b"20.00;20.0;ON\n"),
        (b"SETP 25.0;:SYST:ERR?\n", b'0,"No error"\n'),
        (b"SETP 121;:SYST:ERR?\n", b'-222,"Data out of range"\n'),
        (b"MODE PROG;:SYST:ERR?\n", b'-224,"Illegal parameter value"\n'),
        (b"LIM?\n", b"-40.0,120.0\n"),
    ],
)
def test_the_simulator_answers_as_the_manual_says(sent, answered):
    world = World(WorldSettings(seed=1, gravity_mps2=9.8), lambda: 0.0)
    world.thermal.ramp(20.0, 0.0)
    chamber = SimulatedToyChamber(world, FaultPlan())
    chamber._air_c = 20.0
    chamber.faults.begin("frozen")
    assert chamber.session().feed(sent) == answered
