"""Record of the counters of a unit in motion: times, temperatures, and the counts of each channel, from a CSV file.

A channel `x` is a column `x` of net counts, or two columns `x_pos` and `x_neg`; all are cumulative. The temperature is
a column `T_C`, or `x_T_C` of the sensor of one channel.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.errors import InputError
from bench.metrology.motion_records import CountRecord
from bench.offline.motion_series import TEMPERATURE, Series, gaps, marked, read_rows
from bench.offline.number_columns import read_header

SIGNS = ("_pos", "_neg")
Array = NDArray[np.float64]


def read_counts(path: Path, channels: Sequence[str], counter_bits: int | None, *, is_warm: bool) -> Series:
    """Read the counts of `channels`; counters wrap at 2**counter_bits, None for net counts and those that do not wrap.

    `is_warm` if the calibration needs a temperature. Raises InputError.
    """
    header = read_header(path)
    of_channels = {channel: _columns_of(path, channel, header) for channel in channels}
    table = read_rows(path, header, of_channels, is_warm=is_warm)
    time_s = table.time_s
    pulses = {
        channel: _net_pulses(path, {name: table.columns[name] for name in own}, time_s, counter_bits)
        for channel, own in of_channels.items()
    }
    return marked(CountRecord(time_s, table.temperature_c, pulses, table.own_c), table.left_out)


def _columns_of(path: Path, channel: str, header: Sequence[str]) -> tuple[str, ...]:
    both = tuple(channel + sign for sign in SIGNS)
    if channel in header and not set(both) & set(header):
        return (channel,)
    if channel not in header and set(both) <= set(header):
        return both
    has = f"has both '{channel}' and '{both[0]}'" if channel in header else f"has no column '{channel}'"
    known = (*both, f"{channel}_{TEMPERATURE}")
    sent = next((name for name in header if name.startswith(f"{channel}_") and name not in known), None)
    if sent is not None:
        has += f" but '{sent}', and the calibration is of the pulses of the unit"
    raise InputError(
        f"{path.name}: line 1: {has}; the counts of channel {channel} are a column '{channel}' of net counts, or "
        f"'{both[0]}' and '{both[1]}', cumulative; the line has {', '.join(header)[:100]}"
    )


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
    gap = gaps(seconds)
    usual = ~gap & (steps < half)
    fastest_pps = float(np.max(steps[usual] / seconds[usual], initial=0.0))
    return np.where((steps >= half) | (gap & (fastest_pps * seconds >= half)), np.nan, steps)
