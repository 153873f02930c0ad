"""The driver on its simulator, in virtual time."""

import asyncio

import pytest
from bench.app.contract import CHECKS_OF_FRAMES, Subject, check
from bench.config.devices import DeviceEntry
from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.can.frame_block import FrameBlock
from drivers.errors import InstrumentFault, NoAnswer

from toy_counter.decoder import ToyCounterDecoder

ENTRY = {
    "driver": "toy_counter", "connection": "can:socketcan/can0?bitrate=500000", "identity": {"serial": "0001"},
    "options": {"period": "100 ms", "max_rate": "256 kHz", "inputs": {"x": 0, "y": 3}},
}  # fmt: skip


@pytest.mark.parametrize("name", CHECKS_OF_FRAMES)
def test_the_contract_of_every_driver(name):
    check(name, ENTRY)


async def _acquired(driver, for_s):
    async with driver.acquire() as blocks:
        await asyncio.sleep(for_s)
    return FrameBlock.joined([block async for block in blocks])


def test_what_is_acquired_is_whole():
    async def main():
        entry = DeviceEntry.model_validate(ENTRY)
        async with Subject(entry).driver() as driver:
            block = await _acquired(driver, 10.05)
        decoder = ToyCounterDecoder(entry.options)
        for channel, counts in decoder.outputs(block).items():
            assert channel in entry.outputs
            assert (len(counts.sequence), counts.lost) == (100, 0)
        for watch in decoder.watches():
            watch.take(block)
            assert watch.is_whole

    run(main(), AS_FAST_AS_POSSIBLE)


@pytest.mark.parametrize(("kind", "problem"), [("silent", NoAnswer), ("frozen", InstrumentFault)])
def test_a_counter_that_stops_is_a_fault(kind, problem):
    async def main():
        subject = Subject(DeviceEntry.model_validate(ENTRY))
        async with subject.driver() as driver:
            with subject.fault(kind):
                await asyncio.sleep(10.0)
                with pytest.raises(problem):
                    await driver.poll()

    run(main(), AS_FAST_AS_POSSIBLE)
