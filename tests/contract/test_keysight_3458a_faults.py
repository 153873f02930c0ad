"""The driver of the Keysight 3458A: faults, lost answers, and asking that is cut short."""

import asyncio

import pytest

from drivers.dialects.keysight_3458a.driver import Keysight3458A
from drivers.errors import CannotConnect, InstrumentFault, LinkLost, NoAnswer, Refused
from tests.support.voltmeter import Meter, now_s, with_driver, with_meter


def test_errors_that_others_left_are_forgotten_when_it_is_opened() -> None:
    async def use(meter: Meter) -> None:
        meter.instrument.errors |= {103, 106}
        async with meter.driver() as driver:
            assert len(await driver.measure(1, nplc=None)) == 1

    with_meter(use)


@pytest.mark.parametrize("code", [109, 204])
def test_a_fault_of_its_own_is_told_when_it_is_opened(code: int) -> None:
    async def use(meter: Meter) -> None:
        meter.instrument.errors |= {103, code}
        with pytest.raises(InstrumentFault, match=rf'a fault of its own; received {code},".*calibration or repair'):
            await meter.driver().__aenter__()
        await asyncio.sleep(0.1)
        assert meter.wire.connections[-1].transport is not None
        assert meter.wire.connections[-1].transport.is_closing()

    with_meter(use)


def test_error_registers_that_never_become_empty_are_a_fault() -> None:
    async def use(meter: Meter) -> None:
        meter.wire.alter = lambda request, answer: b'103,"SYNTAX ERROR"\r\n' if request == b"ERRSTR?\n" else answer
        with pytest.raises(InstrumentFault, match='do not become empty; received 103,"SYNTAX ERROR"'):
            await meter.driver().__aenter__()

    with_meter(use)


def test_a_fault_during_a_measurement_is_told() -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        meter.instrument.errors.add(102)
        with pytest.raises(InstrumentFault, match='errors after a measurement; received 102,"TRIGGER TOO FAST"'):
            await driver.measure(1, nplc=None)

    with_driver(use)


@pytest.mark.parametrize(
    ("line", "reported"),
    [
        (b"NPLC 1", r"1 to NPLC\?, expected 10"),
        (b"DCV 10", r"1, 10 to FUNC\?, expected 1, 1"),
        (b"MATH NULL", r"7 to MATH\?, expected 0"),
        (b"AZERO OFF", r"0 to AZERO\?, expected 1"),
        (b"TARM AUTO", r"1 to TARM\?, expected 4"),
    ],
)
@pytest.mark.parametrize("how", ["poll", "measure"])
def test_a_second_master_is_a_fault_and_not_set_right_in_silence(line: bytes, reported: str, how: str) -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        meter.instrument.session().feed(line + b"\n")
        for _ in range(2):
            with pytest.raises(
                InstrumentFault, match=rf"its settings have changed; received {reported}.*another master"
            ):
                await (driver.poll() if how == "poll" else driver.measure(1, nplc=None))
        assert meter.wire.count(b"PRESET") == 1

    with_driver(use)


def test_a_power_failure_is_noticed() -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        meter.instrument.restart()
        with pytest.raises(InstrumentFault, match="its settings have changed"):
            await driver.poll()

    with_driver(use)


def test_a_power_failure_is_noticed_even_when_everything_else_is_as_it_was() -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        meter.instrument.restart()
        meter.instrument.session().feed(b"TARM HOLD;END ALWAYS;DCV 1\n")
        with pytest.raises(InstrumentFault, match=r"0 to INBUF\?, expected 1.*power failure"):
            await driver.poll()

    with_driver(use)


def test_an_input_beyond_the_range_is_a_fault() -> None:
    async def use(meter: Meter) -> None:
        async with meter.driver(range="100 mV") as driver:
            with pytest.raises(InstrumentFault, match=r"beyond the 0.1 V range; received 1e\+38.*what is connected"):
                await driver.poll()

    with_meter(use)


def test_a_voltmeter_that_takes_no_setting_is_refused() -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        meter.faults.begin("stuck")
        with pytest.raises(Refused, match=r"not executed.*10 to NPLC\?, expected 1"):
            await driver.measure(1, nplc=1)
        with pytest.raises(InstrumentFault, match="its settings have changed"):
            await driver.poll()

    with_driver(use)


def test_a_reading_that_does_not_come_is_silence_in_bounded_time() -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        measuring = asyncio.create_task(driver.measure(3, nplc=100))
        await asyncio.sleep(1)
        meter.faults.begin("silent")
        began_s = now_s()
        with pytest.raises(NoAnswer, match=r"no answer within 5 s; sent b?.TARM SGL"):
            await measuring
        assert now_s() - began_s < 12  # it is asked twice, on a line that is quiet again

    with_driver(use)


@pytest.mark.parametrize("after_s", [0.001, 0.5, 3.9, 4.0])
def test_the_reading_of_a_measurement_that_was_cut_short_is_not_taken_for_another_answer(after_s: float) -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        await driver.measure(1, nplc=100)
        measuring = asyncio.create_task(driver.measure(5, nplc=100))
        await asyncio.sleep(after_s)
        measuring.cancel()
        await asyncio.gather(measuring, return_exceptions=True)
        assert measuring.cancelled()
        await driver.poll()
        meter.world.power("supply", False)
        assert [reading.value for reading in await driver.measure(2, nplc=None)] == [0, 0]

    with_driver(use)


def test_a_lost_wire_is_told_at_once() -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        measuring = asyncio.create_task(driver.measure(5, nplc=100))
        await asyncio.sleep(1)
        meter.wire.drop()
        with pytest.raises(LinkLost):
            await measuring
        await driver.make_safe()  # needs no wire

    with_driver(use)


def test_nobody_at_the_other_end_is_told() -> None:
    async def use(meter: Meter) -> None:
        meter.wire.broken = True
        with pytest.raises(CannotConnect):
            await meter.driver().__aenter__()

    with_meter(use)


def test_it_is_always_safe() -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        meter.faults.begin("silent")
        sent = len(meter.wire.requests)
        await driver.make_safe()
        await driver.make_safe()
        assert len(meter.wire.requests) == sent

    with_driver(use)
