"""Watches the devices the whole run long: records their readings, and finds what leaves its window."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bench.config.channels import period_s
from bench.config.models import BenchFile, ReadingEntry
from bench.engine.interlocks import Change, Interlocks
from bench.errors import BenchError, WindowError
from bench.rig import Rig
from bench.sequence.readings import unit_of
from bench.store.writer import RunWriter
from drivers.errors import DriverError
from drivers.values import Reading

KEPT_S = 4 * 3600.0
WINDOW_GRACE_S = 2.0  # after switching a supply, before its current is judged


@dataclass
class Window:
    """What a supply's current must be within while its output is on; set by the steps that switch it."""

    low: float
    high: float
    on_since_s: float | None = None


@dataclass
class _Channel:
    """A reading of a device: its latest values, and the name it has on this bench."""

    name: str
    unit: str
    values: deque[Reading] = field(default_factory=deque)

    def extend(self, readings: Sequence[Reading]) -> None:
        self.values.extend(readings)
        newest_s = self.values[-1].at_s
        while self.values[0].at_s < newest_s - KEPT_S:
            self.values.popleft()


class Monitor:
    """Polls every device at its period from `start` to `stop`.

    What it finds wrong it says once, by the future `fault`; the device concerned is not polled any more. An interlock
    that trips or is good again goes into the journal, then to `on_interlock`, which the engine sets before `start`.
    Concurrency: one task for each device, owned by this object.
    """

    def __init__(
        self,
        rig: Rig,
        bench: BenchFile,
        interlocks: Interlocks,
        writer: RunWriter,
        on_reading: Callable[[str, Reading], None],
    ) -> None:
        self._rig, self._bench, self._writer, self._on_reading = rig, bench, writer, on_reading
        self._interlocks = interlocks
        self.on_interlock: Callable[[Change], None] = lambda _change: None
        self._channels: dict[str, _Channel] = {}
        self._names = {reading.from_: name for name, reading in bench.readings.items()}
        self._tasks: list[asyncio.Task[None]] = []
        self.windows = {
            place.supply: Window(place.supply_current.min, place.supply_current.max)
            for place in bench.places.values()
            if place.supply_current is not None
        }
        self.fault: asyncio.Future[Exception] = asyncio.get_running_loop().create_future()

    def start(self) -> None:
        """Begins to poll."""
        for role in self._rig.devices:
            self._tasks.append(asyncio.create_task(self._watch(role), name=f"monitor {role}"))

    async def stop(self) -> None:
        """Stops polling; what was read until now is with the writer."""
        for task in self._tasks:
            task.cancel()
        if self._tasks:
            await asyncio.wait(self._tasks)

    def report(self, problem: Exception) -> None:
        """Ends the run by a problem, unless another one has already."""
        if not self.fault.done():
            self.fault.set_result(problem)

    def latest(self, name: str) -> Reading | None:
        """The newest value of a named reading, or of DEVICE.CHANNEL."""
        channel = self._channels.get(self._source(name))
        return channel.values[-1] if channel and channel.values else None

    def newest(self) -> dict[str, tuple[Reading, str]]:
        """The newest value of every channel that was read, by its name on this bench, with its unit."""
        return {channel.name: (channel.values[-1], channel.unit) for channel in self._channels.values()}

    def unit_of(self, name: str) -> str:
        """The unit of a reading."""
        return unit_of(name, self._bench) or ""

    def _source(self, name: str) -> str:
        """DEVICE.CHANNEL of a named reading, and of one that is named so already."""
        return self._bench.readings[name].from_ if name in self._bench.readings else name

    def last(self, name: str, span_s: float) -> np.ndarray[Any, np.dtype[np.float64]]:
        """The values of a reading over the last `span_s` before the newest: (N, 2), time and value."""
        channel = self._channels.get(self._source(name))
        if channel is None or not channel.values:
            return np.empty((0, 2))
        begin_s = channel.values[-1].at_s - span_s - 1e-6
        return np.array([reading for reading in channel.values if reading.at_s >= begin_s])

    async def _watch(self, role: str) -> None:
        every_s, device = period_s(role, self._bench), self._rig.devices[role]
        units = self._bench.devices[role].channels
        loop = asyncio.get_running_loop()
        due_s = loop.time()
        try:
            while True:
                self._take(role, await device.poll(), units)
                due_s = max(due_s + every_s, loop.time())
                await asyncio.sleep(due_s - loop.time())
        except (DriverError, BenchError) as problem:
            self._writer_event("fault", device=role, problem=str(problem))
            if not self.fault.done():
                self.fault.set_result(problem)

    def _take(self, role: str, readings: Mapping[str, Sequence[Reading]], units: Mapping[str, str]) -> None:
        for key, values in readings.items():
            if not values:
                continue
            source = f"{role}.{key}"
            channel = self._channels.get(source)
            if channel is None:
                channel = self._channels[source] = _Channel(self._names.get(source, source), units.get(key, ""))
            channel.extend(values)
            self._writer.readings(channel.name, channel.unit, values)
            self._on_reading(channel.name, values[-1])
            self._interlocks.take(source, values)
        self._look_at_interlocks()
        if role in self.windows:
            self._judge_current(role, self.windows[role])
        for name, entry in self._bench.readings.items():
            if entry.device == role:
                self._judge_reading(name, entry)

    def _look_at_interlocks(self) -> None:
        for change in self._interlocks.look(asyncio.get_running_loop().time()):
            facts = {"name": change.name, "action": change.action, "tripped": change.tripped}
            self._writer_event("interlock", **facts, since_s=change.since_s, text=change.text)
            self.on_interlock(change)

    def _judge_current(self, role: str, window: Window) -> None:
        current = self._channels.get(f"{role}.current")
        if window.on_since_s is None or current is None:
            return
        newest = current.values[-1]
        if newest.at_s < window.on_since_s + WINDOW_GRACE_S or window.low <= newest.value <= window.high:
            return
        raise WindowError(
            f"{role}: the units draw {newest.value * 1e3:.4g} mA, expected {window.low * 1e3:g} to "
            f"{window.high * 1e3:g} mA. Check the unit and its wiring before switching on again."
        )

    def _judge_reading(self, name: str, entry: ReadingEntry) -> None:
        newest = self.latest(name)
        now_s = asyncio.get_running_loop().time()
        reports_every_s = self._bench.devices[entry.device].description.reports_every_s
        if newest is None:
            return
        if now_s - newest.at_s > entry.stale_after + reports_every_s:
            raise WindowError(
                f"{name}: the last reading is {now_s - newest.at_s:.0f} s old, allowed are {entry.stale_after:g} s. "
                f"Check the thermometer and {entry.device}."
            )
        if entry.limits is not None and not entry.limits.min <= newest.value <= entry.limits.max:
            raise WindowError(
                f"{name}: {newest.value:.2f} °C is outside {entry.limits.min:g} to {entry.limits.max:g} °C. "
                "Check the chamber and the sensor."
            )

    def _writer_event(self, kind: str, **data: Any) -> None:
        try:
            self._writer.event(kind, **data)
        except BenchError as problem:
            if not self.fault.done():
                self.fault.set_result(problem)
