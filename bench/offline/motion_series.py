"""Record of a unit in motion with the rows of its file: what counts and samples have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.errors import InputError
from bench.metrology.least_squares import SIGMA_PER_MAD
from bench.metrology.motion_records import GAP, MOST_BRIDGED, CountRecord, Record
from bench.metrology.temperature_checks import usable
from bench.offline.number_columns import read_numbers
from drivers.schema.suggest import did_you_mean

TIME, TEMPERATURE = "t_s", "T_C"
GLITCH_SD = 8.0  # robust standard deviations of an output from the median of three
GLITCH_STEPS = 3.0  # a smaller deviation, in pulses or codes, is the resolution
Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Series:
    """A record with masks of its rows (n,), each on the row that ends an interval; `left_out` rows were incomplete."""

    record: Record
    gap: Mask
    glitch: Mask
    left_out: int

    @property
    def is_counted(self) -> bool:
        """True for counts, false for samples."""
        return isinstance(self.record, CountRecord)

    @property
    def lost(self) -> Mask:
        """Mask (n,) of the rows that end an interval of which the specific force of a channel is unknown."""
        if isinstance(self.record, CountRecord):
            pulses = self.record.net_pulses.values()
            return _at_end(np.any([np.isnan(each) for each in pulses], axis=0))
        seconds = np.diff(self.record.time_s)
        return _at_end(self.record.lost_s() > MOST_BRIDGED * float(np.median(seconds)))


@dataclass(frozen=True, slots=True)
class Rows:
    """Complete rows of a file (n,): times, temperatures (zeros if none is needed) and columns; others are left out.

    `own_c` are the temperatures of channels with a column of their own.
    """

    time_s: Array
    temperature_c: Array
    own_c: Mapping[str, Array]
    columns: Mapping[str, Array]
    left_out: int


def read_rows(path: Path, header: Sequence[str], wanted: Mapping[str, Sequence[str]], *, is_warm: bool) -> Rows:
    """Read the columns `wanted` of each channel, which the file has, with times and temperatures. Raises InputError."""
    own = {channel: name for channel in wanted if is_warm and (name := f"{channel}_{TEMPERATURE}") in header}
    warm = [*([TEMPERATURE] if is_warm and len(own) < len(wanted) else []), *own.values()]
    needed = [TIME, *(name for each in wanted.values() for name in each)]
    _expect(path, [TIME, *warm], header)
    names = [*needed, *warm]
    columns = dict(zip(names, read_numbers(path, names).T, strict=True))
    complete = np.all([np.isfinite(columns[name]) for name in needed], axis=0)
    if np.count_nonzero(complete) < 2:
        raise InputError(
            f"{path.name}: has fewer than two rows with {', '.join(needed)}; there is nothing to integrate"
        )
    columns |= {name: _temperature_c(path, columns, name) for name in warm}
    if not complete.all():
        columns = {name: each[complete] for name, each in columns.items()}
    _expect_increasing(path, columns[TIME])
    return Rows(
        time_s=columns[TIME],
        temperature_c=columns[warm[0]] if warm else np.zeros(len(columns[TIME])),
        own_c={channel: columns[name] for channel, name in own.items()},
        columns=columns,
        left_out=int(np.count_nonzero(~complete)),
    )


def marked(record: Record, left_out: int = 0, steps: Mapping[str, float] | None = None) -> Series:
    """A record with its gaps and glitches; `left_out` rows of it were incomplete.

    `steps` are the quantisation steps of the samples of each channel.
    """
    seconds = np.diff(record.time_s)
    if isinstance(record, CountRecord):
        rates = [pulses / seconds for pulses in record.net_pulses.values()]
        glitch = _at_end(np.any([_glitches(rate, 1 / seconds) for rate in rates], axis=0))
    else:
        sizes = steps or {}
        of_channels = [_glitches(each, sizes.get(name, 0.0)) for name, each in record.samples.items()]
        glitch = np.asarray(np.any(of_channels, axis=0))
    return Series(record, _at_end(gaps(seconds)), glitch, left_out)


def gaps(seconds: Array) -> Mask:
    """Mask of intervals that are much longer than usual."""
    return np.asarray(seconds > GAP * float(np.median(seconds)))


def _at_end(of_interval: Mask) -> Mask:
    return np.concatenate(([False], of_interval))


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


def _temperature_c(path: Path, columns: Mapping[str, Array], name: str) -> Array:
    """Temperature (n,) of each row, linear in time between those that have a possible one, and constant beyond."""
    read_c, time_s = columns[name], columns[TIME]
    known = np.isfinite(time_s) & usable(read_c)
    if not known.any():
        lowest = np.nanmin(read_c) if np.isfinite(read_c).any() else np.nan
        why = "is blank" if np.isnan(lowest) else f"has {lowest:.6g} and more: is it in kelvin? Write °C"
        raise InputError(f"{path.name}: column {name} {why}; the calibration depends on the temperature")
    if known.all():
        return read_c
    return np.interp(time_s, time_s[known], read_c[known])


def _glitches(output: Array, step: Array | float) -> Mask:
    """Mask of outputs far from those before and after, which agree: lost or extra pulses, or wrong samples.

    `step` is the resolution of an output.
    """
    if len(output) < 3:
        return np.zeros(len(output), dtype=np.bool_)
    before, own, after = output[:-2], output[1:-1], output[2:]
    median = np.maximum(np.minimum(before, after), np.minimum(np.maximum(before, after), own))
    away, bent = np.abs(own - median), np.abs(own - (before + after) / 2)
    sd = SIGMA_PER_MAD * float(np.median(bent[np.isfinite(bent)])) if np.isfinite(bent).any() else 0.0
    found = away > np.maximum(GLITCH_SD * sd, GLITCH_STEPS * np.broadcast_to(step, output.shape)[1:-1])
    return np.concatenate(([False], found, [False]))
