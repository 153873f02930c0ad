"""Lines of a SCPI supply typed by hand, in both directions, and the simulated supply that speaks them."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.config.load import load_file
from drivers.dialects.scpi_supply import wire
from drivers.dialects.scpi_supply.wire import Setting, State
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.sources.scpi_supply import SimulatedSupply
from simulators.units.settings import PlaceSettings, WorldSettings
from simulators.units.unit_file import UnitFile
from simulators.world import World

UNIT = load_file(Path(__file__).parents[2] / "config" / "uut" / "quartz_flexure.yaml", UnitFile)


@pytest.fixture
def world() -> World:
    places = {"a": PlaceSettings(unit=UNIT, channel="x", supply="supply")}
    return World(WorldSettings(seed=1, gravity_mps2=9.8, places=places), lambda: 0.0)


@pytest.fixture
def supply(world: World) -> SimulatedSupply:
    return SimulatedSupply(world, FaultPlan())


def talk(supply: SimulatedSupply, *lines: bytes) -> list[bytes]:
    session = supply.session()
    return [session.feed(line + b"\n") for line in lines]


# The driver's side


def test_the_question_for_the_state_is_one_message() -> None:
    assert wire.STATE_QUERY == b"MEAS:VOLT?;:MEAS:CURR?;:OUTP?;:VOLT?;:CURR?"


def test_protections_are_asked_in_the_same_message() -> None:
    query = wire.state_query(("over_voltage", "over_current"))
    assert query == wire.STATE_QUERY + b";:VOLT:PROT:TRIP?;:CURR:PROT:TRIP?"
    state = wire.read_state(b"0;0;0;15.000;0.2000;1;0", ("over_voltage", "over_current"))
    assert (state.tripped, state.setting.output) == (("over_voltage",), False)
    assert wire.read_maximum(b"32.000;+3.0000E+00") == (32.0, 3.0)


def test_a_simulated_supply_tells_what_it_can_and_what_has_tripped(supply: SimulatedSupply) -> None:
    assert talk(supply, b"VOLT? MAX;:CURR? MAX", b"VOLT? MIN", b"VOLT:PROT:TRIP?;:CURR:PROT:TRIP?") == [
        b"32.000;3.0000\n", b"0.000\n", b"0;0\n",
    ]  # fmt: skip
    supply.trip("over_current")
    assert talk(supply, b"CURR:PROT:TRIP?", b"OUTP ON;:OUTP?", b"SYST:ERR?", b"*RST", b"OUTP ON;:OUTP?") == [
        b"1\n", b"0\n", b'-221,"Settings conflict"\n', b"", b"1\n",
    ]  # fmt: skip
    assert talk(supply, b"VOLT? DEF", b"SYST:ERR?") == [b"", b'-108,"Parameter not allowed"\n']


def test_the_state_is_read() -> None:
    line = b"1.4998E+01;+0.06213;1;15.000;0.2000"
    assert wire.read_state(line) == State(14.998, 0.06213, Setting(15.0, 0.2, True))


@pytest.mark.parametrize(
    "line",
    [
        b"15.0;0.06;1;15.0",
        b"15.0;0.06;1;15.0;0.2;0",
        b"9.91E37;0.06;1;15.0;0.2",
        b"15.0;nan;1;15.0;0.2",
        b"15.0;0.06;ON;15.0;0.2",
        b"",
    ],
)
def test_anything_else_is_refused(line: bytes) -> None:
    with pytest.raises(ValueError, match=r"answers|number|overflow|neither"):
        wire.read_state(line)


@pytest.mark.parametrize(
    ("now", "command"),
    [
        (Setting(0, 3, False), "CURR 0.2"),
        (Setting(0, 0.2, False), "VOLT 15"),
        (Setting(15, 0.2, False), "OUTP ON"),
        (Setting(15.0004, 0.1996, True), ""),
        (Setting(15.0011, 0.2, True), "VOLT 15"),
        (Setting(15, 0.2012, True), "CURR 0.2"),
    ],
)
def test_the_next_command_leads_to_the_setting(now: Setting, command: str) -> None:
    assert wire.next_step(now, Setting(15, 0.2, True)) == command


def test_switching_off_is_one_command() -> None:
    assert wire.next_step(Setting(15, 0.2, True), Setting(15, 0.2, False)) == "OUTP OFF"


# The watchdog, with lines as in the examples of the N6900/N7900 guide, page 252

ARMED, WATCHED = Setting(15, 0.2, True, 30.0), "OUTP:PROT:WDOG:DEL 30;:OUTP:PROT:WDOG ON"


@pytest.mark.parametrize(
    ("now", "wanted", "command"),
    [
        (Setting(15, 0.2, False), ARMED, WATCHED),
        (Setting(15, 0.2, False, 60.0), ARMED, WATCHED),
        (Setting(15, 0.2, True), ARMED, WATCHED),
        (Setting(15, 0.2, False, 30.0), ARMED, "OUTP ON"),
        (ARMED, ARMED, ""),
        (ARMED, Setting(15, 0.2, False), "OUTP OFF"),
        (Setting(15, 0.2, False, 30.0), Setting(15, 0.2, False), "OUTP:PROT:WDOG OFF"),
    ],
)
def test_the_watchdog_is_armed_before_the_output_and_ends_after_it(now: Setting, wanted: Setting, command: str) -> None:
    assert wire.next_step(now, wanted) == command


def test_the_watchdog_is_asked_in_the_same_message() -> None:
    query = wire.state_query(["over_voltage"], watchdog=True)
    assert query.endswith(b";:VOLT:PROT:TRIP?;:OUTP:PROT:WDOG?;:OUTP:PROT:WDOG:DEL?;:STAT:QUES:COND?")
    line = b"15;0.06;1;15;0.2;0;1;+3.0E+01;+0"
    assert wire.read_state(line, ("over_voltage",), watchdog=True).setting == ARMED
    tripped = wire.read_state(b"0;0;1;15;0.2;0;1;30;2048", ("over_voltage",), watchdog=True)
    assert (tripped.tripped, tripped.setting.output) == (("watchdog",), True)
    assert wire.read_state(b"15;0.06;1;15;0.2;0;30;0", watchdog=True).setting.watchdog_s == 0.0


def test_a_simulated_supply_to_which_nothing_is_said_switches_itself_off() -> None:
    clock = [0.0]
    supply = SimulatedSupply(World(WorldSettings(seed=1, gravity_mps2=9.8), lambda: clock[0]), FaultPlan())
    assert talk(supply, b"OUTP:PROT:WDOG?;:OUTP:PROT:WDOG:DEL?") == [b"0;60\n"]
    talk(supply, b"VOLT 15;:OUTP:PROT:WDOG:DEL 30;:OUTP:PROT:WDOG ON;:OUTP ON")
    for clock[0] in (29.0, 58.0):
        assert talk(supply, b"OUTP?;:MEAS:VOLT?;:STAT:QUES:COND?") == [b"1;15.0000;0\n"]
    clock[0] = 88.5
    assert talk(supply, b"OUTP?;:MEAS:VOLT?;:STAT:QUES:COND?") == [b"1;0.0000;2048\n"]
    assert talk(supply, b"OUTP:PROT:CLE;:MEAS:VOLT?;:STAT:QUES:COND?") == [b"15.0000;0\n"]


# The simulator's side


def test_a_session_with_a_supply(supply: SimulatedSupply, world: World) -> None:
    assert talk(supply, b"*IDN?", b"VOLT 15;:CURR 0.2;:SYST:ERR?", b"OUTP?") == [
        b"INERTIAL TEST BENCH,SIM-PSU,SIM-PSU-01,1.0\n", b'0,"No error"\n', b"0\n",
    ]  # fmt: skip
    assert talk(supply, b"MEAS:VOLT?;:MEAS:CURR?") == [b"0.0000;0.00000\n"]
    assert world.units["a"].powered_at_s is None
    load = f"{world.units['a'].truth.supply_a:.5f}".encode()
    assert talk(supply, b"OUTPUT:STATE ON", b"MEASure:VOLTage:DC?;:meas:curr?;:OUTP?") == [
        b"", b"15.0000;" + load + b";1\n",
    ]  # fmt: skip
    assert world.units["a"].powered_at_s == 0.0
    assert talk(supply, b"VOLT?", b"SOUR:CURR?", b"OUTP 0", b"*OPC?") == [b"15.000\n", b"0.2000\n", b"", b"1\n"]
    assert world.units["a"].powered_at_s is None


def test_the_units_are_powered_only_above_zero_volts(supply: SimulatedSupply, world: World) -> None:
    talk(supply, b"OUTP ON")
    assert world.units["a"].powered_at_s is None
    talk(supply, b"VOLT 15")
    assert world.units["a"].powered_at_s == 0.0
    assert talk(supply, b"*RST", b"OUTP?;:VOLT?;:CURR?") == [b"", b"0;0.000;3.0000\n"]
    assert world.units["a"].powered_at_s is None


def test_a_load_above_the_limit_pulls_the_voltage_down(supply: SimulatedSupply, world: World) -> None:
    load_a = world.units["a"].truth.supply_a
    limit_a = round(load_a / 2, 4)
    talk(supply, f"VOLT 15;:CURR {limit_a};:OUTP ON".encode())
    (answer,) = talk(supply, b"MEAS:VOLT?;:MEAS:CURR?")
    voltage, current = answer.split(b";")
    assert float(voltage) == pytest.approx(15 * limit_a / load_a, abs=1e-3)
    assert float(current) == pytest.approx(limit_a)


@pytest.mark.parametrize(
    ("line", "entry"),
    [
        (b"VOLT 33", b'-222,"Data out of range"'),
        (b"CURR -1", b'-222,"Data out of range"'),
        (b"VOLT five", b'-104,"Data type error"'),
        (b"OUTP 2", b'-224,"Illegal parameter value"'),
        (b"VOLTS 5", b'-113,"Undefined header"'),
    ],
)
def test_what_a_supply_refuses_is_in_its_error_queue(supply: SimulatedSupply, line: bytes, entry: bytes) -> None:
    assert talk(supply, line, b"SYST:ERR?", b"SYST:ERR?") == [b"", entry + b"\n", b'0,"No error"\n']


def test_trips_restarts_and_faults(supply: SimulatedSupply, world: World) -> None:
    talk(supply, b"VOLT 15;:CURR 0.2;:OUTP ON;*CLS")
    supply.trip()
    assert world.units["a"].powered_at_s is None
    assert talk(supply, b"OUTP?;*ESR?") == [b"0;0\n"]
    supply.restart()
    assert talk(supply, b"VOLT?;*ESR?") == [b"0.000;128\n"]
    talk(supply, b"VOLT 15;:OUTP ON;:MEAS:VOLT?")
    supply.faults.begin("frozen")
    supply.faults.begin("stuck")
    assert talk(supply, b"VOLT 5;:OUTP OFF", b"MEAS:VOLT?;:VOLT?;:OUTP?") == [b"", b"15.0000;5.000;1\n"]


def test_a_level_and_a_limit_may_come_together_or_by_their_ends(supply: SimulatedSupply) -> None:
    assert talk(supply, b"SYST:REM;:APPL 12, 0.5", b"APPL?;*TST?") == [b"", b'"12.000,0.5000";0\n']
    assert talk(supply, b"VOLT MIN;:CURR MAX", b"APPL?", b"APPL 6", b"APPL?", b"SYST:ERR?") == [
        b"", b'"0.000,3.0000"\n', b"", b'"6.000,3.0000"\n', b'0,"No error"\n',
    ]  # fmt: skip
    assert talk(supply, b"APPL 6,4", b"APPL?", b"SYST:ERR?") == [
        b"", b'"6.000,3.0000"\n', b'-222,"Data out of range"\n',
    ]  # fmt: skip


@given(
    level=st.floats(0, 16),
    limit=st.floats(0, 3),
    was_level=st.floats(0, 32),
    was_limit=st.floats(0, 3),
    was=st.booleans(),
)
def test_every_setting_is_reached_in_three_commands_and_switched_on_last(
    level: float, limit: float, was_level: float, was_limit: float, was: bool
) -> None:
    supply = SimulatedSupply(World(WorldSettings(seed=1, gravity_mps2=9.8), lambda: 0.0), FaultPlan())
    switch = b"ON" if was else b"OFF"
    talk(supply, f"VOLT {was_level:.4f};:CURR {was_limit:.4f};:OUTP ".encode() + switch)
    sent: list[str] = []
    while step := wire.next_step(
        wire.read_state(talk(supply, wire.STATE_QUERY)[0].strip()).setting, Setting(level, limit, True)
    ):
        sent.append(step)
        talk(supply, step.encode())
        assert len(sent) <= 3
    assert "OUTP ON" not in sent[:-1]
    assert supply.output


def test_what_drivers_of_other_supplies_set_and_ask(supply: SimulatedSupply, world: World) -> None:
    """As PyMeasure's drivers of supplies by Keithley, Keysight and Siglent do."""
    talk(supply, b"INST:SEL CH1", b"INST:NSEL 1", b"VOLT:PROT 6", b"CURR:PROT:STAT ON", b"SYST:BEEP", b"DISP:TEXT 'on'")
    assert talk(supply, b"VOLT:PROT?", b"CURR:PROT:STAT?", b"INST?", b"INST:NSEL?", b"MEAS:POW?", b"SYST:ERR?") == [
        b"6.000\n", b"1\n", b"OUT1\n", b"1\n", b"0.00000\n", b'0,"No error"\n',
    ]  # fmt: skip
    assert talk(supply, b"INST:SEL CH2", b"SYST:ERR?") == [b"", b'-224,"Illegal parameter value"\n']
    supply.trip("over_voltage")
    assert talk(supply, b"VOLT:PROT:TRIP?", b"OUTP:PROT:CLE", b"VOLT:PROT:TRIP?", b"OUTP ON", b"OUTP?") == [
        b"1\n", b"", b"0\n", b"", b"1\n",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("voltage_v", "current_a", "is_steady"),
    [
        (10.0, 0.1, True),
        (10.5, 0.109, True),
        (9.5, 0.091, True),
        (10.53, 0.1, False),
        (10.0, 0.111, False),
        (-10.0, 0.1, False),
    ],
)
def test_a_steady_output_is_nearly_the_same_twice(voltage_v: float, current_a: float, is_steady: bool) -> None:
    setting = Setting(10.0, 0.2, True)
    assert wire.steady(State(10.0, 0.1, setting), State(voltage_v, current_a, setting)) is is_steady
    assert wire.steady(State(0.0, 0.0, setting), State(0.02, 0.005, setting))
    assert not wire.steady(State(0.0, 0.0, setting), State(0.021, 0.0, setting))


def test_what_is_switched_off_has_no_watchdog() -> None:
    assert Setting(10.0, 0.2, True, 5.0).switched_off() == Setting(10.0, 0.2, False, 0.0)
