"""Outputs of a calibrated unit regressed to its nominal temperature: outputs in a CSV file, or a record of counts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.errors import InputError
from bench.metrology.calibration.temperature import Beyond, Compensation
from bench.metrology.pulse_counts import RESOLUTION_COUNTS
from bench.offline.calibration_file import CHANNEL, OUTPUT, TEMPERATURE, CalibrationFile, rows_by_channel, with_columns
from bench.offline.csv_record import read_table
from bench.offline.motion import COUNTED, Column, Motion, remarks_on
from bench.offline.motion_series import Series
from bench.offline.number_columns import read_header
from drivers.quantity.quantities import parse
from drivers.quantity.units import QuantityError

ADDED = ("nominal", "u_nominal", "extrapolated")
Array = NDArray[np.float64]


def has_outputs(data: Path) -> bool:
    """True if a file has outputs row by row, not counts. Raises InputError."""
    return data.suffix == ".csv" and OUTPUT in read_header(data)


def nominal_temperatures(calibration: CalibrationFile, stated: str | None) -> dict[str, float]:
    """Nominal temperature of each channel that has one: as stated, such as "25 °C", or of the calibration.

    Raises InputError if no channel has one, or if it is outside of the calibration.
    """
    known = {name: each for name, each in calibration.over_temperature().items() if each.nominal is not None}
    if not known:
        raise InputError(
            f"the calibration of {calibration.uut} has no nominal temperature; that of an inertial unit (M2) has one "
            "if it was measured there"
        )
    try:
        given_c = None if stated is None else parse(stated).to("°C")
    except QuantityError as problem:
        raise InputError(f'--nominal "{stated}": {problem}') from None
    found = {name: each.nominal.at_c if given_c is None else given_c for name, each in known.items() if each.nominal}
    for name, at_c in found.items():
        low_c, high_c = known[name].valid_c or (at_c, at_c)
        if not low_c <= at_c <= high_c:
            raise InputError(f"{at_c:g} °C is outside of the calibration of {name}, {low_c:.4g} to {high_c:.4g} °C")
    return found


def regressed_outputs(calibration: CalibrationFile, data: Path, nominal_c: Mapping[str, float], beyond: Beyond) -> str:
    """Add regressed outputs and their standard uncertainties to a CSV file with T_C, output and channel.

    `extrapolated` is 1 beyond the range of the calibration. Raises InputError.
    """
    known = calibration.over_temperature()
    table = read_table(data, [TEMPERATURE, OUTPUT], optional=(CHANNEL,))
    output, temperature_c = table.numbers(OUTPUT), table.numbers(TEMPERATURE)
    value, u = np.full((2, len(output)), np.nan)
    outside = np.zeros(len(output), dtype=np.bool_)
    for name, rows in rows_by_channel(known, table):
        if name not in nominal_c:
            raise InputError(f"{data.name}: channel {name} has no nominal temperature in the calibration")
        value[rows], u[rows], outside[rows] = known[name].regressed(
            output[rows], temperature_c[rows], nominal_c[name], beyond
        )
    return with_columns(table, dict(zip(ADDED, (value, u, outside), strict=True)))


def counted_channels(calibration: CalibrationFile, nominal_c: Mapping[str, float]) -> dict[str, Compensation]:
    """Counted channels with a nominal temperature. Raises InputError without one."""
    known = calibration.over_temperature()
    counted = {name: known[name] for name in nominal_c if known[name].output_unit == COUNTED}
    if not counted:
        raise InputError(
            f"the outputs of {calibration.uut} are not counted; give a file with columns {TEMPERATURE}, {OUTPUT}, "
            f"{CHANNEL}"
        )
    return counted


def regressed_counts(
    calibration: CalibrationFile, name: str, series: Series, nominal_c: Mapping[str, float], beyond: Beyond
) -> Motion:
    """Mean pulse rates of the intervals of a record, called `name` in messages, at the nominal temperatures.

    The uncertainty contains the fractions of a pulse at both ends of an interval.
    """
    record = series.record
    seconds = np.diff(record.time_s)
    columns: list[Column] = [("t_s", "%.12g", record.time_s)]
    outside = np.zeros(len(seconds), dtype=np.bool_)
    for channel, known in counted_channels(calibration, nominal_c).items():
        value, u, beyond_range = known.regressed(
            record.output(channel), record.output_c(channel), nominal_c[channel], beyond
        )
        outside |= beyond_range
        columns.append((f"{channel}_pps", "%.10g", _at_end(value)))
        columns.append((f"u_{channel}_pps", "%.4g", _at_end(np.hypot(u, RESOLUTION_COUNTS / seconds))))
    extrapolated = np.concatenate(([False], outside))
    marks = {"extrapolated": extrapolated, "gap": series.gap, "glitch": series.glitch}
    columns += [(mark, "%d", mask) for mark, mask in marks.items()]
    return Motion(columns, [f"{name}: {remark}" for remark in remarks_on(series, extrapolated)])


def _at_end(of_interval: Array) -> Array:
    return np.concatenate(([np.nan], of_interval))
