"""Visits of set points in cases of method M2: assignment of rows, and repeatability of the unit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.errors import InputError
from bench.methods.imu.reduction.calibrate import AxisCalibration, ImuCalibration, SetPoint
from bench.methods.imu.reduction.knots import TemperatureTable
from bench.methods.imu.reduction.records import PositionRecord, RateRecord, rounded
from bench.methods.imu.reduction.visits import differences, ranked, visits_in_order
from bench.metrology.least_squares import Array
from bench.metrology.run_data import AXES
from bench.offline.case_file import Case
from bench.offline.csv_record import Table

COMPENSATED = {"acc": ("K0_pps", "K1_pps_per_g"), "gyro": ("D0_pps", "KG_p_per_deg")}
MOST_SET_POINTS = 1000


def with_visits(
    positions: PositionRecord, rates: RateRecord, at_rest: Table, turned: Table
) -> tuple[PositionRecord, RateRecord]:
    """The records with the visits of their rows: by the column `visit` of both, else by order at each set point."""
    named = at_rest.whole_numbers("visit"), turned.whole_numbers("visit")
    at_place = np.where(_has_reading(positions), positions.attitude, -1)
    commands = np.unique(rates.command_dps, return_inverse=True)[1].ravel()
    rate_place = np.where((rates.axis >= 0) & _has_reading(rates), commands * len(AXES) + rates.axis, -1)
    in_order = (
        visits_in_order(rounded(positions.set_c), at_place),
        visits_in_order(rounded(rates.set_c), rate_place),
    )
    given = [bool(np.isfinite(visit).any()) for visit in named]
    if all(given) or (given[0] and not len(rates.set_c)):
        return (
            replace(positions, set_c=_where(named[0], positions.set_c), visit=_whole(named[0])),
            replace(rates, set_c=_where(named[1], rates.set_c), visit=_whole(named[1])),
        )
    ranks = ranked(rounded(positions.set_c), named[0]), ranked(rounded(rates.set_c), named[1])
    numbers = [rank if has else order for rank, has, order in zip(ranks, given, in_order, strict=True)]
    return replace(positions, visit=numbers[0]), replace(rates, visit=numbers[1])


def _has_reading(record: PositionRecord | RateRecord) -> NDArray[np.bool_]:
    return (record.dwell_s > 0) & np.isfinite(record.gyro_counts).any(axis=-1)


def _where(visit: Array, set_c: Array) -> Array:
    """Set points; none for rows without a visit in a record with visits."""
    return np.where(np.isfinite(visit), set_c, np.nan)


def _whole(visit: Array) -> NDArray[np.int_]:
    return np.nan_to_num(visit, nan=1).astype(np.int_)


def check_set_points(case: Case, positions: PositionRecord, rates: RateRecord) -> None:
    """Raise InputError if there are more visits of set points than plausible."""
    keys = [np.stack([of.set_c, of.visit], axis=-1) for of in (positions, rates) if of.visit is not None]
    visits = np.unique(np.concatenate(keys), axis=0)
    different = len(np.unique(visits[:, 0]))
    if different > MOST_SET_POINTS:
        raise InputError(
            f"{case.name}: records: T_set_C has {different} different values, more than {MOST_SET_POINTS}; "
            "it is the set point of the chamber, not the reading of a thermometer"
        )
    if len(visits) > MOST_SET_POINTS:
        raise InputError(
            f"{case.name}: records: set points are visited {len(visits)} times, more than {MOST_SET_POINTS}; keep "
            "the rows of one visit together, or number the visits in a column 'visit'"
        )


def repeatability(
    found: ImuCalibration, tables: Mapping[str, TemperatureTable], show: Callable[[AxisCalibration], dict[str, float]]
) -> list[dict[str, Any]]:
    """Largest difference of a later visit from the first, at each set point with several visits.

    `show` returns an axis at a visit by the keys of the table. Differences are corrected for the temperatures of the
    visits.
    """
    several = {set_c: visits for set_c, visits in _by_set_point(found).items() if len(visits) > 1}
    return [
        {"T_set_C": set_c, "visits": len(visits)}
        | {
            name: _apart([show(each) for visit in visits if (each := visit.axes[axis])], name, tables)
            for axis, name in enumerate(AXES)
        }
        for set_c, visits in several.items()
    ]


def _by_set_point(found: ImuCalibration) -> dict[float, list[SetPoint]]:
    visits: dict[float, list[SetPoint]] = {}
    for point in found.points:
        visits.setdefault(point.set_c, []).append(point)
    return visits


def _apart(
    known: Sequence[Mapping[str, float]], axis: str, tables: Mapping[str, TemperatureTable]
) -> dict[str, float] | None:
    """Largest differences of one axis, by the keys of the table; None unless two visits are known."""
    if len(known) < 2:
        return None
    apart = {}
    for sensor, thermometer in (("acc", "Ta_C"), ("gyro", "Tg_C")):
        table = tables[f"{sensor}_{axis}"]
        for key, values in zip(COMPENSATED[sensor], (table.zero, table.scale), strict=True):
            at_c, of_visits = [one[thermometer] for one in known], [one[key] for one in known]
            apart[key] = float(np.max(np.abs(differences(at_c, of_visits, (table.temperature_c, values)))))
    return apart
