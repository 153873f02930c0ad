"""Bytes as in the manual, never made by our own encoder."""

import pytest
from simulators.faults.instrument_faults import FaultPlan
from simulators.units.settings import WorldSettings
from simulators.world import World

from toy_thermometer import wire
from toy_thermometer.simulator import SimulatedToyThermometer


def test_a_temperature_is_read():
    assert wire.read_temperature(b"23.412") == 23.412
    assert wire.read_temperature(b"-40.000") == -40.0
    assert wire.read_temperature(b"9.9E37") is None


@pytest.mark.parametrize("line", [b"", b"23.412;1", b"NAN", b"23,4", b"\xb0"])
def test_what_is_no_temperature_is_refused(line):
    with pytest.raises(ValueError, match=r"."):
        wire.read_temperature(line)


@pytest.mark.parametrize(
    ("sent", "answered"),
    [
        (b"*IDN?\n", b"MAKER,TH-100,0001,1.0\n"),
        (b"MEAS:TEMP?\n", b"20.000\n"),
        (b"MEASURE:TEMPERATURE?\n", b"20.000\n"),
        (b"FETCH?;:SYST:ERR?\n", b'-113,"Undefined header"\n'),
    ],
)
def test_the_simulator_answers_as_the_manual_says(sent, answered):
    thermometer = SimulatedToyThermometer(World(WorldSettings(seed=1, gravity_mps2=9.8), lambda: 0.0), FaultPlan())
    thermometer._read_c = 20.0
    thermometer.faults.begin("frozen")
    assert thermometer.session().feed(sent) == answered
