"""Readings of a bench: channels of its devices, also by the names that the bench file gives them."""

from __future__ import annotations

from typing import NamedTuple

from bench.config.models import BenchFile

LOST_POLLS = 4  # consecutive lost polls after which a reading without `stale_after` is stale


class Channel(NamedTuple):
    """Reading of a device; `source` is DEVICE.CHANNEL.

    `usual_age_s` is the greatest age of its newest value in normal operation, from the polling interval and the
    driver's own interval. `stale_after_s` is the age from which no decision is based on it.
    """

    source: str
    unit: str
    usual_age_s: float
    stale_after_s: float


def channels_of(bench: BenchFile) -> dict[str, Channel]:
    """Return every channel by every name it has: named readings first, then DEVICE.CHANNEL.

    Named readings of unknown devices are omitted.
    """
    by_source = {
        source: Channel(source, unit, usual_age_s(role, bench), stale_after_s(source, bench))
        for role, entry in bench.devices.items()
        for channel, unit in entry.channels.items()
        for source in (f"{role}.{channel}",)
    }
    named = {name: by_source[entry.from_] for name, entry in bench.readings.items() if entry.from_ in by_source}
    return named | by_source


def stale_after_s(source: str, bench: BenchFile) -> float:
    """Return the age in s from which a reading is stale: as in the bench file, or after lost polls."""
    role = source.partition(".")[0]
    stated = [reading.stale_after for reading in bench.readings.values() if reading.from_ == source]
    return min(stated, default=LOST_POLLS * period_s(role, bench)) + bench.devices[role].description.reports_every_s


def usual_age_s(role: str, bench: BenchFile) -> float:
    """Return the greatest age in s of the newest reading of a device in normal operation."""
    return period_s(role, bench) + bench.devices[role].description.reports_every_s


def period_s(role: str, bench: BenchFile) -> float:
    """Return the polling interval of a device in s during a run."""
    named = any(reading.device == role for reading in bench.readings.values())
    return bench.monitor.period if named else bench.monitor.devices
