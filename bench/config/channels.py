"""What can be read on a bench: the channels of its devices, also by the names that the bench file gives them."""

from __future__ import annotations

from typing import NamedTuple

from bench.config.models import BenchFile


class Channel(NamedTuple):
    """Something that can be read; `source` is DEVICE.CHANNEL.

    `usual_age_s` is how old its newest value becomes while nothing is wrong: the device is asked in so long intervals,
    and its driver may take readings in together.
    """

    source: str
    unit: str
    usual_age_s: float


def channels_of(bench: BenchFile) -> dict[str, Channel]:
    """Every channel of a bench by every name it has: named readings first, then DEVICE.CHANNEL.

    A named reading that is from nowhere is left out.
    """
    by_source = {
        f"{role}.{channel}": Channel(
            f"{role}.{channel}", unit, period_s(role, bench) + entry.description.reports_every_s
        )
        for role, entry in bench.devices.items()
        for channel, unit in entry.channels.items()
    }
    named = {name: by_source[entry.from_] for name, entry in bench.readings.items() if entry.from_ in by_source}
    return named | by_source


def period_s(role: str, bench: BenchFile) -> float:
    """How often a device is asked for its readings while a run goes on."""
    named = any(reading.device == role for reading in bench.readings.values())
    return bench.monitor.period if named else bench.monitor.devices
