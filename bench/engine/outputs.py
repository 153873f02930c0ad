"""Acquire the outputs of units from all devices simultaneously while something else runs."""

from __future__ import annotations

import asyncio
from collections import defaultdict
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Sequence
from contextlib import AbstractAsyncContextManager
from typing import Protocol

import numpy as np

from bench.config.models import BenchFile
from bench.engine.channel import Channel, Rule
from bench.engine.safety import grouped
from bench.errors import StepError
from bench.metrology.acquisition import Voltages
from bench.metrology.outputs import STABLE_PART_S, Measured
from bench.quality import Valid
from bench.rig import Rig
from bench.store.decoder import decoders_of
from drivers.can.frame_block import FrameBlock
from drivers.can.sorted_block import joined
from drivers.capabilities import Meter


class Sink(Protocol):
    """Sink of acquired data, by the role of the device that sends it."""

    def frames(self, role: str, block: FrameBlock) -> None:
        """Receive a block of frames."""

    def readings(self, role: str, readings: Sequence[Valid]) -> None:
        """Receive readings of a meter."""


async def acquire_into(
    roles: Iterable[str], rig: Rig, sinks: Sequence[Sink], end: Awaitable[None], block_s: float | None = None
) -> None:
    """Pass the data of devices to the sinks while `end` is awaited; a device that fails ends the wait.

    The last block of frames is cut at the end; a reading of a meter in progress at that time is the last one. Blocks
    arrive every `block_s`, or as often as recorded data must be on the disk.
    """
    over: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    async def run_all() -> None:
        async with asyncio.TaskGroup() as group:
            for role in roles:
                group.create_task(_take_in(role, rig, sinks, over, block_s), name=f"take in {role}")
            await end
            over.set_result(None)

    await grouped(run_all())


async def _take_in(
    role: str, rig: Rig, sinks: Sequence[Sink], over: asyncio.Future[None], block_s: float | None
) -> None:
    def keep_frames(block: FrameBlock) -> None:
        for keeper in sinks:
            keeper.frames(role, block)

    def keep_readings(readings: Sequence[Valid]) -> None:
        for keeper in sinks:
            keeper.readings(role, readings)

    if isinstance(rig.devices[role], Meter):
        await _take_readings(role, rig.meter(role), keep_readings, over)
    else:
        await _take_frames(rig.frame_source(role).acquire(block_s=block_s), keep_frames, over)


async def _take_readings(
    role: str, meter: Meter, keep_readings: Callable[[Sequence[Valid]], None], over: asyncio.Future[None]
) -> None:
    """Read a meter repeatedly and pass on each reading at once; StepError if one is invalid."""
    channel = Channel(role, "", Rule())
    while not over.done():
        readings = await meter.measure(1, nplc=None)
        valid, invalid = channel.take(readings, asyncio.get_running_loop().time())
        if invalid:
            raise StepError(f"{role} {invalid[0].why}; it is not stored. Check the instrument and its wiring.")
        keep_readings(valid)


async def _take_frames(
    acquiring: AbstractAsyncContextManager[AsyncIterator[FrameBlock]],
    keep_frames: Callable[[FrameBlock], None],
    over: asyncio.Future[None],
) -> None:
    async def keep(blocks: AsyncIterator[FrameBlock]) -> None:
        async for block in blocks:
            keep_frames(block)

    async with acquiring as blocks:
        taking = asyncio.ensure_future(keep(blocks))
        try:
            await asyncio.wait([over, taking], return_when=asyncio.FIRST_COMPLETED)
        finally:
            if not taking.done():
                taking.cancel()
                await asyncio.wait([taking])
            # Also checked if the step was cancelled just after the failure; with nothing awaited in between.
            problem = None if taking.cancelled() else taking.exception()
        if problem is not None:
            raise problem
    await keep(blocks)


class Watched:
    """A sink that keeps the newest `over_s` of data for each unit."""

    def __init__(self, bench: BenchFile, over_s: float) -> None:
        self._bench, self._over_s = bench, over_s + STABLE_PART_S
        self._frames: defaultdict[str, list[FrameBlock]] = defaultdict(list)
        self._readings: defaultdict[str, list[Valid]] = defaultdict(list)
        self._decoders = decoders_of(bench.devices)

    def frames(self, role: str, block: FrameBlock) -> None:
        """Keep a block and those before it that are within the last `over_s`."""
        if len(block):
            since_s = float(block.at_s[-1]) - self._over_s
            self._frames[role] = [each for each in self._frames[role] if each.at_s[-1] >= since_s] + [block]

    def readings(self, role: str, readings: Sequence[Valid]) -> None:
        """Keep readings of a meter."""
        self._readings[role].extend(readings)

    def measured(self, place: str, sensor: str = "") -> Measured | None:
        """Latest data of the unit in a place, for slightly more than `over_s`; None if there are none yet.

        Of an inertial unit those of one accelerometer.
        """
        entry = self._bench.places[place]
        if entry.voltmeter is not None:
            return Voltages(*np.array(self._readings[entry.voltmeter], np.float64).reshape(-1, 3)[:, :2].T)
        channel = entry.accelerometers.get(sensor) or entry.telemetry or entry.channel
        for role in self._bench.measuring(entry):
            if channel in self._bench.devices[role].outputs and (blocks := self._frames[role]):
                return self._decoders[role].outputs(joined(blocks)).get(channel)
        return None
