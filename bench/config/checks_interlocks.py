"""Checks of interlocks against a bench: existing readings, and limits in their units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from bench.config.channels import Channel, channels_of
from bench.config.document import Place, Problem
from bench.config.interlocks import (
    INTERLOCKS,
    AgeInterlock,
    AnyInterlock,
    DifferenceInterlock,
    RateInterlock,
    ReadingInterlock,
    rate_unit,
)
from bench.config.models import BenchFile
from drivers.quantity.quantities import Quantity
from drivers.quantity.units import NO_DIMENSION, QuantityError
from drivers.schema.suggest import did_you_mean


def interlock_misfits(entries: Mapping[str, AnyInterlock], bench: BenchFile) -> Iterator[Problem]:
    """Yield the problems of interlocks on a bench, at places of a document with the key `interlocks`."""
    channels = channels_of(bench) if entries else {}
    for name, entry in entries.items():
        place: Place = ("interlocks", name)
        if all(reading in channels for reading in entry.names):
            found = _misfits(entry, channels)
        else:
            found = _unknown_names(entry, channels, bench)
        yield from (((*place, *part), problem) for part, problem in found)


def _unknown_names(entry: AnyInterlock, channels: Mapping[str, Channel], bench: BenchFile) -> Iterator[Problem]:
    """Yield unknown names; named readings of unknown devices are reported at their own place."""
    key = next(key for key, model in INTERLOCKS.items() if isinstance(entry, model))
    for index, name in enumerate(entry.names):
        if name not in channels and name not in bench.readings:
            yield (key, index) if len(entry.names) > 1 else (key,), _unknown(name, channels)


def _unknown(name: str, channels: Mapping[str, Channel]) -> str:
    device, _, channel = name.partition(".")
    of_device = [known.partition(".")[2] for known in channels if known.startswith(f"{device}.")]
    if channel and of_device:
        return f"{device} has no channel '{channel}'{did_you_mean(channel, of_device)}"
    return f"there is no reading '{name}'{did_you_mean(name, channels)}"


def _misfits(entry: AnyInterlock, channels: Mapping[str, Channel]) -> Iterator[Problem]:
    """Yield limits in another unit than the reading, and limits that always or never trip."""
    channel = channels[entry.names[0]]
    match entry:
        case ReadingInterlock():
            yield from _in_unit(channel.unit, above=entry.above, below=entry.below)
        case RateInterlock():
            yield from _in_unit(rate_unit(channel.unit), above=entry.above)
        case DifferenceInterlock():
            other = channels[entry.names[1]]
            if channel.source == other.source:
                yield ("difference",), "the difference of a reading from itself is always 0"
            elif channel.unit != other.unit:
                is_in = [f"{name} is in {channels[name].unit or 'no unit'}" for name in entry.names]
                yield ("difference",), f"{is_in[0]}, {is_in[1]}: their difference cannot be formed"
            else:
                yield from _in_unit(channel.unit, above=entry.above)
        case AgeInterlock():
            if entry.above_s <= channel.usual_age_s:
                yield (
                    ("above",),
                    f"above: the newest value of {entry.reading} is up to {channel.usual_age_s:g} s old in normal "
                    "operation; expected more than that",
                )


def _in_unit(unit: str, **limits: Quantity | None) -> Iterator[Problem]:
    for key, limit in limits.items():
        if limit is None:
            continue
        try:
            limit.to(unit)
        except QuantityError as problem:
            if limit.dimension == NO_DIMENSION:
                yield (key,), f"{key}: {limit} has no unit, write it like '{limit} {unit}'"
            else:
                yield (key,), f"{key}: {problem}"
