"""The driver of SCPI supplies against the simulated one, in virtual time."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from bench.config.load import load_file
from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.capabilities import Source
from drivers.description import IdentityPin, Nothing, Setup, known_drivers, make_driver
from drivers.errors import (
    BadAnswer,
    BeyondLimit,
    CannotConnect,
    InstrumentFault,
    LinkLost,
    NoAnswer,
    Refused,
    WrongIdentity,
)
from drivers.scpi_supply.description import DESCRIPTION, SupplyLimits
from drivers.scpi_supply.driver import ScpiSupply
from drivers.transport.address import Address
from drivers.transport.memory import Line
from drivers.values import SourceReading
from simulators.faults import FaultPlan
from simulators.scpi_supply import SimulatedSupply
from simulators.unit_file import UnitFile
from simulators.world import PlaceSettings, World, WorldSettings
from tests.support.lines import TappedWire

UNIT = load_file(Path(__file__).parents[2] / "config" / "uut" / "quartz_flexure.yaml", UnitFile)
LIMITS = {"voltage": {"max": "16 V"}, "current": {"max": "200 mA"}}


class Supply:
    """A simulated supply with a unit on it behind a tapped wire, and what drivers for it are made from."""

    def __init__(self, address: str = "tcp://127.0.0.1:5025", line: Line | None = None) -> None:
        loop = asyncio.get_running_loop()
        self.faults = FaultPlan(now_s=loop.time)
        places = {"a": PlaceSettings(unit=UNIT, channel="x", supply="supply")}
        self.world = World(WorldSettings(seed=1, gravity_mps2=9.8, places=places), loop.time)
        self.instrument = SimulatedSupply(self.world, self.faults)
        self.wire = TappedWire(self.instrument, line)
        self._address = Address.parse(address)

    def driver(self, **pin: str) -> ScpiSupply:
        setup = Setup(
            name="supply", address=self._address, wires=self.wire, options=Nothing(),
            limits=SupplyLimits.model_validate(LIMITS), safe=Nothing(),
            identity=IdentityPin.model_validate({"model": "SIM-PSU", "serial": "SIM-PSU-01"} | pin),
        )  # fmt: skip
        driver = make_driver(DESCRIPTION, setup)
        assert isinstance(driver, ScpiSupply)
        return driver

    @property
    def unit_powered(self) -> bool:
        return self.world.units["a"].powered_at_s is not None

    @property
    def load_a(self) -> float:
        return self.world.units["a"].truth.supply_a

    def commands(self) -> list[bytes]:
        """What was sent that is no question."""
        return [line.partition(b";")[0].strip() for line in self.wire.requests if b"?" not in line.partition(b";")[0]]


def with_supply(use: Callable[[Supply], Awaitable[None]], **settings: Any) -> None:
    async def main() -> None:
        await use(Supply(**settings))

    run(main(), AS_FAST_AS_POSSIBLE)


def with_driver(use: Callable[[Supply, ScpiSupply], Awaitable[None]], **settings: Any) -> None:
    async def main(supply: Supply) -> None:
        async with supply.driver() as driver:
            await use(supply, driver)

    with_supply(main, **settings)


def now_s() -> float:
    return asyncio.get_running_loop().time()


# The bench file and connecting


def test_it_is_installed_under_its_name() -> None:
    assert known_drivers()["scpi_supply"] is DESCRIPTION
    assert DESCRIPTION.channels_of(Nothing()) == {"voltage": "V", "current": "A"}


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        (LIMITS | {"voltage": {"max": "0 V"}}, "more than 0"),
        (LIMITS | {"voltage": {"max": "16 A"}}, "expected a quantity in V"),
        ({"voltage": LIMITS["voltage"]}, "missing"),
        (LIMITS | {"power": {}}, "unknown key 'power'"),
    ],
)
def test_a_wrong_bench_file_is_told_what_is_wrong(data: Any, problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        SupplyLimits.model_validate(data)


def test_it_identifies_itself() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        assert isinstance(driver, Source)
        identity = await driver.identify()
        assert (identity.model, identity.serial, identity.verified) == ("SIM-PSU", "SIM-PSU-01", True)
        assert supply.commands() == []

    with_driver(use)


def test_another_supply_is_refused_before_anything_is_set() -> None:
    async def use(supply: Supply) -> None:
        with pytest.raises(WrongIdentity, match="serial is 'SIM-PSU-01', the bench file says 'OTHER'"):
            await supply.driver(serial="OTHER").__aenter__()
        assert supply.wire.requests == [b"*IDN?\n"]

    with_supply(use)


# Setting and reading


def test_limit_and_level_are_set_before_the_output_goes_on() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        assert supply.commands() == [b"CURR 0.2", b"VOLT 15", b"OUTP ON"]
        assert supply.unit_powered
        reading = await driver.read()
        assert reading == SourceReading(15.0, pytest.approx(supply.load_a, abs=1e-5), True)
        await driver.set(0, limit=0, output=False)
        assert supply.commands()[3:] == [b"OUTP OFF"]
        assert not supply.unit_powered
        assert await driver.read() == SourceReading(0.0, 0.0, False)
        await driver.set(15, limit=0.2, output=True)
        assert supply.commands()[4:] == [b"OUTP ON"]  # the rest was so already

    with_driver(use)


def test_it_works_over_a_serial_line() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        assert (await driver.read()).output

    with_driver(use, address="serial:///dev/ttyUSB0?baud=19200", line=Line.serial(19200))


@pytest.mark.parametrize(
    ("level_v", "limit_a", "problem"),
    [
        (16.1, 0.1, "the level 16.1 V is outside 0 V to 16 V"),
        (-1, 0.1, "the level -1 V"),
        (15, 0.21, "the current limit 0.21 A is outside 0 A to 0.2 A"),
        (float("nan"), 0.1, "the level nan V"),
    ],
)
def test_beyond_the_limits_nothing_is_sent(level_v: float, limit_a: float, problem: str) -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        sent = len(supply.wire.requests)
        with pytest.raises(BeyondLimit, match=problem):
            await driver.set(level_v, limit=limit_a, output=True)
        assert len(supply.wire.requests) == sent

    with_driver(use)


def test_polling_takes_one_exchange_and_gives_both_channels() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        sent = len(supply.wire.requests)
        found = await driver.poll()
        assert len(supply.wire.requests) == sent + 1
        assert found["voltage"][0].value == 15
        assert found["current"][0] == (pytest.approx(now_s()), pytest.approx(supply.load_a, abs=1e-5))

    with_driver(use)


@pytest.mark.parametrize("word", [b"CURR 0.2", b"VOLT 15", b"OUTP ON"])
def test_a_command_whose_answer_is_lost_is_sent_once_and_decided_by_the_read_back(word: bytes) -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        supply.wire.mute(word)
        await driver.set(15, limit=0.2, output=True)
        assert supply.commands() == [b"CURR 0.2", b"VOLT 15", b"OUTP ON"]
        assert supply.unit_powered

    with_driver(use)


@pytest.mark.parametrize("word", [b"CURR 0.2", b"VOLT 15", b"OUTP ON"])
def test_a_command_that_is_lost_is_refused_and_not_repeated(word: bytes) -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        supply.wire.lose = lambda request: request.startswith(word)
        with pytest.raises(Refused, match="not carried out; sent " + word.decode()):
            await driver.set(15, limit=0.2, output=True)
        assert supply.wire.count(word) == 1
        assert not supply.unit_powered

    with_driver(use)


def test_a_stuck_output_is_refused() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        supply.faults.begin("stuck")
        with pytest.raises(Refused, match=r"sent OUTP ON; received 15 V, limit 0.2 A, output off"):
            await driver.set(15, limit=0.2, output=True)

    with_driver(use)


def test_an_error_of_the_instrument_is_quoted_and_its_queue_emptied() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        supply.instrument.trip()
        supply.wire.alter = lambda request, answer: (
            b'-221,"Settings conflict"\n' if request.startswith(b"VOLT") else answer
        )
        with pytest.raises(Refused, match='sent VOLT 15; received -221,"Settings conflict"'):
            await driver.set(15, limit=0.2, output=True)
        assert not supply.unit_powered

    with_driver(use)


# Surprises


def test_a_trip_is_a_fault_within_one_poll() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        await driver.poll()
        supply.instrument.trip()
        for _ in range(2):
            with pytest.raises(InstrumentFault, match=r"was set to 15 V, .* output on; received 15 V, .* output off"):
                await driver.poll()

    with_driver(use)


@pytest.mark.parametrize("line", [b"VOLT 12\n", b"CURR 0.15\n", b"OUTP OFF\n", b"*RST\n"])
def test_a_second_master_is_a_fault_within_one_poll(line: bytes) -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        supply.instrument.session().feed(line)
        with pytest.raises(InstrumentFault, match="who else sets it"):
            await driver.poll()

    with_driver(use)


def test_an_output_that_somebody_switched_on_is_a_fault() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.poll()
        await driver.make_safe()
        supply.instrument.session().feed(b"VOLT 5;:OUTP ON\n")
        with pytest.raises(InstrumentFault, match=r"output off; received .* output on"):
            await driver.poll()

    with_driver(use)


def test_a_power_failure_is_a_fault() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        supply.instrument.restart()
        with pytest.raises(InstrumentFault):
            await driver.poll()

    with_driver(use)


@pytest.mark.parametrize("answer", [b"9.91E37;0;1;15;0.2\n", b"NAN;0;1;15;0.2\n", b"15;0;1\n", b"15;0;1;15;0.2;7\n"])
def test_an_answer_that_is_no_reading_gives_no_value(answer: bytes) -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        supply.wire.alter = lambda request, good: answer if b"MEAS" in request else good
        with pytest.raises(BadAnswer, match="not understood"):
            await driver.poll()
        supply.wire.alter = lambda _request, good: good
        await driver.poll()

    with_driver(use)


def test_measured_values_that_stand_still_are_given_as_they_are() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        await driver.poll()
        supply.faults.begin("frozen")
        await driver.set(10, limit=0.2, output=True)
        assert (await driver.poll())["voltage"][0].value == 15

    with_driver(use)


@pytest.mark.parametrize(("kind", "error"), [("silent", NoAnswer), ("cut", LinkLost)])
def test_a_lost_supply_is_reported_in_time(kind: Any, error: type[Exception]) -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        supply.faults.begin(kind)
        start_s = now_s()
        with pytest.raises(error):
            await driver.poll()
        assert now_s() - start_s <= 2

    with_driver(use)


# The safe state


def test_making_safe_is_idempotent() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        await driver.make_safe()
        assert not supply.unit_powered
        await driver.make_safe()
        await driver.poll()

    with_driver(use)


def test_making_safe_switches_off_at_once_though_a_question_is_not_answered() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        supply.wire.mute(b"MEAS")
        poll = asyncio.create_task(driver.poll())
        await asyncio.sleep(0.5)
        start_s = now_s()
        safe = asyncio.create_task(driver.make_safe())
        await asyncio.sleep(0.01)
        assert not supply.unit_powered
        supply.wire.alter = lambda _request, answer: answer
        await safe
        assert now_s() - start_s < 5
        with pytest.raises(Refused, match="cut short"):
            await poll

    with_driver(use)


@pytest.mark.parametrize("requests", range(1, 8))
@pytest.mark.parametrize("later_s", [0.0, 0.0005, 0.001, 0.0015])
def test_making_safe_ends_a_setting_wherever_it_is(requests: int, later_s: float) -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        setting = asyncio.create_task(driver.set(15, limit=0.2, output=True))
        await supply.wire.heard(2 + requests)
        await asyncio.sleep(later_s)
        await driver.make_safe()
        await asyncio.gather(setting, return_exceptions=True)
        assert not supply.unit_powered
        safe = supply.wire.requests.index(b"OUTP OFF\n")
        assert not [request for request in supply.wire.requests[safe:] if b"OUTP ON" in request]

    with_driver(use)


def test_making_safe_connects_and_identifies_again() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        supply.wire.drop()
        await asyncio.sleep(0.1)
        await driver.make_safe()
        assert not supply.unit_powered
        assert len(supply.wire.connections) == 2

    with_driver(use)


def test_making_safe_does_not_touch_another_supply() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        supply.wire.drop()
        await asyncio.sleep(0.1)
        supply.wire.alter = lambda request, answer: answer.replace(b"SIM-PSU-01", b"SIM-PSU-02")
        with pytest.raises(WrongIdentity):
            await driver.make_safe()
        assert supply.wire.count(b"OUTP OFF") == 0

    with_driver(use)


def test_what_cannot_be_made_safe_says_so_in_time() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        supply.faults.begin("stuck")
        with pytest.raises(Refused, match="not carried out; sent OUTP OFF"):
            await driver.make_safe()
        supply.faults.begin("silent")
        start_s = now_s()
        with pytest.raises(NoAnswer):
            await driver.make_safe()
        assert now_s() - start_s <= 5
        supply.wire.drop()
        supply.wire.broken = True
        await asyncio.sleep(0.1)
        with pytest.raises(CannotConnect):
            await driver.make_safe()

    with_driver(use)
