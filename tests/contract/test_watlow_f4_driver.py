"""The driver of the Watlow F4 against the simulated one: the bench file, identity, its memory, its own ways to fail."""

import asyncio
from collections.abc import Sequence
from typing import Any

import pytest
from pydantic import ValidationError

from drivers.capabilities import ThermalChamber
from drivers.description import known_drivers
from drivers.dialects.watlow_f4.description import DESCRIPTION, F4Options
from drivers.dialects.watlow_f4.wire import DisplayUnit
from drivers.errors import BeyondLimit, DriverError, InstrumentFault, WrongIdentity
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.chambers.watlow_f4 import SimulatedF4
from simulators.instruments.modbus import ExceptionCode, ModbusRtuSession, ModbusServer, RegisterError
from tests.support.chambers import Rig, with_rig
from tests.support.chambers_modbus import F4_DIALECTS, writes

(F4,) = F4_DIALECTS


def with_f4(use: Any, **settings: Any) -> None:
    """Runs `use` with a controller that has these settings."""

    async def main(rig: Rig) -> None:
        rig.wire.instrument = rig.instrument = SimulatedF4(rig.world, rig.faults, power_event=2, **settings)
        await use(rig)

    with_rig(F4, main)


def test_it_is_installed_under_its_name() -> None:
    assert known_drivers()["watlow_f4"] is DESCRIPTION


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        ({"unit_id": 248}, "at most 247"),
        ({"power_event": 9}, "at most 8"),
        ({"step": "5 s"}, "at least 10 s"),
        ({"loop": 1}, "unknown key"),
    ],
)
def test_a_wrong_bench_file_is_told_what_is_wrong(data: Any, problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        F4Options.model_validate(data)


def test_its_fingerprint_is_what_the_wire_tells() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver(pin={"serial": "12-3456"}) as driver:
            identity = await driver.identify()
        assert (identity.maker, identity.model, identity.serial) == ("Watlow", "F4", "12-3456")
        assert (identity.firmware, identity.verified) == ("3 revision 2.01", False)
        reported = "serial number registers 12 3456, °C with 2 decimals, set point -70 to 180 °C"
        assert identity.fingerprint == reported

    with_f4(use, decimals=2)


@pytest.mark.parametrize(
    ("settings", "problem"),
    [
        ({"model": 5271}, r"no Watlow F4; received model code 5271, expected 5270"),
        ({"display_unit": DisplayUnit.FAHRENHEIT}, r"not °C; received 0, which is °F.*to °C at the controller"),
        ({"set_point_limits_c": (20.0, 20.0)}, r"are implausible; received 1 decimals, set point limits 00c8 00c8"),
    ],
)
def test_another_controller_and_other_settings_are_refused(settings: Any, problem: str) -> None:
    async def use(rig: Rig) -> None:
        with pytest.raises(WrongIdentity, match=problem):
            await rig.driver().__aenter__()
        assert not any(map(writes(), rig.wire.requests))

    with_f4(use, **settings)


@pytest.mark.parametrize(("register", "word", "received"), [(901, 7, "7, expected 1"), (606, 60000, "60000 decimals")])
def test_a_setting_that_the_register_list_does_not_have_is_refused(register: int, word: int, received: str) -> None:
    class Odd(SimulatedF4):
        def read(self, address: int, count: int) -> Sequence[int]:
            return [word] if address == register else super().read(address, count)

    async def use(rig: Rig) -> None:
        rig.wire.instrument = Odd(rig.world, rig.faults)
        with pytest.raises(WrongIdentity, match=received):
            await rig.driver().__aenter__()

    with_rig(F4, use)


def test_a_temperature_that_no_register_holds_is_beyond_the_controllers_limits() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            with pytest.raises(BeyondLimit, match="100 °C is beyond the limits of the controller, -30 to 32 °C"):
                await driver.ramp_to(100.0, 1.0)

    with_f4(use, decimals=3, set_point_limits_c=(-30.0, 32.0))


# The memory


def test_a_ramp_writes_each_set_point_once_and_none_that_is_there_already() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.ramp_to(21.0, 0.5)  # 2 min, 8 steps of 0.125 °C
            assert rig.instrument.memory_writes == 8
            await driver.ramp_to(21.0, 0.5)
            await driver.hold()
            assert rig.instrument.memory_writes == 8
            for _ in range(3):
                await driver.make_safe()
            assert rig.instrument.memory_writes == 9
            assert not any(map(writes(25), rig.wire.requests))  # which keeps all settings for ever

    with_f4(use)


def test_a_slow_ramp_writes_a_tenth_of_a_degree_at_a_time() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.ramp_to(21.0, 0.05)  # 20 min
            assert rig.instrument.memory_writes == 10

    with_f4(use)


# On and off


def test_a_ramp_switches_a_chamber_on_that_is_off_and_make_safe_does_not() -> None:
    async def use(rig: Rig) -> None:
        rig.instrument.write(2010, (0,))
        async with rig.driver() as driver:
            await driver.make_safe()
            assert rig.instrument.read(2010, 1) == [0]
            await driver.ramp_to(22.0, 3.0)
            assert rig.instrument.read(2010, 1) == [1]
            assert rig.set_point_c() == 22.0
            rig.instrument.write(2010, (0,))
            with pytest.raises(InstrumentFault, match="received event output 2 is off"):
                await driver.poll()

    with_f4(use)


def test_a_set_point_that_is_off_counts_as_off_and_a_ramp_begins_at_the_air() -> None:
    async def use(rig: Rig) -> None:
        rig.instrument.start_profile()
        rig.instrument.write(1217, (1,))
        async with rig.driver() as driver:
            await driver.ramp_to(21.0, 1.0)
            assert rig.instrument.memory_writes == 4
            assert rig.set_point_c() == 21.0

    with_f4(use)


@pytest.mark.parametrize("on_hold", [True, False])
def test_no_ramp_begins_while_a_profile_is_there(on_hold: bool) -> None:
    async def use(rig: Rig) -> None:
        rig.instrument.start_profile()
        if on_hold:
            rig.instrument.write(1210, (1,))
        async with rig.driver() as driver:
            reported = "a profile is on hold" if on_hold else "a profile runs"
            with pytest.raises(InstrumentFault, match=f"does not follow its set point; received {reported}"):
                await driver.ramp_to(30.0, 1.0)
            assert not any(map(writes(), rig.wire.requests))

    with_f4(use)


def test_a_profile_that_cannot_be_ended_is_told() -> None:
    async def use(rig: Rig, driver: ThermalChamber) -> None:
        await driver.ramp_to(25.0, 3.0)
        rig.instrument.start_profile()
        rig.faults.begin("stuck")
        with pytest.raises(InstrumentFault, match=r"the profile did not end; .*Terminate the profile at"):
            await driver.make_safe()

    async def main(rig: Rig) -> None:
        async with rig.driver() as driver:
            await use(rig, driver)

    with_f4(main)


def test_a_profile_is_ended_once_when_that_has_no_answer() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.instrument.start_profile()
            rig.wire.alter = lambda request, answer: b"" if writes(1217)(request) else answer
            await driver.make_safe()
            assert sum(map(writes(1217), rig.wire.requests)) == 1
            assert (await driver.state()).target_c == 25.0

    with_f4(use)


# What the controller says of itself


def test_a_sensor_that_the_controller_does_not_trust_is_told() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.instrument.sensor_error = 3
            with pytest.raises(InstrumentFault, match="input error 3, sensor over range"):
                await driver.poll()

    with_f4(use)


def test_an_alarm_ends_a_ramp_and_make_safe_says_that_it_stands() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.ramp_to(22.0, 3.0)
            rig.instrument.alarm = 1
            with pytest.raises(InstrumentFault, match="does not follow its set point; received alarm 1 high"):
                await driver.poll()
            with pytest.raises(InstrumentFault, match=r"the controller has an alarm.*clear it at the controller"):
                await driver.make_safe()
            assert (rig.instrument.read(300, 1), rig.set_point_c()) == ([250], 25.0)

    with_f4(use)


def test_a_controller_that_was_switched_off_and_on_has_another_set_point() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.ramp_to(22.0, 3.0)
            rig.faults.begin("restart")
            with pytest.raises(InstrumentFault, match=r"set point 22 °C before; received set point 25 °C now"):
                await driver.poll()

    with_f4(use)


# An F4T whose data map is the second one


class SecondMap:
    """Registers that an F4T is known to have in the map that is like an F4's, and no others: 25.3 °C and tenths."""

    def __init__(self, faults: FaultPlan) -> None:
        self.faults, self.writes = faults, 0
        known = (300, 100, 319, 104, 606, 901, 1209, 1210, 1217, 4000, 4001, 4002)
        self._words = dict.fromkeys((*known, *range(2000, 2080, 10)), 0) | {100: 253, 300: 250, 606: 1, 901: 1}
        self._server = ModbusServer(self, 1)

    def session(self) -> ModbusRtuSession:
        return ModbusRtuSession(self._server, asyncio.get_running_loop().time)

    def read(self, address: int, count: int) -> Sequence[int]:
        if not set(range(address, address + count)) <= self._words.keys():
            raise RegisterError(ExceptionCode.ILLEGAL_ADDRESS)
        return [self._words[each] for each in range(address, address + count)]

    def write(self, address: int, words: Sequence[int]) -> None:
        self.writes += 1


def test_an_f4t_in_its_second_map_is_refused_and_nothing_is_written_to_it() -> None:
    async def use(rig: Rig) -> None:
        rig.wire.instrument = second = SecondMap(rig.faults)
        with pytest.raises(DriverError, match=r"exception 2, no such register; sent read 5 registers at 0"):
            await rig.driver().__aenter__()
        assert second.writes == 0

    with_rig(F4, use)
