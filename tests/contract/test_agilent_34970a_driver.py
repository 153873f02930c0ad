"""The driver of the Agilent 34970A against the simulated one, over a serial line and TCP in virtual time."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from pydantic import ValidationError

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.description import IdentityPin, Nothing, Setup, known_drivers, make_driver
from drivers.dialects.agilent_34970a.description import DESCRIPTION, ScannerOptions
from drivers.dialects.agilent_34970a.driver import Agilent34970A
from drivers.errors import BadAnswer, InstrumentFault, NoAnswer, Refused, WrongIdentity
from drivers.transport.address import Address
from drivers.transport.memory import Line
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.meters.agilent_34970a import SimulatedScanner
from simulators.instruments.setup import InstrumentSetup
from simulators.units.settings import WorldSettings
from simulators.world import World
from tests.support.lines import TappedWire

OPTIONS = {
    "channels": {
        "door": {"channel": 104, "sensor": "rtd", "alpha": 91},
        "air": {"channel": 101, "sensor": "tc", "type": "K"},
        "unit": {"channel": 102, "sensor": "frtd"},
    }
}
SERIAL = "serial:///dev/ttyUSB0?baud=57600&flow=xonxoff"


class Scanner:
    """A simulated scanner behind a tapped wire, and what drivers for it are made from."""

    def __init__(self, address: str = SERIAL, model: str = "34970A", serial: str = "", **options: Any) -> None:
        loop = asyncio.get_running_loop()
        self.faults = FaultPlan(now_s=loop.time)
        self.options = ScannerOptions.model_validate(OPTIONS | options)
        self.world = World(WorldSettings(seed=1, gravity_mps2=9.8), loop.time)
        self.address = Address.parse(address)
        setup = InstrumentSetup(
            "scanner", self.world, self.faults, self.options, model=model, serial=serial,
            is_serial_line=self.address.is_serial_line,
        )  # fmt: skip
        self.instrument = SimulatedScanner.of(setup)
        self.wire = TappedWire(self.instrument, Line.serial(57600) if setup.is_serial_line else None)

    def driver(self, **pin: str) -> Agilent34970A:
        setup = Setup(
            name="scanner", address=self.address, wires=self.wire, options=self.options, limits=Nothing(),
            safe=Nothing(), identity=IdentityPin.model_validate({"model": "34970A"} | pin),
        )  # fmt: skip
        driver = make_driver(DESCRIPTION, setup)
        assert isinstance(driver, Agilent34970A)
        return driver


def with_driver(use: Callable[[Scanner, Agilent34970A], Awaitable[None]], **settings: Any) -> None:
    async def main() -> None:
        scanner = Scanner(**settings)
        async with scanner.driver() as driver:
            await use(scanner, driver)

    run(main(), AS_FAST_AS_POSSIBLE)


def now_s() -> float:
    return asyncio.get_running_loop().time()


# The bench file and connecting


def test_it_is_installed_under_its_name_and_its_readings_are_in_degrees() -> None:
    assert known_drivers()["agilent_34970a"] is DESCRIPTION
    options = ScannerOptions.model_validate(OPTIONS)
    assert DESCRIPTION.channels_of(options) == {"door": "°C", "air": "°C", "unit": "°C"}
    assert options.names() == {101: "air", 102: "unit", 104: "door"}


@pytest.mark.parametrize(
    ("channels", "problem"),
    [
        ({}, "empty"),
        ({"a": {"channel": 101, "sensor": "tc"}}, "a thermocouple needs its type"),
        ({"a": {"channel": 101, "sensor": "rtd", "type": "K"}}, "a resistor has none"),
        ({"a": {"channel": 100, "sensor": "rtd"}}, "at least 101"),
        ({"a": {"channel": 101, "sensor": "rtd"}, "b": {"channel": 101, "sensor": "rtd"}}, "two sensors are on one"),
    ],
)
def test_a_wrong_bench_file_is_told_what_is_wrong(channels: Any, problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        ScannerOptions.model_validate({"channels": channels})


def test_a_34970a_does_not_tell_its_serial_number_and_its_cards_are_its_fingerprint() -> None:
    async def main() -> None:
        scanner = Scanner()
        async with scanner.driver(serial="MY41001234", firmware="13-2-2") as driver:
            identity = await driver.identify()
        assert (identity.serial, identity.verified) == ("MY41001234", False)
        assert identity.fingerprint == "cards 34901A, 0, 0"
        with pytest.raises(WrongIdentity, match="firmware is '13-2-2'"):
            await scanner.driver(firmware="14-2-2").__aenter__()

    run(main(), AS_FAST_AS_POSSIBLE)


def test_a_34972a_tells_it_and_another_is_refused() -> None:
    async def main() -> None:
        scanner = Scanner(address="tcp://192.168.1.40:5025", model="34972A", serial="MY49018071")
        async with scanner.driver(model="34972A", serial="MY49018071") as driver:
            assert (await driver.identify()).verified
            assert scanner.wire.count(b"SYST:REM") == 0
            await driver.poll()
        with pytest.raises(WrongIdentity, match="serial is 'MY49018071'"):
            await scanner.driver(model="34972A", serial="MY49018072").__aenter__()

    run(main(), AS_FAST_AS_POSSIBLE)


def test_it_sets_up_the_scan_and_reads_it_back() -> None:
    async def use(scanner: Scanner, driver: Agilent34970A) -> None:
        sent = [request.partition(b";:SYST:ERR?")[0].strip() for request in scanner.wire.requests]
        assert sent[3:] == [
            b":SYST:REM", b":ABOR", b":TRIG:SOUR IMM;:TRIG:COUN 1",
            b":FORM:READ:UNIT ON;:FORM:READ:TIME ON;:FORM:READ:TIME:TYPE REL;:FORM:READ:CHAN ON;:FORM:READ:ALAR OFF",
            b":CONF:TEMP TC,K,(@101)", b":CONF:TEMP FRTD,85,(@102)", b":CONF:TEMP RTD,91,(@104)",
            b":UNIT:TEMP C,(@101,102,104)", b":ROUT:SCAN (@101,102,104)",
            b":ROUT:SCAN?;:TEMP:TRAN:TYPE? (@101,102,104);:UNIT:TEMP? (@101,102,104);:STAT:OPER:COND?",
            b":TEMP:TRAN:TC:TYPE? (@101)", b":TEMP:TRAN:FRTD:TYPE? (@102)", b":TEMP:TRAN:RTD:TYPE? (@104)",
        ]  # fmt: skip
        assert scanner.instrument.scan == (101, 102, 104)

    with_driver(use)


def test_a_card_that_is_not_there_is_refused_with_what_the_scanner_said() -> None:
    async def main() -> None:
        scanner = Scanner()
        scanner.options = ScannerOptions.model_validate({"channels": {"air": {"channel": 201, "sensor": "rtd"}}})
        with pytest.raises(Refused, match=r'CONF:TEMP RTD,85,\(@201\); received -222,"Data out of range"'):
            await scanner.driver().__aenter__()
        await asyncio.sleep(0.1)
        transport = scanner.wire.connections[-1].transport
        assert transport is not None
        assert transport.is_closing()

    run(main(), AS_FAST_AS_POSSIBLE)


def test_a_scanner_that_carries_nothing_out_is_refused() -> None:
    async def main() -> None:
        scanner = Scanner()
        scanner.faults.begin("stuck")
        with pytest.raises(Refused, match=r"not executed; sent :ROUT:SCAN .* received \(@\) as TC,TC,TC"):
            await scanner.driver().__aenter__()

    run(main(), AS_FAST_AS_POSSIBLE)


def test_a_sensor_of_another_type_is_refused() -> None:
    async def main() -> None:
        scanner = Scanner()
        scanner.wire.alter = lambda request, answer: b"J\r\n" if b"TC:TYPE?" in request else answer
        with pytest.raises(Refused, match=r"channel 101 is not of type K; .* received J"):
            await scanner.driver().__aenter__()

    run(main(), AS_FAST_AS_POSSIBLE)


@pytest.mark.parametrize("word", [b"CONF:TEMP TC", b"UNIT:TEMP C", b"ROUT:SCAN (@"])
def test_a_message_whose_answer_is_lost_is_sent_once_and_decided_by_the_read_back(word: bytes) -> None:
    async def main() -> None:
        scanner = Scanner()
        scanner.wire.mute(word)
        async with scanner.driver() as driver:
            assert scanner.wire.count(word) == 1
            assert len((await driver.poll())["air"]) == 1

    run(main(), AS_FAST_AS_POSSIBLE)


# Readings


@pytest.mark.parametrize("address", [SERIAL, "tcp://192.168.1.40:5025", "socket://192.168.1.41:4001"])
def test_every_reading_has_the_time_of_its_own_sensor_in_the_scan(address: str) -> None:
    async def use(scanner: Scanner, driver: Agilent34970A) -> None:
        scanner.world.ramp(60.0, 0.05)
        await asyncio.sleep(1000)
        begun_s = now_s()
        readings = await driver.poll()
        assert list(readings) == ["air", "unit", "door"]
        times = [reading.at_s - begun_s for (reading,) in readings.values()]
        assert times[1] - times[0] == pytest.approx(0.2)
        assert 0.2 <= times[0] < 0.5
        assert now_s() - begun_s >= times[2]
        assert readings["air"][0].value == pytest.approx(scanner.world.thermal.air_c, abs=0.1)
        assert readings["air"][0].value > 30

    with_driver(use, address=address)


@pytest.mark.parametrize(
    ("address", "again"),
    [(SERIAL, [b":FETC?"]), ("socket://192.168.1.41:4001", [b":FETC?"]), ("tcp://192.168.1.40:5025", [])],
)
def test_a_scan_over_a_serial_line_is_fetched_twice(address: str, again: list[bytes]) -> None:
    async def use(scanner: Scanner, driver: Agilent34970A) -> None:
        scanner.wire.requests.clear()
        await driver.poll()
        assert [request.strip() for request in scanner.wire.requests[1:]] == [b":INIT;:FETC?", *again]

    with_driver(use, address=address)


def test_readings_that_came_wrong_once_are_fetched_again_and_not_scanned() -> None:
    async def use(scanner: Scanner, driver: Agilent34970A) -> None:
        scanner.wire.garble_once(b"E+01 C", b"E+02 C", where=b"INIT")
        readings = await driver.poll()
        assert readings["air"][0].value == pytest.approx(scanner.world.thermal.air_c, abs=0.1)
        assert scanner.wire.count(b"INIT") == 1

    with_driver(use)


def test_an_open_sensor_has_no_reading_and_the_others_have() -> None:
    async def use(scanner: Scanner, driver: Agilent34970A) -> None:
        scanner.instrument.open.add(102)
        assert {name: len(readings) for name, readings in (await driver.poll()).items()} == {
            "air": 1, "unit": 0, "door": 1,
        }  # fmt: skip
        scanner.instrument.open.clear()
        assert len((await driver.poll())["unit"]) == 1

    with_driver(use)


def test_frozen_readings_are_handed_on_for_the_monitor_to_see() -> None:
    async def use(scanner: Scanner, driver: Agilent34970A) -> None:
        scanner.world.ramp(60.0, 0.05)
        first = await driver.poll()
        scanner.faults.begin("frozen")
        await asyncio.sleep(60)
        again = await driver.poll()
        assert again["air"][0].value == first["air"][0].value
        assert again["air"][0].at_s > first["air"][0].at_s + 60

    with_driver(use)


def test_looks_queue() -> None:
    async def use(scanner: Scanner, driver: Agilent34970A) -> None:
        first, second = await asyncio.gather(driver.poll(), driver.poll())
        assert second["air"][0].at_s > first["door"][0].at_s

    with_driver(use)


# Faults


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        (b":ROUT:SCAN (@101,102)", r"received \(@101,102\) as"),
        (b":CONF:TEMP TC,K,(@102);:ROUT:SCAN (@101,102,104)", "as TC,TC,RTD in C,C,C"),
        (b":UNIT:TEMP F,(@104)", "in C,C,F"),
    ],
)
def test_a_second_master_is_a_fault_at_the_next_look(line: bytes, problem: str) -> None:
    async def use(scanner: Scanner, driver: Agilent34970A) -> None:
        await driver.poll()
        scanner.instrument.session().feed(line + b"\n")
        with pytest.raises(InstrumentFault, match=f"its setup has changed.*{problem}.*another master"):
            await driver.poll()

    with_driver(use)


def test_a_power_failure_and_a_scan_of_somebody_else_are_faults() -> None:
    async def use(scanner: Scanner, driver: Agilent34970A) -> None:
        scanner.instrument.begin_scan()
        with pytest.raises(InstrumentFault, match="a scan running"):
            await driver.poll()
        scanner.instrument.end_scan()
        await driver.poll()
        scanner.instrument.restart()
        with pytest.raises(InstrumentFault, match=r"received \(@\) as"):
            await driver.poll()

    with_driver(use)


@pytest.mark.parametrize(
    "answer",
    [
        "+2.12468981E+01 C,00000000.200,101",
        "+2.12468981E+01 C,00000000.200,101,+2.12468981E+01 C,00000000.400,103,+2.12468981E+01 C,00000000.600,104",
        "+2.12468981E+01 C,00000000.200,101,+2.12468981E+01 C,00000000.400,102,+2.12468981E 01 C,00000000.600,104",
    ],
)
def test_a_scan_that_came_otherwise_gives_no_reading_at_all(answer: str) -> None:
    async def use(scanner: Scanner, driver: Agilent34970A) -> None:
        end_scan = scanner.instrument.end_scan
        scanner.instrument.end_scan = lambda: (end_scan(), answer)[1]  # type: ignore[method-assign]  # one bad line
        with pytest.raises(BadAnswer, match=r"readings of other channels|is not a reading in C"):
            await driver.poll()
        scanner.instrument.end_scan = end_scan  # type: ignore[method-assign]  # and a good one again
        await driver.poll()

    with_driver(use)


def test_silence_is_told_in_time_and_a_lost_wire_is_opened_again() -> None:
    async def use(scanner: Scanner, driver: Agilent34970A) -> None:
        scanner.faults.begin("silent")
        start_s = now_s()
        with pytest.raises(NoAnswer):
            await driver.poll()
        assert now_s() - start_s <= 6
        scanner.instrument.faults = FaultPlan()
        await driver.poll()
        scanner.wire.drop()
        await asyncio.sleep(0.1)
        await driver.poll()
        await driver.make_safe()
        assert len(scanner.wire.connections) == 2

    with_driver(use)
