"""Series of a run for curves."""

from __future__ import annotations

import asyncio
import math
from datetime import datetime
from typing import Annotated

from fastapi import APIRouter, Query
from pydantic import BaseModel, Field

from bench.station.queue.items import Short
from bench.station.runs.scope import newest_samples, period_s
from bench.station.runs.series import POINTS, Thinned, thinned, width_of
from bench.store.tail import Tail, instant_at
from bench.web.access import Reader
from bench.web.services import Station

router = APIRouter(prefix="/api/v1/runs", tags=["runs"])
MOST_CHANNELS = 32
Channels = Annotated[list[Short], Query(max_length=MOST_CHANNELS)]
Finite = Annotated[float, Query(allow_inf_nan=False)]


class SeriesView(BaseModel):
    """Series of a channel; the lists have one entry for each interval that has readings."""

    unit: str
    at_s: list[float] = Field(description="begin of each interval, bench time in s")
    low: list[float | None]
    high: list[float | None]
    mean: list[float | None]


class SeriesOfRun(BaseModel):
    """Series of a run. Intervals begin at multiples of their width, so that a later answer continues an earlier one."""

    zero: datetime | None = Field(description="instant of bench time 0 by the clock of the bench")
    until_s: float = Field(description="bench time of the newest reading in s")
    width_s: float = Field(description="width of the intervals")
    channels: dict[str, SeriesView]


@router.get("/{run}/series")
async def series(
    station: Station, _: Reader, run: str, channel: Channels, since: Finite = 0.0, last: Finite | None = None,
    points: Annotated[int, Query(ge=10, le=5000)] = POINTS,
    width: Annotated[float | None, Query(ge=0.1, le=1e6)] = None,
) -> SeriesOfRun:  # fmt: skip
    """Return channels of a run from bench time `since` on, or over the `last` seconds, in about `points` intervals.

    Channels are readings, DEVICE.CHANNEL for an output of a unit, a pulse rate where it is counted, and
    DEVICE.CHANNEL.deviation for this output minus the one expected of a unit at rest. With the `width` of an earlier
    answer, its intervals are continued.
    """
    path = station.daemon.catalogue.run(run).path

    def read() -> SeriesOfRun:
        with Tail(path) as tail:
            begins = tail.begins()
            first_s, until_s = tail.span_s()
        since_s = max(first_s, since if last is None else until_s - last)
        width_s = width or width_of(max(until_s - since_s, 1.0), points)
        least_s = max(since_s, until_s - 20_000 * width_s)  # bounds the answer, whatever the width
        found = thinned(path, channel, least_s, width_s)
        return SeriesOfRun(
            zero=instant_at(begins, 0.0),
            until_s=until_s,
            width_s=width_s,
            channels={k: _view(v) for k, v in found.items()},
        )

    return await asyncio.to_thread(read)


def _view(found: Thinned) -> SeriesView:
    def column(name: str) -> list[float | None]:
        return [value if math.isfinite(value := float(getattr(each, name))) else None for each in found.buckets]

    return SeriesView(
        unit=found.unit, at_s=[each.at_s for each in found.buckets], low=column("low"), high=column("high"),
        mean=column("mean"),
    )  # fmt: skip


class SamplesView(BaseModel):
    """Samples of a channel."""

    unit: str
    at_s: list[float] = Field(description="bench time in s")
    values: list[float]


class SamplesOfRun(BaseModel):
    """Newest samples of a run, each of them."""

    zero: datetime | None = Field(description="instant of bench time 0 by the clock of the bench")
    step: str = Field(description="step in which they were acquired; empty without any")
    until_s: float = Field(description="bench time of the end of the acquisition so far in s")
    period_s: float | None = Field(description="period of the oscillation during which they were acquired, in s")
    channels: dict[str, SamplesView]


@router.get("/{run}/samples")
async def samples(
    station: Station, _: Reader, run: str, last: Annotated[float | None, Query(gt=0, le=600)] = None
) -> SamplesOfRun:
    """Return the newest acquired samples of a run: pulse rates between latches, values that a unit sends, encoders.

    They are those of the `last` seconds of the newest acquisition; without it of two periods of an oscillation, else of
    2 s. At most 20,000 of each channel.
    """
    path, live = station.daemon.catalogue.run(run).path, station.daemon.live.runs.get(run)
    steps = (live.timeline or {}).get("steps", ()) if live is not None else ()

    def read() -> SamplesOfRun:
        found = newest_samples(path, lambda step: last or 2 * (period_s(steps, step) or 1.0))
        channels = {
            name: SamplesView(unit=each.unit, at_s=each.at_s.tolist(), values=each.values.tolist())
            for name, each in found.channels.items()
        }
        return SamplesOfRun(
            zero=instant_at(found.begins, 0.0), step=found.step, until_s=found.until_s,
            period_s=period_s(steps, found.step), channels=channels,
        )  # fmt: skip

    return await asyncio.to_thread(read)
