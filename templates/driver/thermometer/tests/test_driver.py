"""The driver on its simulator, in virtual time."""

import pytest
from bench.app.contract import CHECKS, Subject, check
from bench.config.devices import DeviceEntry
from bench.loop import AS_FAST_AS_POSSIBLE, run
from simulators.faults.instrument_faults import begin, end

ENTRY = {"driver": "toy_thermometer", "connection": "tcp://127.0.0.1:5025"}


@pytest.mark.parametrize("name", CHECKS)
def test_the_contract_of_every_driver(name):
    check(name, ENTRY)


def test_an_open_sensor_has_no_reading_until_it_is_back():
    async def main():
        subject = Subject(DeviceEntry.model_validate(ENTRY))
        async with subject.driver() as driver:
            (reading,) = (await driver.poll())["temperature"]
            assert reading.value == pytest.approx(20.0, abs=0.5)
            begin(subject.instrument, "open_sensor")
            assert await driver.poll() == {"temperature": []}
            end(subject.instrument, "open_sensor")
            assert len((await driver.poll())["temperature"]) == 1

    run(main(), AS_FAST_AS_POSSIBLE)
