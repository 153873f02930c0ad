"""The driver on its simulator, in virtual time."""

import asyncio

import pytest
from bench.app.contract import CHECKS, Subject, check
from bench.config.devices import DeviceEntry
from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.errors import InstrumentFault, Refused
from simulators.faults.instrument_faults import begin

ENTRY = {
    "driver": "toy_chamber",
    "connection": "tcp://127.0.0.1:5025",
    "limits": {"temperature": {"min": "-40 °C", "max": "100 °C"}, "ramp_rate": {"max": "3 °C/min"}},
}


@pytest.mark.parametrize("name", CHECKS)
def test_the_contract_of_every_driver(name):
    check(name, ENTRY)


def with_driver(use):
    async def main():
        subject = Subject(DeviceEntry.model_validate(ENTRY))
        async with subject.driver() as driver:
            await use(subject.instrument, driver)

    run(main(), AS_FAST_AS_POSSIBLE)


def test_a_ramp_takes_distance_over_rate():
    async def use(chamber, driver):
        began_s = asyncio.get_running_loop().time()
        await driver.ramp_to(26.0, 1.0)
        assert asyncio.get_running_loop().time() - began_s == pytest.approx(360.0, abs=20.0)
        assert chamber.set_point_c == 26.0

    with_driver(use)


@pytest.mark.parametrize("kind", ["program", "front_panel", "restart"])
def test_another_master_is_a_fault(kind):
    async def use(chamber, driver):
        await driver.ramp_to(21.0, 1.0)
        begin(chamber, kind)
        with pytest.raises(InstrumentFault, match="subject: "):
            await driver.poll()
        await driver.make_safe()

    with_driver(use)


def test_a_set_point_that_is_not_taken_is_refused():
    async def use(chamber, driver):
        begin(chamber, "stuck")
        with pytest.raises(Refused, match="did not take a new set point"):
            await driver.ramp_to(30.0, 1.0)

    with_driver(use)
