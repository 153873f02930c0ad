"""Timing of a scanner's readings: sensor by sensor, sweep by sweep through the scan list."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from drivers.protocols import scpi
from simulators.instruments.scpi import ILLEGAL_VALUE, SETTINGS_CONFLICT, Handler, Refusal, setting
from simulators.world import World

SENSOR_S = 0.2
MEMORY_READINGS, MAX_SWEEPS, MAX_TIMER_S = 50_000, 50_000, 359_999.0
_SOURCES = {"IMM": "IMM", "IMMEDIATE": "IMM", "TIM": "TIM", "TIMER": "TIM"}
_AT_ONCE_S = 1e-9  # tolerance for rounding errors of due times


class StoredReading(NamedTuple):
    """A reading: channel, seconds since the start of the scan, and °C, None for an open sensor."""

    channel: int
    since_s: float
    temperature_c: float | None


@dataclass(frozen=True, slots=True)
class Sweeps:
    """A running scan: `count` sweeps through `channels`, inf until it is aborted.

    A sweep begins `every_s` after the start of the previous one, or at its end. `kept`: its readings stay in memory.
    """

    begun_s: float
    channels: tuple[int, ...]
    count: float
    every_s: float
    kept: bool

    @property
    def readings(self) -> float:
        """Total number of readings."""
        return self.count * len(self.channels)

    def left_s(self, now_s: float) -> float:
        """Remaining time, 0 at the end."""
        duration_s = (self.count - 1) * self._period_s + self._sweep_s
        left_s = self.begun_s + duration_s - now_s
        return left_s if left_s > _AT_ONCE_S else 0.0

    def due(self, now_s: float) -> int:
        """Number of readings until now."""
        since_s = now_s - self.begun_s + _AT_ONCE_S
        sweeps = math.floor(since_s / self._period_s)
        of_the_last = min(math.floor((since_s - sweeps * self._period_s) / SENSOR_S), len(self.channels))
        return int(min(sweeps * len(self.channels) + of_the_last, self.readings))

    def place(self, index: int) -> tuple[int, float]:
        """Channel of a reading, numbered from 0, and its time after the start of the scan (s)."""
        sweep, place = divmod(index, len(self.channels))
        return self.channels[place], sweep * self._period_s + (place + 1) * SENSOR_S

    @property
    def _sweep_s(self) -> float:
        return SENSOR_S * len(self.channels)

    @property
    def _period_s(self) -> float:
        return max(self.every_s, self._sweep_s)


class Scans:
    """Trigger of scans, the running scan, and the memory of readings.

    `read` returns the reading of a channel at a true time (°C); it is called on request, in the order of the readings.
    """

    def __init__(self, world: World, read: Callable[[int, float], float | None]) -> None:
        self._world, self._read = world, read
        self._memory: deque[StoredReading] = deque(maxlen=MEMORY_READINGS)
        self.reset()

    def reset(self) -> None:
        """Clear scan and memory, and set an immediate trigger with one sweep."""
        self._sweeps: Sweeps | None = None
        self._taken = 0
        self._source, self._count, self._timer_s = "IMM", 1.0, 10.0
        self._memory.clear()

    def commands(self) -> dict[str, Handler]:
        """Handlers of trigger settings and queries, by header."""
        return {
            "TRIGger:SOURce": self._set_source,
            "TRIGger:SOURce?": lambda _: self._source,
            "TRIGger:COUNt": self._set_count,
            "TRIGger:COUNt?": lambda _: exponential(min(self._count, scpi.NOT_A_NUMBER)),
            "TRIGger:TIMer": self._set_timer,
            "TRIGger:TIMer?": lambda _: exponential(self._timer_s),
        }

    def begin(self, channels: tuple[int, ...], *, kept: bool) -> float:
        """Begin a scan; return its duration (s). Raises Refusal if there is nothing to scan or a scan is running."""
        if not channels or self.left_s():
            raise Refusal(SETTINGS_CONFLICT)
        every_s = self._timer_s if self._source == "TIM" else 0.0
        self._sweeps = Sweeps(self._world.look(), channels, self._count, every_s, kept)
        self._memory.clear()
        self._taken = 0
        return self.left_s()

    def left_s(self) -> float:
        """Remaining time of the running scan (s), 0 without one."""
        return 0.0 if self._sweeps is None else self._sweeps.left_s(self._world.now())

    def end(self) -> list[StoredReading]:
        """Readings of the finished scan, none without one; those of a READ? are then removed from memory."""
        sweeps = self._sweeps
        if sweeps is None or math.isinf(sweeps.count):
            return []
        self._take(sweeps, int(sweeps.readings))
        self._sweeps = None
        readings = list(self._memory)
        if not sweeps.kept:
            self._memory.clear()
        return readings

    def abort(self) -> None:
        """End the running scan; its readings are kept."""
        self.stored_readings()
        self._sweeps = None

    def stored_readings(self) -> deque[StoredReading]:
        """Memory with the readings until now; the caller may remove readings from it."""
        if self._sweeps is not None and self._sweeps.kept:
            self._take(self._sweeps, self._sweeps.due(self._world.now()))
        return self._memory

    def _take(self, sweeps: Sweeps, count: int) -> None:
        """Take readings of a scan until there are `count`."""
        self._world.look()
        for index in range(max(self._taken, count - MEMORY_READINGS), count):
            channel, since_s = sweeps.place(index)
            self._memory.append(StoredReading(channel, since_s, self._read(channel, sweeps.begun_s + since_s)))
        self._taken = max(self._taken, count)

    def _set_source(self, argument: str) -> None:
        if argument.upper() not in _SOURCES:
            raise Refusal(ILLEGAL_VALUE)
        self._source = _SOURCES[argument.upper()]

    def _set_count(self, argument: str) -> None:
        endless = argument.upper() in ("INF", "INFINITY")
        self._count = math.inf if endless else float(round(setting(argument, 1, MAX_SWEEPS)))

    def _set_timer(self, argument: str) -> None:
        self._timer_s = setting(argument, 0, MAX_TIMER_S)


def exponential(value: float) -> str:
    """Format a number as these instruments do."""
    return f"{value:+.8E}"
