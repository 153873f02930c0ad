"""What can be read on a bench: the channels of its devices, also by the names that the bench file gives them."""

from __future__ import annotations

from typing import NamedTuple

from bench.config.models import BenchFile

LOST_POLLS = 4  # in a row, after which a reading without `stale_after` is stale


class Channel(NamedTuple):
    """Something that can be read; `source` is DEVICE.CHANNEL.

    `usual_age_s` is how old its newest value becomes while nothing is wrong: the device is asked in so long intervals,
    and its driver may take readings in together. `stale_after_s` is the age from which no decision is taken on it.
    """

    source: str
    unit: str
    usual_age_s: float
    stale_after_s: float


def channels_of(bench: BenchFile) -> dict[str, Channel]:
    """Every channel of a bench by every name it has: named readings first, then DEVICE.CHANNEL.

    A named reading that is from nowhere is left out.
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
    """Age from which the newest reading of DEVICE.CHANNEL is stale: as the bench file says, or after lost polls."""
    role = source.partition(".")[0]
    stated = [reading.stale_after for reading in bench.readings.values() if reading.from_ == source]
    return min(stated, default=LOST_POLLS * period_s(role, bench)) + bench.devices[role].description.reports_every_s


def usual_age_s(role: str, bench: BenchFile) -> float:
    """How old the newest reading of a device becomes while nothing is wrong."""
    return period_s(role, bench) + bench.devices[role].description.reports_every_s


def period_s(role: str, bench: BenchFile) -> float:
    """How often a device is asked for its readings while a run goes on."""
    named = any(reading.device == role for reading in bench.readings.values())
    return bench.monitor.period if named else bench.monitor.devices
