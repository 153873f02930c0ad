"""Record `apply` of cases of method M2: outputs compensated, and regressed to the nominal temperature."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from bench.errors import InputError
from bench.methods.imu.reduction.calibrate import ImuCalibration
from bench.methods.imu.reduction.knots import Extrapolation, TemperatureTable, check_model, compensate
from bench.methods.imu.reduction.regressed import QUANTITIES, Regressed, nominal_output, visits_at
from bench.methods.imu.reduction.visits import differences
from bench.metrology.least_squares import Array
from bench.metrology.run_data import AXES
from bench.offline.case_file import Case

APPLY = "channel,T_C,raw_pps"
CHANNELS = tuple(f"{sensor}_{axis}" for sensor in ("acc", "gyro") for axis in AXES)
OF_ZERO = {"acc": ("k0", "k1_per_g"), "gyro": ("d0", "kg_pulse_per_deg")}
KEYS = ("channel", "T_C", "value", "comp_pps", "extrapolated")


class Applied(NamedTuple):
    """Rows of the record after compensation in their order, their uncertainties, and notes on them."""

    rows: list[dict[str, Any]]
    u: list[dict[str, Any]]
    notes: list[str]


def apply(
    case: Case,
    nominal_c: float | None,
    extrapolation: Extrapolation,
    found: ImuCalibration,
    tables: Mapping[str, TemperatureTable],
) -> Applied:
    """Compensate the rows of the record `apply`; none without it. Raises InputError without a nominal temperature."""
    if not case.has("apply"):
        return Applied([], [], [])
    if nominal_c is None:
        raise InputError(f"{case.name}: settings.T_nominal_C: is missing; the record 'apply' needs it")
    record = case.record("apply", APPLY)
    named = record.words("channel", list(CHANNELS)).tolist()
    names = [name if name in tables else None for name in named]
    temperature_c, raw = record.numbers("T_C"), record.numbers("raw_pps")
    value, nominal, u = np.full((3, len(names)), np.nan)
    extrapolated = np.zeros(len(names), dtype=np.bool_)
    for name, table in tables.items():
        of = np.array([each == name for each in names], dtype=np.bool_)
        done = compensate(table, temperature_c[of], raw[of], nominal_c, extrapolation)
        value[of], nominal[of], extrapolated[of] = done.value, done.nominal, done.extrapolated
        if of.any():
            u[of] = _Sensor(found, name, table).u(value[of], temperature_c[of], nominal_c)
    columns = (array.tolist() for array in (temperature_c, value, nominal, extrapolated))
    return Applied(
        [dict(zip(KEYS, row, strict=True)) for row in zip(names, *columns, strict=True)],
        [{"channel": name, "comp_pps": each} for name, each in zip(names, u.tolist(), strict=True)],
        [
            f"T_nominal_C {nominal_c:.10g} is outside of the knots of {name}"
            for name, table in tables.items()
            if table.usable and not table.covers(np.array(nominal_c))
        ],
    )


@dataclass(frozen=True, slots=True)
class _Sensor:
    """One channel with its table."""

    found: ImuCalibration
    name: str
    table: TemperatureTable

    def u(self, value: Array, temperature_c: Array, nominal_c: float) -> Array:
        """Standard uncertainties (n,) of regressed outputs; NaN if the nominal temperature is beyond the knots."""
        sensor, _, letter = self.name.partition("_")
        axis, table = AXES.index(letter), self.table
        every = [one.uncertainty(self.found.scatter[axis]) for one in self.found.over_temperature(axis)]
        unknown = np.full(len(value), np.nan)
        if not table.usable or not table.covers(np.array(nominal_c)):
            return unknown
        own_zero, own_scale = (max(getattr(each, key) for each in every) for key in OF_ZERO[sensor])
        visits = visits_at(table.temperature_c, self.found.temperatures_c(sensor, axis))
        output = nominal_output(
            Regressed(table, nominal_c, 1.0, own_zero, own_scale, visits), sensor, self._over_temperature(sensor, axis)
        )
        if output is None:
            return unknown
        return output.u(value, temperature_c, tuple(table.temperature_c.tolist()), nominal_c)

    def _over_temperature(self, sensor: str, axis: int) -> dict[str, float]:
        """Largest differences of visits, and errors of knots left out, relative to the scale factor, by quantity."""
        table, scale = self.table, abs(float(np.median(self.table.scale)))
        result = {}
        for quantity, values in zip(QUANTITIES[sensor][1:], (table.zero, table.scale), strict=True):
            error = check_model(table.temperature_c, values).error
            result[f"{quantity}/interpolation"] = float(np.max(np.abs(error), initial=0.0)) / scale
            apart = self._apart(sensor, axis, quantity, values)
            result[f"{quantity}/repeatability"] = apart / scale if math.isfinite(apart) else 0.0
        return result

    def _apart(self, sensor: str, axis: int, quantity: str, values: Array) -> float:
        """Largest difference of a later visit of a set point from the first, brought to one temperature."""
        key = OF_ZERO[sensor][QUANTITIES[sensor].index(quantity) - 1]
        by_set_point: dict[float, list[tuple[float, float]]] = {}
        for point in self.found.points:
            if (one := point.axes[axis]) is not None:
                by_set_point.setdefault(point.set_c, []).append((one.temperature_c(sensor), getattr(one, key)))
        knots = self.table.temperature_c, values
        apart = [
            differences([at_c for at_c, _ in visits], [each for _, each in visits], knots)
            for visits in by_set_point.values()
            if len(visits) > 1
        ]
        return float(np.max(np.abs(np.concatenate(apart)))) if apart else 0.0
