"""Record of the samples of a unit in motion, in volts or codes, from a CSV file.

A channel `x` is a column `x` in the unit of its calibration, or a column with the unit in its name, such as `x_mV`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.errors import InputError
from bench.metrology.calibration.temperature import Compensation
from bench.metrology.motion_records import SampleRecord
from bench.offline.count_series import SIGNS
from bench.offline.motion_series import TEMPERATURE, Series, marked, read_rows
from bench.offline.number_columns import read_header
from drivers.quantity.quantities import Quantity
from drivers.quantity.units import QuantityError, parse_unit
from drivers.schema.suggest import did_you_mean

CODE = "code"
Array = NDArray[np.float64]


def read_samples(path: Path, channels: Mapping[str, Compensation], *, is_warm: bool) -> Series:
    """Read the samples of `channels`, all of one kind; `is_warm` if the calibration needs a temperature.

    Raises InputError.
    """
    header = read_header(path)
    of_channels = {name: _column_of(path, name, known.output_unit, header) for name, known in channels.items()}
    table = read_rows(path, header, {name: [column] for name, (column, _) in of_channels.items()}, is_warm=is_warm)
    samples = {name: table.columns[column] * factor for name, (column, factor) in of_channels.items()}
    for name, values in samples.items():
        if channels[name].output_unit == CODE:
            _expect_whole(path, of_channels[name][0], table.time_s, values)
    forces = [known.force for known in channels.values() if known.force is not None]
    steps = {name: known.force.step for name, known in channels.items() if known.force is not None}
    record = SampleRecord(
        table.time_s, table.temperature_c, samples, averaged=forces[0].sample == "mean", own_c=table.own_c
    )
    return marked(record, table.left_out, steps)


def _column_of(path: Path, channel: str, unit: str, header: Sequence[str]) -> tuple[str, float]:
    """Column of a channel, and the factor from its unit to that of the calibration."""
    own = f"the calibration of channel {channel} is of an output in {unit}"
    if counted := [channel + sign for sign in SIGNS if channel + sign in header]:
        raise InputError(
            f"{path.name}: line 1: column '{counted[0]}' has counts, and {own}; give the calibration of the counted "
            f"unit, or a column '{channel}' in {unit}"
        )
    found = (
        [channel]
        if channel in header
        else [name for name in header if name.startswith(f"{channel}_") and name != f"{channel}_{TEMPERATURE}"]
    )
    if len(found) != 1:
        has = f"has {' and '.join(found)}" if found else f"has no column '{channel}'{did_you_mean(channel, header)}"
        raise InputError(
            f"{path.name}: line 1: {has}; {own}, so that one column '{channel}' is in {unit}, or '{channel}_UNIT' in "
            f"another unit of it; the line has {', '.join(header)[:100]}"
        )
    stated = found[0][len(channel) + 1 :] or unit
    try:
        return found[0], Quantity(float(parse_unit(stated).factor), parse_unit(stated).dimension).to(unit)
    except QuantityError:
        raise InputError(f"{path.name}: line 1: column '{found[0]}' is in '{stated}', and {own}") from None


def _expect_whole(path: Path, column: str, time_s: Array, values: Array) -> None:
    broken = np.flatnonzero(values != np.rint(values))
    if len(broken):
        raise InputError(
            f"{path.name}: column {column} has {values[broken[0]]:.9g} at t_s = {time_s[broken[0]]:.12g}; codes are "
            "whole numbers as the unit sends them. Are these volts, or values that another program converted?"
        )
