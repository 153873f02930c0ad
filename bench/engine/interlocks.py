"""Interlocks during a run: when each trips, and when it has been in range long enough to recover.

Arithmetic on readings and times; the engine carries out a hold, a pause, a stop or an abort.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from bench.config.channels import Channel, channels_of
from bench.config.interlocks import (
    PASSING,
    Action,
    AgeInterlock,
    AnyInterlock,
    DifferenceInterlock,
    RateInterlock,
    ReadingInterlock,
    rate_unit,
)
from bench.config.models import BenchFile
from bench.quality import Valid
from drivers.quantity.units import parse_unit

Stalled = Callable[[float], float]


def _never(_since_s: float) -> float:
    return 0.0


@dataclass(frozen=True, slots=True)
class Change:
    """An interlock has tripped or recovered; `since_s` is the time at which the condition began, `text` the message."""

    name: str
    action: Action
    tripped: bool
    since_s: float
    text: str


class Interlocks:
    """All interlocks of a run; a stop and an abort trip once.

    Only valid readings are judged, at their own times. A missing reading neither trips an interlock nor lets it
    recover, except where the age of a reading is monitored. A tripped interlock recovers only after valid readings
    without a gap.
    """

    def __init__(self, entries: Mapping[str, AnyInterlock], bench: BenchFile) -> None:
        channels = channels_of(bench) if entries else {}
        self._interlocks = [_made(name, entry, channels) for name, entry in entries.items()]
        self._of_source: dict[str, list[_Interlock]] = {}
        for interlock in self._interlocks:
            for source in interlock.sources:
                self._of_source.setdefault(source, []).append(interlock)
        self._changes: list[Change] = []

    def take(self, source: str, readings: Sequence[Valid]) -> None:
        """Add new readings of DEVICE.CHANNEL, in time order."""
        for interlock in self._of_source.get(source, ()):
            for reading in readings:
                if (change := interlock.take(source, reading)) is not None:
                    self._changes.append(change)

    def invalidate(self, source: str) -> None:
        """Note that the newest reading of DEVICE.CHANNEL is invalid."""
        for interlock in self._of_source.get(source, ()):
            interlock.invalidate(source)

    def judge_values_of(self, source: str) -> bool:
        """True if interlocks judge DEVICE.CHANNEL and none of them monitors the age of its valid readings."""
        judging = self._of_source.get(source, ())
        return bool(judging) and not any(isinstance(each, _Age) for each in judging)

    def judge_age_of(self, role: str) -> bool:
        """True if an interlock monitors the age of a device's readings, which grows while it is silent."""
        return any(isinstance(each, _Age) and role == each.sources[0].partition(".")[0] for each in self._interlocks)

    def disable(self, source: str) -> list[str]:
        """Disable the interlocks on DEVICE.CHANNEL, whose readings are no longer valid; return their names."""
        gone = self._of_source.pop(source, [])
        self._interlocks = [each for each in self._interlocks if each not in gone]
        for others in self._of_source.values():
            others[:] = [each for each in others if each not in gone]
        return [each.name for each in gone]

    def evaluate(self, now_s: float, stalled_s: Stalled = _never) -> Sequence[Change]:
        """Return the interlocks that have changed since the last call.

        To be called after every poll of a device, even a failed one. `stalled_s` returns the time since an instant in
        which the program was suspended; it does not age readings.
        """
        for interlock in self._interlocks:
            if (change := interlock.evaluate(now_s, stalled_s)) is not None:
                self._changes.append(change)
        if not self._changes:
            return ()
        changes, self._changes = self._changes, []
        return changes


class _Good(NamedTuple):
    """Range of good values, both ends included, with its text."""

    low: float
    high: float
    unit: str
    looked_at: str  # {} stands for the value
    allowed: str
    advice: str
    stale_after_s: float = math.inf


class _Interlock:
    """One interlock; subclasses define the judged value and its times."""

    def __init__(self, name: str, entry: AnyInterlock, sources: Sequence[str], good: _Good) -> None:
        self.sources = sources
        self.name, self._entry, self._good = name, entry, good
        self._good_for_s = entry.good_for_s if entry.then in PASSING else math.inf
        self._tripped = False
        self._otherwise_since_s: float | None = None  # time since which the condition contradicts the state
        self._newest: dict[str, Valid] = {}
        self._whole_since_s = -math.inf  # end of the last gap between valid readings of a source

    def take(self, source: str, reading: Valid) -> Change | None:
        """Add a new reading of one of the sources."""
        before = self._newest.get(source)
        if before is not None and reading.at_s - before.at_s > self._good.stale_after_s:
            self._whole_since_s = reading.at_s
        self._newest[source] = reading
        return None

    def invalidate(self, source: str) -> None:
        """Note that the newest reading of one of the sources is invalid."""

    def evaluate(self, now_s: float, stalled_s: Stalled) -> Change | None:
        """Judge after time has passed and all simultaneous readings are added."""
        return None

    def _judge(self, at_s: float, value: float, from_s: float | None = None) -> Change | None:
        """Judge a value at a time not before the last one; a value that is not a number is not good.

        It is computed from readings since `from_s`. A gap in them never delays a trip, and always a recovery.
        """
        bad = not self._good.low <= value <= self._good.high
        if bad == self._tripped or (self._tripped and from_s is not None and from_s < self._whole_since_s):
            self._otherwise_since_s = None
            return None
        if self._otherwise_since_s is None or (self._tripped and self._otherwise_since_s < self._whole_since_s):
            self._otherwise_since_s = at_s
        since_s = self._otherwise_since_s
        if at_s - since_s < (self._entry.for_s if bad else self._good_for_s):
            return None
        self._tripped, self._otherwise_since_s = bad, None
        return Change(self.name, self._entry.then, bad, since_s, self._text(value, at_s - since_s))

    def _text(self, value: float, held_s: float) -> str:
        good = self._good
        found = f"{good.looked_at.format(f'{value:.5g} {good.unit}'.rstrip())}, allowed is {good.allowed}"
        after = f" after {_duration(held_s)}" if held_s > 0 else ""
        if not self._tripped:
            return f"Interlock {self.name} has recovered{after}: {found}."
        return f"Interlock {self.name} has tripped{after}: {found}. {_consequence(self._entry)} {good.advice}"


class _Level(_Interlock):
    """Judge every reading."""

    def take(self, source: str, reading: Valid) -> Change | None:
        super().take(source, reading)
        return self._judge(reading.at_s, reading.value)


class _Rate(_Interlock):
    """Judge, with every reading, the mean rate since the newest one that is at least `over_s` older."""

    def __init__(
        self, name: str, entry: AnyInterlock, sources: Sequence[str], good: _Good, over_s: float, factor: float
    ) -> None:
        super().__init__(name, entry, sources, good)
        self._over_s, self._factor = over_s, factor
        self._kept: deque[Valid] = deque()

    def take(self, source: str, reading: Valid) -> Change | None:
        super().take(source, reading)
        kept = self._kept
        kept.append(reading)
        begin_s = reading.at_s - self._over_s
        while len(kept) > 1 and kept[1].at_s <= begin_s:
            kept.popleft()
        first = kept[0]
        if first.at_s > begin_s:
            return None
        rate = (reading.value - first.value) / (reading.at_s - first.at_s) * self._factor
        return self._judge(reading.at_s, rate, first.at_s)


class _Difference(_Interlock):
    """Judge the difference of the newest values of two channels while the second is at rest.

    Judged after all simultaneous readings are added. Not judged while one of them is invalid or stale; such a gap also
    restarts the recovery.
    """

    def __init__(self, name: str, entry: AnyInterlock, sources: Sequence[str], good: _Good, rest_s: float) -> None:
        super().__init__(name, entry, sources, good)
        self._rest_s = rest_s
        self._rests_since: Valid | None = None  # time at which the second reached its present rest value
        self._lapsed: set[str] = set()

    def take(self, source: str, reading: Valid) -> None:
        super().take(source, reading)
        self._lapsed.discard(source)
        rests = self._rests_since
        if source == self.sources[1] and (rests is None or abs(reading.value - rests.value) > self._good.high / 2):
            self._rests_since = reading

    def invalidate(self, source: str) -> None:
        self._lapsed.add(source)

    def evaluate(self, now_s: float, stalled_s: Stalled) -> Change | None:
        if len(self._newest) < 2 or self._rests_since is None:
            return None
        if self._newest[self.sources[1]].at_s - self._rests_since.at_s < self._rest_s:
            return None
        one, other = self._newest.values()
        oldest_s = min(one.at_s, other.at_s)
        if self._lapsed or now_s - oldest_s - stalled_s(oldest_s) > self._good.stale_after_s:
            self._whole_since_s = now_s
            return None
        return self._judge(max(one.at_s, other.at_s), abs(one.value - other.value))


class _Age(_Interlock):
    """Judge the age of the newest reading, or the time since the first call while there is none."""

    def __init__(self, name: str, entry: AnyInterlock, sources: Sequence[str], good: _Good) -> None:
        super().__init__(name, entry, sources, good)
        self._newest_s: float | None = None

    def take(self, source: str, reading: Valid) -> None:
        self._newest_s = reading.at_s

    def evaluate(self, now_s: float, stalled_s: Stalled) -> Change | None:
        if self._newest_s is None:
            self._newest_s = now_s
        return self._judge(now_s, now_s - self._newest_s - stalled_s(self._newest_s))


def _made(name: str, entry: AnyInterlock, channels: Mapping[str, Channel]) -> _Interlock:
    sources = tuple(channels[reading].source for reading in entry.names)
    unit, named = channels[entry.names[0]].unit, " and ".join(entry.names)
    stale_s = max(channels[reading].stale_after_s for reading in entry.names)
    check = f"Check {named}: the sensors, and what they measure."
    match entry:
        case ReadingInterlock():
            low = -math.inf if entry.below is None else entry.below.to(unit)
            high = math.inf if entry.above is None else entry.above.to(unit)
            good = _Good(low, high, unit, f"{named} is {{}}", _between(low, high, unit), check, stale_s)
            return _Level(name, entry, sources, good)
        case RateInterlock():
            per_time = rate_unit(unit)
            most = entry.above.to(per_time)
            good = _Good(-most, most, per_time, f"{named} changes by {{}}", f"±{most:.12g} {per_time}", check, stale_s)
            factor = float(parse_unit(f"{unit or 1}/s").factor / parse_unit(per_time).factor)
            return _Rate(name, entry, sources, good, entry.over_s, factor)
        case DifferenceInterlock():
            most = entry.above.to(unit)
            good = _Good(0.0, most, unit, f"{named} differ by {{}}", _between(-math.inf, most, unit), check, stale_s)
            return _Difference(name, entry, sources, good, entry.rest_s)
        case AgeInterlock():
            device = sources[0].partition(".")[0]
            allowed = _between(-math.inf, entry.above_s, "s")
            advice = f"Check the sensor, {device}, and its cable."
            good = _Good(-math.inf, entry.above_s, "s", f"{named} has had no new value for {{}}", allowed, advice)
            return _Age(name, entry, sources, good)


def _between(low: float, high: float, unit: str) -> str:
    if math.isinf(low):
        words = f"at most {high:.12g}"
    elif math.isinf(high):
        words = f"at least {low:.12g}"
    else:
        words = f"{low:.12g} to {high:.12g}"
    return f"{words} {unit}".rstrip()


def _consequence(entry: AnyInterlock) -> str:
    goes_on = "it is good" if entry.good_for_s == 0 else f"it has been in range for {_duration(entry.good_for_s)}"
    match entry.then:
        case "hold":
            return f"The chamber holds its set point where it is, and no further step begins until {goes_on}."
        case "pause":
            return f"No further step begins until {goes_on}."
        case "stop":
            return "The step under way ends, and the teardown runs."
        case "abort":
            return "Everything is made safe now, without the teardown."


def _duration(seconds: float) -> str:
    return f"{seconds:.3g} s" if seconds < 120 else f"{seconds / 60:.3g} min"
