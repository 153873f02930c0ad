"""Record of the counters of a unit in motion: times, temperatures, and the counts of each channel, from a CSV file.

A channel `x` is a column `x` of net counts, or two columns `x_pos` and `x_neg`; all are cumulative. The temperature is
a column `T_C`, or `x_T_C` of the sensor of one channel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.errors import InputError
from bench.metrology.least_squares import SIGMA_PER_MAD
from bench.metrology.temperature_checks import beyond_possible
from bench.metrology.velocity import CountRecord
from bench.offline.number_columns import read_header, read_numbers
from drivers.schema.suggest import did_you_mean

TIME, TEMPERATURE = "t_s", "T_C"
SIGNS = ("_pos", "_neg")
GAP = 1.5  # times the usual interval: readings are missing between two rows
GLITCH_SD = 8.0  # robust standard deviations of a rate from the median of three
GLITCH_PULSES = 3.0  # a smaller deviation is the resolution of the count
Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class CountSeries:
    """A record with masks of its rows (n,), each on the row that ends an interval; `left_out` rows were incomplete."""

    record: CountRecord
    gap: Mask
    glitch: Mask
    left_out: int

    @property
    def lost(self) -> Mask:
        """Mask (n,) of the rows that end an interval in which the pulses of a channel are unknown."""
        return _at_end(np.any([np.isnan(pulses) for pulses in self.record.net_pulses.values()], axis=0))


def read_counts(path: Path, channels: Sequence[str], counter_bits: int | None, *, is_warm: bool) -> CountSeries:
    """Read the counts of `channels`; counters wrap at 2**counter_bits, None for net counts and those that do not wrap.

    `is_warm` if the calibration needs a temperature. Raises InputError.
    """
    header = read_header(path)
    of_channels = {channel: _columns_of(path, channel, header) for channel in channels}
    own = {channel: name for channel in channels if is_warm and (name := f"{channel}_{TEMPERATURE}") in header}
    warm = [*([TEMPERATURE] if is_warm and len(own) < len(channels) else []), *own.values()]
    names = [TIME, *warm, *(name for each in of_channels.values() for name in each)]
    _expect(path, names[: 1 + len(warm)], header)
    columns = dict(zip(names, read_numbers(path, names).T, strict=True))
    needed = [name for name in names if name not in warm]
    complete = np.all([np.isfinite(columns[name]) for name in needed], axis=0)
    if np.count_nonzero(complete) < 2:
        raise InputError(
            f"{path.name}: has fewer than two rows with {', '.join(needed)}; there is nothing to integrate"
        )
    read_c = {name: _temperature_c(path, columns, name) for name in warm}
    columns |= read_c
    if not complete.all():
        columns = {name: each[complete] for name, each in columns.items()}
    time_s = columns[TIME]
    _expect_increasing(path, time_s)
    pulses = {
        channel: _net_pulses(path, {name: columns[name] for name in own}, time_s, counter_bits)
        for channel, own in of_channels.items()
    }
    temperature_c = columns[warm[0]] if warm else np.zeros(len(time_s))
    own_c = {channel: columns[name] for channel, name in own.items()}
    return marked(CountRecord(time_s, temperature_c, pulses, own_c), int(np.count_nonzero(~complete)))


def marked(record: CountRecord, left_out: int = 0) -> CountSeries:
    """A record with its gaps and glitches; `left_out` rows of it were incomplete."""
    seconds = np.diff(record.time_s)
    glitch = np.any([_glitches(each, seconds) for each in record.net_pulses.values()], axis=0)
    return CountSeries(record, _at_end(_gaps(seconds)), _at_end(glitch), left_out)


def _gaps(seconds: Array) -> Mask:
    """Mask of intervals that are much longer than usual."""
    return np.asarray(seconds > GAP * float(np.median(seconds)))


def _at_end(of_interval: Mask) -> Mask:
    return np.concatenate(([False], of_interval))


def _columns_of(path: Path, channel: str, header: Sequence[str]) -> tuple[str, ...]:
    both = tuple(channel + sign for sign in SIGNS)
    if channel in header and not set(both) & set(header):
        return (channel,)
    if channel not in header and set(both) <= set(header):
        return both
    has = f"has both '{channel}' and '{both[0]}'" if channel in header else f"has no column '{channel}'"
    raise InputError(
        f"{path.name}: line 1: {has}; the counts of channel {channel} are a column '{channel}' of net counts, or "
        f"'{both[0]}' and '{both[1]}', cumulative; the line has {', '.join(header)[:100]}"
    )


def _expect(path: Path, names: Sequence[str], header: Sequence[str]) -> None:
    """Raise InputError if there is no column for the time in s, or for the temperature in °C."""
    for name in names:
        if name not in header:
            what = "the times in s" if name == TIME else "the temperatures in °C of the thermometer of the calibration"
            raise InputError(
                f"{path.name}: line 1: there is no column '{name}'{did_you_mean(name, header)}; it has {what}: convert "
                f"other units. The line has {', '.join(header)[:100]}"
            )


def _expect_increasing(path: Path, time_s: Array) -> None:
    back = np.flatnonzero(np.diff(time_s) <= 0)
    if len(back):
        at = int(back[0])
        raise InputError(
            f"{path.name}: t_s goes from {time_s[at]:.12g} to {time_s[at + 1]:.12g} in row {at + 2} of the data; times "
            "increase: sort the rows, remove copies, and put the records of two runs into two files"
        )


def _temperature_c(path: Path, columns: dict[str, Array], name: str) -> Array:
    """Temperature (n,) of each row, linear in time between those that have a possible one, and constant beyond."""
    read_c, time_s = columns[name], columns[TIME]
    usable = np.isfinite(time_s) & np.isfinite(read_c) & ~beyond_possible(read_c)
    if not usable.any():
        lowest = np.nanmin(read_c) if np.isfinite(read_c).any() else np.nan
        why = "is blank" if np.isnan(lowest) else f"has {lowest:.6g} and more: is it in kelvin? Write °C"
        raise InputError(f"{path.name}: column {name} {why}; the calibration depends on the temperature")
    if usable.all():
        return read_c
    return np.interp(time_s, time_s[usable], read_c[usable])


def _net_pulses(path: Path, columns: dict[str, Array], time_s: Array, counter_bits: int | None) -> Array:
    """Net pulses (n - 1,) between two rows, NaN where a counter may have wrapped unnoticed."""
    found = []
    for name, counts in columns.items():
        broken = np.flatnonzero(counts != np.rint(counts))
        if len(broken):
            raise InputError(
                f"{path.name}: column {name} has {counts[broken[0]]:.9g} at t_s = {time_s[broken[0]]:.12g}; counts are "
                "whole and cumulative. Rates are converted without --to, and give no velocity"
            )
        steps = np.diff(counts)
        found.append(steps if len(columns) == 1 else _steps(path, name, steps, time_s, counter_bits))
    return found[0] - found[1] if len(found) > 1 else found[0]


def _steps(path: Path, name: str, steps: Array, time_s: Array, counter_bits: int | None) -> Array:
    """Steps (n - 1,) of a counter that does not fall, with its wraps undone."""
    if counter_bits is None:
        falls = np.flatnonzero(steps < 0)
        if len(falls):
            raise InputError(
                f"{path.name}: column {name} falls at t_s = {time_s[falls[0] + 1]:.12g}, as a counter of one "
                f"sign does not; give --counter-bits if it wraps. Net counts are one column, '{name[:-4]}'"
            )
        return steps
    half = 2.0 ** (counter_bits - 1)
    steps = steps % (2 * half)
    seconds = np.diff(time_s)
    gap = _gaps(seconds)
    usual = ~gap & (steps < half)
    fastest_pps = float(np.max(steps[usual] / seconds[usual], initial=0.0))
    return np.where((steps >= half) | (gap & (fastest_pps * seconds >= half)), np.nan, steps)


def _glitches(pulses: Array, seconds: Array) -> Mask:
    """Mask of intervals whose rate is far from those before and after it, which agree: lost or extra pulses."""
    rate = pulses / seconds
    if len(rate) < 3:
        return np.zeros(len(rate), dtype=np.bool_)
    before, own, after = rate[:-2], rate[1:-1], rate[2:]
    median = np.maximum(np.minimum(before, after), np.minimum(np.maximum(before, after), own))
    away, bent = np.abs(own - median), np.abs(own - (before + after) / 2)
    sd = SIGMA_PER_MAD * float(np.median(bent[np.isfinite(bent)])) if np.isfinite(bent).any() else 0.0
    found = away > np.maximum(GLITCH_SD * sd, GLITCH_PULSES / seconds[1:-1])
    return np.concatenate(([False], found, [False]))
