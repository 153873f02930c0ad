"""Trends of a run for its page: the last hour of each reading, newest outputs, and how steady a soak is."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NamedTuple

from bench.clock import Stopwatch
from bench.errors import BenchError
from bench.station.runs.deviation import expectations
from bench.station.runs.live import LiveRun
from bench.station.runs.series import slope_and_range, thinned, within_since_s
from bench.store.tail import Bucket, Tail
from bench.web.sentence import soaking

HOUR_S = 3600.0
WIDTH_S = 60.0
OUTPUTS_OVER_S = 120.0
RENEW_EVERY_S = 4.0
MOST_RUNS = 16


class Trend(NamedTuple):
    """Trends of a run at bench time `until_s`: `hours` of readings and newest `outputs` of units, by channel.

    `units` are those of all recorded channels. `steady` are slope per s and range of the reading that a soak waits for;
    it has stayed within the permitted range since bench time `since_s`, None if not for its evaluation time. `expected`
    are the channels whose output can be compared with an expectation, with its unit.
    """

    until_s: float = 0.0
    hours: Mapping[str, list[Bucket]] = {}
    outputs: Mapping[str, Bucket] = {}
    steady: tuple[float, float] | None = None
    units: Mapping[str, str] = {}
    since_s: float | None = None
    expected: Mapping[str, str] = {}


class Trends:
    """Trends of all runs in progress, read again for all viewers at most every few seconds."""

    def __init__(self) -> None:
        self._kept: dict[str, tuple[Trend, Stopwatch]] = {}
        self._turn = asyncio.Lock()

    async def of(self, live: LiveRun) -> Trend:
        """Return the trends of a run; empty ones if it cannot be read yet."""
        async with self._turn:
            kept = self._kept.get(live.run.id)
            if kept is not None and kept[1].elapsed_s() < RENEW_EVERY_S:
                return kept[0]
            found = await asyncio.to_thread(_read, live)
            others = [each for each in self._kept.items() if each[0] != live.run.id]
            self._kept = dict([*others[-MOST_RUNS:], (live.run.id, (found, Stopwatch()))])
            return found


def _read(live: LiveRun) -> Trend:
    path = live.run.path
    with suppress(BenchError):
        with Tail(path) as tail:
            units, (_, until_s) = tail.channels(), tail.span_s()
            hours = {name: tail.envelope(name, max(0.0, until_s - HOUR_S), WIDTH_S) for name in units}
        sent = (live.timeline or {}).get("outputs", ())
        outputs = thinned(path, sent, max(0.0, until_s - OUTPUTS_OVER_S), WIDTH_S)
        newest = {name: each.buckets[-1] for name, each in outputs.items() if each.buckets}
        return Trend(until_s, hours, newest, units=units, expected=_expected(live), **_soak(live, until_s))
    return Trend()


def _soak(live: LiveRun, until_s: float) -> dict[str, Any]:
    """Return how steady the reading of a soak in progress is."""
    soak = soaking(live)
    if soak is None:
        return {}
    since_s = within_since_s(live.run.path, soak.reading, soak.begun_s, soak.band_c)
    is_long = since_s is not None and until_s - since_s >= soak.over_s
    steady = slope_and_range(live.run.path, soak.reading, soak.over_s)
    return {"steady": steady, "since_s": since_s if is_long else None}


def _expected(live: LiveRun) -> dict[str, str]:
    """Return the units of those outputs of the units of a run that have an expectation, by channel."""
    places = {unit.get("place") for unit in live.run.manifest.get("units", ())}
    return {name: each.unit for name, each in expectations(live.run.path).items() if each.place in places}
