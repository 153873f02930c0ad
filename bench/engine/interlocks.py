"""Interlocks while a run goes on: when one trips, and when it has been in range for long enough.

Arithmetic on readings and times. What a hold, a pause, a stop or an abort does is the engine's.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

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
from drivers.units import parse_unit
from drivers.values import Reading

Stalled = Callable[[float], float]


def _never(_since_s: float) -> float:
    return 0.0


@dataclass(frozen=True, slots=True)
class Change:
    """An interlock has tripped or recovered; `since_s` is the time at which this began, `text` the message."""

    name: str
    action: Action
    tripped: bool
    since_s: float
    text: str


class Interlocks:
    """All interlocks of a run; a stop and an abort trip once.

    Readings are judged at their own times: one that stays away neither trips an interlock nor makes it good, except
    where the age of a reading is what is looked at.
    """

    def __init__(self, entries: Mapping[str, AnyInterlock], bench: BenchFile) -> None:
        channels = channels_of(bench) if entries else {}
        self._interlocks = [_made(name, entry, channels) for name, entry in entries.items()]
        self._of_source: dict[str, list[_Interlock]] = {}
        for interlock in self._interlocks:
            for source in interlock.sources:
                self._of_source.setdefault(source, []).append(interlock)
        self._changes: list[Change] = []

    def take(self, source: str, readings: Sequence[Reading]) -> None:
        """New readings of DEVICE.CHANNEL, in the order of their times."""
        for interlock in self._of_source.get(source, ()):
            for reading in readings:
                if (change := interlock.take(source, reading)) is not None:
                    self._changes.append(change)

    def judge_age_of(self, role: str) -> bool:
        """Whether an interlock monitors the age of a device's readings, which grows while it is silent."""
        return any(isinstance(each, _Age) and role == each.sources[0].partition(".")[0] for each in self._interlocks)

    def disregard(self, source: str) -> list[str]:
        """Disable the interlocks on DEVICE.CHANNEL, whose readings are no longer valid; return their names."""
        gone = self._of_source.pop(source, [])
        self._interlocks = [each for each in self._interlocks if each not in gone]
        for others in self._of_source.values():
            others[:] = [each for each in others if each not in gone]
        return [each.name for each in gone]

    def look(self, now_s: float, stalled_s: Stalled = _never) -> Sequence[Change]:
        """Interlocks that have changed since the last call; call it after every poll of a device, even a failed one.

        `stalled_s` returns the time since an instant in which the program was suspended; it does not age readings.
        """
        for interlock in self._interlocks:
            if (change := interlock.look(now_s, stalled_s)) is not None:
                self._changes.append(change)
        if not self._changes:
            return ()
        changes, self._changes = self._changes, []
        return changes


@dataclass(frozen=True, slots=True)
class _Good:
    """The values that are good, both ends included, and the words for them."""

    low: float
    high: float
    unit: str
    looked_at: str  # with {} for the value
    allowed: str
    advice: str


class _Interlock:
    """One interlock; subclasses define which value is judged, and when."""

    def __init__(self, name: str, entry: AnyInterlock, sources: Sequence[str], good: _Good) -> None:
        self.sources = sources
        self.name, self._entry, self._good = name, entry, good
        self._good_for_s = entry.good_for_s if entry.then in PASSING else math.inf
        self._tripped = False
        self._otherwise_since_s: float | None = None  # since when the condition is not what the state is

    def take(self, source: str, reading: Reading) -> Change | None:
        """A new reading of one of the sources."""
        return None

    def look(self, now_s: float, stalled_s: Stalled) -> Change | None:
        """Judge after time has passed and readings that belong together are taken."""
        return None

    def _judge(self, at_s: float, value: float) -> Change | None:
        """The value at a time not before the last one; a value that is not a number is not good."""
        bad = not self._good.low <= value <= self._good.high
        if bad == self._tripped:
            self._otherwise_since_s = None
            return None
        if self._otherwise_since_s is None:
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
    """Judges every reading."""

    def take(self, source: str, reading: Reading) -> Change | None:
        return self._judge(reading.at_s, reading.value)


class _Rate(_Interlock):
    """Judges, with every reading, the mean rate since the newest one that is at least `over_s` older."""

    def __init__(
        self, name: str, entry: AnyInterlock, sources: Sequence[str], good: _Good, over_s: float, factor: float
    ) -> None:
        super().__init__(name, entry, sources, good)
        self._over_s, self._factor = over_s, factor
        self._kept: deque[Reading] = deque()

    def take(self, source: str, reading: Reading) -> Change | None:
        kept = self._kept
        kept.append(reading)
        begin_s = reading.at_s - self._over_s
        while len(kept) > 1 and kept[1].at_s <= begin_s:
            kept.popleft()
        first = kept[0]
        if first.at_s > begin_s:
            return None
        return self._judge(reading.at_s, (reading.value - first.value) / (reading.at_s - first.at_s) * self._factor)


class _Difference(_Interlock):
    """Judges the newest values of both, after all simultaneous readings are taken, while the second is at rest."""

    def __init__(self, name: str, entry: AnyInterlock, sources: Sequence[str], good: _Good, rest_s: float) -> None:
        super().__init__(name, entry, sources, good)
        self._newest: dict[str, Reading] = {}
        self._rest_s = rest_s
        self._rests_since: Reading | None = None  # when the second came to where it now rests

    def take(self, source: str, reading: Reading) -> None:
        self._newest[source] = reading
        rests = self._rests_since
        if source == self.sources[1] and (rests is None or abs(reading.value - rests.value) > self._good.high / 2):
            self._rests_since = reading

    def look(self, now_s: float, stalled_s: Stalled) -> Change | None:
        if len(self._newest) < 2 or self._rests_since is None:
            return None
        if self._newest[self.sources[1]].at_s - self._rests_since.at_s < self._rest_s:
            return None
        one, other = self._newest.values()
        return self._judge(max(one.at_s, other.at_s), abs(one.value - other.value))


class _Age(_Interlock):
    """Judges the age of the newest reading, or the time since the first call while there is none."""

    def __init__(self, name: str, entry: AnyInterlock, sources: Sequence[str], good: _Good) -> None:
        super().__init__(name, entry, sources, good)
        self._newest_s: float | None = None

    def take(self, source: str, reading: Reading) -> None:
        self._newest_s = reading.at_s

    def look(self, now_s: float, stalled_s: Stalled) -> Change | None:
        if self._newest_s is None:
            self._newest_s = now_s
        return self._judge(now_s, now_s - self._newest_s - stalled_s(self._newest_s))


def _made(name: str, entry: AnyInterlock, channels: Mapping[str, Channel]) -> _Interlock:
    """The interlock of an entry that fits the bench."""
    sources = tuple(channels[reading].source for reading in entry.names)
    unit, named = channels[entry.names[0]].unit, " and ".join(entry.names)
    check = f"Check {named}: the sensors, and what they measure."
    match entry:
        case ReadingInterlock():
            low = -math.inf if entry.below is None else entry.below.to(unit)
            high = math.inf if entry.above is None else entry.above.to(unit)
            good = _Good(low, high, unit, f"{named} is {{}}", _between(low, high, unit), check)
            return _Level(name, entry, sources, good)
        case RateInterlock():
            per_time = rate_unit(unit)
            most = entry.above.to(per_time)
            good = _Good(-most, most, per_time, f"{named} changes by {{}}", f"±{most:.12g} {per_time}", check)
            factor = float(parse_unit(f"{unit or 1}/s").factor / parse_unit(per_time).factor)
            return _Rate(name, entry, sources, good, entry.over_s, factor)
        case DifferenceInterlock():
            most = entry.above.to(unit)
            good = _Good(0.0, most, unit, f"{named} differ by {{}}", _between(-math.inf, most, unit), check)
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
