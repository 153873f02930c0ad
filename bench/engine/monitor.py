"""Monitor the devices throughout a run: record their readings, and find values outside their limits."""

from __future__ import annotations

import asyncio
import math
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from bench.config.channels import period_s, stale_after_s
from bench.config.models import BenchFile, ReadingEntry
from bench.engine.channel import Channel, rule_of
from bench.engine.interlocks import Change, Interlocks
from bench.engine.journal import Journal
from bench.engine.units import Kind, UnitFailure, Units
from bench.errors import BenchError, WindowError
from bench.quality import Absent, Fresh, Judged, Latest, Stale, Valid, Window
from bench.rig import Rig
from bench.sequence.language.readings import unit_of
from drivers.capabilities import FrameSource
from drivers.errors import DriverError
from drivers.timing.awake import awake_s, stalled_s
from drivers.values import Reading

STOP_WITHIN_S = 3.0  # time for a poll in progress
NEVER_READ = Stale("has not been read yet", math.inf)
WINDOW_GRACE_S = 2.0  # time after switching a supply before its current is judged


@dataclass
class Allowed:
    """Permitted current of a supply while its output is on; set by the steps that switch it."""

    low: float
    high: float
    on_since_s: float | None = None


class Monitor:
    """Poll every device at its period from `start` to `stop`.

    It reports a problem once, through the future `fault`; that device is no longer polled. An interlock that trips or
    recovers is journalled, then passed to `on_interlock`, which the engine sets before `start`. If one of several units
    fails, it is dropped; `on_unit_failure` is called with the failure and the interlocks on its thermometer, which are
    disabled. A device that fails and is not `used` by the run is no longer polled; `on_left_out` is called with it.
    Concurrency: one task for each device, owned by this object.
    """

    def __init__(
        self,
        rig: Rig,
        bench: BenchFile,
        interlocks: Interlocks,
        journal: Journal,
        on_reading: Callable[[str, Judged], None],
        places: Collection[str] | None = None,
        used: Collection[str] | None = None,
    ) -> None:
        self.units = Units(bench, places)
        self._rig, self._bench, self._journal, self._on_reading = rig, bench, journal, on_reading
        self._interlocks = interlocks
        self.on_interlock: Callable[[Change], None] = lambda _change: None
        self.on_unit_failure: Callable[[UnitFailure, list[str]], None] = lambda _failure, _interlocks: None
        self.on_left_out: Callable[[str, DriverError], None] = lambda _role, _problem: None
        self.used = frozenset(rig.devices if used is None else used)
        self.being_made_safe: set[str] = set()  # devices that the engine switches off or makes safe
        self.polls: dict[str, int] = {}  # number of answers of each device that is polled
        self._channels: dict[str, Channel] = {}
        self._names = {reading.from_: name for name, reading in bench.readings.items()}
        self._tasks: list[asyncio.Task[None]] = []
        there = bench.with_units_in(self.units.places)
        self.windows = {place.supply: Allowed(*there.current_range(place.supply)) for place in there.places.values()}
        self.fault: asyncio.Future[Exception] = asyncio.get_running_loop().create_future()

    @contextmanager
    def making_safe(self, role: str) -> Iterator[None]:
        """Within the context a device is made safe, which interrupts its answers to polls."""
        self.being_made_safe.add(role)
        try:
            yield
        finally:
            self.being_made_safe.discard(role)

    def start(self) -> None:
        """Start polling: all devices now, then evenly spread over their periods, so that polls seldom meet."""
        for number, role in enumerate(self._rig.devices):
            share = number / len(self._rig.devices)
            self._tasks.append(asyncio.create_task(self._watch(role, share), name=f"monitor {role}"))

    async def stop(self) -> None:
        """Stop polling; all data received until now, including unsolicited data, is with the writer."""
        for role in self._rig.devices:
            await self.wait_for_fresh(role)
        for task in self._tasks:
            task.cancel()
        if self._tasks:
            await asyncio.wait(self._tasks, timeout=STOP_WITHIN_S)

    def report(self, problem: Exception) -> None:
        """End the run by a problem, unless another one has already ended it."""
        if not self.fault.done():
            self.fault.set_result(problem)

    def latest(self, name: str) -> Latest:
        """The newest value of a named reading, or of DEVICE.CHANNEL, if it is valid and not stale."""
        channel = self._channels.get(self._source(name))
        return channel.latest() if channel is not None else NEVER_READ

    async def wait_for_fresh(self, name: str) -> None:
        """Wait until unsolicited data of a reading, or of all channels of a device, has been read in."""
        device = self._rig.devices[self._source(name).partition(".")[0]]
        if isinstance(device, FrameSource):
            device.drain()
            await asyncio.sleep(0)  # tasks that wait for data of the device go first

    def newest(self) -> dict[str, tuple[Latest, str]]:
        """Newest value of every channel that was read, with its unit, by its name on this bench."""
        return {channel.name: (channel.latest(), channel.unit) for channel in self._channels.values()}

    def unit_of(self, name: str) -> str:
        """The unit of a reading."""
        return unit_of(name, self._bench) or ""

    def _source(self, name: str) -> str:
        """DEVICE.CHANNEL of a named reading; a name of that form is returned unchanged."""
        return self._bench.readings[name].from_ if name in self._bench.readings else name

    def window(self, name: str, span_s: float, since_s: float) -> Window | Absent:
        """The values of a reading over the last `span_s` before the newest, none older than `since_s`."""
        channel = self._channels.get(self._source(name))
        return channel.window(span_s, since_s) if channel is not None else NEVER_READ

    async def _watch(self, role: str, share: float) -> None:
        """Poll a device for ever; the second poll comes this share of a period early."""
        every_s, device = period_s(role, self._bench), self._rig.devices[role]
        units = self._bench.devices[role].channels
        wait = (
            device.wait_for_data
            if isinstance(device, FrameSource) and not self._interlocks.judge_age_of(role)
            else None
        )
        loop = asyncio.get_running_loop()
        due_s = loop.time() - share * every_s
        self.polls[role] = 0
        try:
            while True:
                try:
                    self._take(role, await device.poll(), units)
                    self.polls[role] += 1
                except DriverError:
                    if role not in self.being_made_safe:  # this interrupts the answer to a poll
                        raise
                due_s = max(due_s + every_s, loop.time())
                await (wait() if wait is not None else asyncio.sleep(due_s - loop.time()))
        except DriverError as problem:
            if role in self.used:
                self._record("fault", device=role, problem=str(problem))
                self.report(problem)
            else:
                self.on_left_out(role, problem)
        except Exception as problem:  # noqa: BLE001  nobody looks at the device any more, which the run must not outlast
            self._record("fault", device=role, problem=str(problem))
            self.report(problem)
        finally:
            self.polls.pop(role, None)

    def _take(self, role: str, readings: Mapping[str, Sequence[Reading]], units: Mapping[str, str]) -> None:
        now_s = asyncio.get_running_loop().time()
        valid = {
            key: self._valid(f"{role}.{key}", values, units.get(key, ""), now_s) for key, values in readings.items()
        }
        if self.units.several:
            self._look_at_units(role)  # before the interlocks, so that none is judged on a faulty thermometer
        for key, values in valid.items():
            self._interlocks.take(f"{role}.{key}", values)
        self._look_at_interlocks()
        if role in self.windows:
            self._judge_current(role, self.windows[role])
        for key in valid:
            if (problem := self._problem_of(source := f"{role}.{key}")) and source not in self._names:
                raise WindowError(problem)
        for name, entry in self._bench.readings.items():
            if entry.device == role and self.units.is_needed(name) and (found := self._problem_with(name, entry)):
                raise WindowError(found[1])

    def _valid(self, source: str, readings: Sequence[Reading], unit: str, now_s: float) -> Sequence[Valid]:
        """Record and return the valid new readings of a channel; invalid ones are journalled."""
        if not readings:
            return ()
        channel = self._channels.get(source)
        if channel is None:
            rule = rule_of(source, unit, self._bench)
            if self._interlocks.judge_values_of(source):
                rule = rule._replace(matters=True)
            channel = self._channels[source] = Channel(self._names.get(source, source), unit, rule)
        valid, invalid = channel.take(readings, now_s)
        for each in invalid:
            facts = {"reading": channel.name, "read_s": each.at_s, "number": each.number, "raw": each.raw}
            self._record("doubted", **facts, text=f"{channel.name} {each.why}")
        if valid:
            self._journal.writer.readings(channel.name, channel.unit, valid)
            self._on_reading(channel.name, valid[-1])
        if channel.invalid is not None:
            self._interlocks.invalidate(source)
            self._on_reading(channel.name, channel.invalid)
        return valid

    def _problem_of(self, source: str) -> str:
        """Problem of a sensor, from the readings of its channel; "" if there is none."""
        channel = self._channels.get(source)
        return channel.problem if channel is not None else ""

    def _look_at_interlocks(self) -> None:
        for change in self._interlocks.evaluate(asyncio.get_running_loop().time(), stalled_s):
            facts = {"name": change.name, "action": change.action, "tripped": change.tripped}
            self._record("interlock", **facts, since_s=change.since_s, text=change.text)
            self.on_interlock(change)

    def _look_at_units(self, role: str) -> None:
        """Drop a unit if a device shows a failure of it alone.

        The same failure of several units at once is one of the bench.
        """
        failures = [found for place in self.units.left if (found := self._failure(place, role)) is not None]
        for kind, count in Counter(failure.kind for failure in failures).items():
            if count > 1:
                texts = " ".join(f"{each.place}: {each.text}" for each in failures if each.kind == kind)
                raise WindowError(
                    f"{role}: {count} units fail in the same way at the same time, which points to the bench. {texts}"
                )
        for failure in failures:
            self.drop(failure)

    def _failure(self, place: str, role: str) -> UnitFailure | None:
        """Failure of the unit in a place, from the newest values of a device."""
        unit = self._bench.places[place]
        found: tuple[Kind, str] | None = None
        if role == unit.supply and self.units.sole_unit(role) == place:
            found = self._problem_with_current(role, self.windows[role])
        reading = self._bench.readings[unit.temperature]
        if found is None and role == reading.device and self.units.sole_unit(unit.temperature) == place:
            found = self._problem_with(unit.temperature, reading)
        if found is None:
            found = self._silence(place, role)
        return UnitFailure(place, *found) if found is not None else None

    def _silence(self, place: str, role: str) -> tuple[Kind, str] | None:
        unit, device = self._bench.places[place], self._rig.devices[role]
        on_since_s = self.windows[unit.supply].on_since_s
        if on_since_s is None or not isinstance(device, FrameSource):
            return None
        sends_itself = "telemetry" in self._bench.devices[role].description.capabilities
        seen = device.last_seen().get((unit.telemetry or "") if sends_itself else unit.channel)
        if seen is None:
            return None
        now_s, late_s = asyncio.get_running_loop().time(), self._bench.devices[role].description.reports_every_s
        late_s += stalled_s(max(seen.frame_s, on_since_s))
        text = self.units.silence(place, seen, on_since_s, now_s, late_s)
        return ("silent", f"{text} Check the unit, its converter and their wiring.") if text else None

    def drop(self, failure: UnitFailure) -> None:
        """Drop a failed unit; its thermometer is ignored if that is what failed."""
        unit = self._bench.places[failure.place]
        disregarded: list[str] = []
        if failure.kind in ("thermometer", "temperature"):
            disregarded = self._interlocks.disable(self._source(unit.temperature))
        self.units.drop(failure)
        if not self.units.is_needed(unit.supply):
            self.windows[unit.supply].on_since_s = None
        self.on_unit_failure(failure, disregarded)

    def drop_by_readings(self, names: Collection[str], kind: Kind, text: str) -> bool:
        """Drop the units to which these readings belong alone; return true if others remain."""
        places = {place for name in names if (place := self.units.sole_unit(name)) is not None}
        return len(places) == len(names) and self.drop_all(places, kind, text)

    def drop_all(self, places: Collection[str], kind: Kind, text: str) -> bool:
        """Drop several units that failed together, unless no other would remain; return true if they were dropped."""
        if not self.units.left.keys() - set(places):
            return False
        for place in sorted(places):
            self.drop(UnitFailure(place, kind, text))
        return True

    def _judge_current(self, role: str, window: Allowed) -> None:
        if (found := self._problem_with_current(role, window)) is not None:
            raise WindowError(found[1])
        name = f"{role}.current"
        if window.on_since_s is None or name not in self._channels or not isinstance(stale := self.latest(name), Stale):
            return
        if awake_s(window.on_since_s) > stale_after_s(name, self._bench):
            raise WindowError(
                f"{name} {stale.why}, while the output is on, so that its window cannot be judged. Check {role}."
            )

    def _problem_with_current(self, role: str, window: Allowed) -> tuple[Kind, str] | None:
        if window.on_since_s is None or not isinstance(latest := self.latest(f"{role}.current"), Fresh):
            return None
        newest = latest.reading
        if newest.at_s < window.on_since_s + WINDOW_GRACE_S or window.low <= newest.value <= window.high:
            return None
        return (
            "draws_too_much" if newest.value > window.high else "draws_too_little",
            f"{role}: the units draw {newest.value * 1e3:.4g} mA, expected {window.low * 1e3:g} to "
            f"{window.high * 1e3:g} mA. Check the unit and its wiring before switching on again.",
        )

    def _problem_with(self, name: str, entry: ReadingEntry) -> tuple[Kind, str] | None:
        if problem := self._problem_of(entry.from_):
            return "thermometer", problem
        latest = self.latest(name)
        if isinstance(latest, Stale) and latest.age_s < math.inf:
            return "thermometer", (
                f"{name} {latest.why}, allowed are {entry.stale_after:g} s. Check the thermometer and {entry.device}."
            )
        if not isinstance(latest, Fresh) or entry.limits is None:
            return None
        value = latest.reading.value
        if not entry.limits.min <= value <= entry.limits.max:
            text = f"{name}: {value:.2f} °C is outside {entry.limits.min:g} to {entry.limits.max:g} °C. "
            return "temperature", f"{text}Check the chamber and the sensor."
        return None

    def _record(self, kind: str, **data: Any) -> None:
        try:
            self._journal.write(kind, **data)
        except BenchError as problem:
            self.report(problem)
