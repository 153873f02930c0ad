"""The inertial unit under test as drawn for one run: accelerometers, gyros, and their codes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from simulators.units.accelerometer import UnitTruth, coded, draw_unit
from simulators.units.gyro import GyroTruth, draw_gyro
from simulators.units.imu_file import NAMES, GyroCodes, ImuFile
from simulators.units.unit_file import Draw, stream

Array = NDArray[np.float64]
OF_EACH = (
    "thresholds_c",
    "input_thresholds_g",
    "jumps",
)  # Constants of hysteresis, separate for each accelerometer


@dataclass(frozen=True, slots=True)
class ZeroDrift:
    """Bias drift of a gyro: linear in °/s², and from power-on in °/s with a time constant in s."""

    drift_dps2: float
    warm_up_dps: float
    warm_up_s: float


@dataclass(frozen=True, slots=True)
class GyroSends:
    """Codes of a gyro in place of pulses: codes per pulse/s, zero and noise in codes."""

    codes_per_pps: float
    zero_code: float
    noise_code: float
    code_bits: int

    def codes(self, rate_pps: Array) -> Array:
        """Codes for a pulse rate, without noise and before rounding."""
        return coded(self.codes_per_pps * rate_pps + self.zero_code, self.code_bits)


@dataclass(frozen=True, slots=True)
class ImuTruth:
    """One unit as drawn for one run; accelerometers, gyros and bias drifts, x, y, z.

    A unit that sends codes has the codes of its gyros in `gyros_send`, and the relative error of its clock.
    """

    accelerometers: tuple[UnitTruth, ...]
    gyros: tuple[GyroTruth, ...]
    gyro_drifts: tuple[ZeroDrift, ...]
    supply_a: float
    gyros_send: tuple[GyroSends, ...] = ()
    clock: float = 0.0


Truth = TypeVar("Truth", UnitTruth, GyroTruth, ZeroDrift, GyroSends)


def draw_imu(unit: ImuFile, seed: int, place: str) -> ImuTruth:
    """Draw the unit of one run; each channel has streams of its own."""

    def drift(axis: str) -> ZeroDrift:
        model, path = unit.gyro(axis), (place, f"gyro_{axis}", "gyro")
        return ZeroDrift(
            drift_dps2=model.drift.value(stream(seed, "uut", *path, "drift")),
            warm_up_dps=model.warm_up.amplitude.value(stream(seed, "uut", *path, "warm_up", "amplitude")),
            warm_up_s=model.warm_up.time_constant,
        )

    def sends(axis: str, model: GyroCodes) -> GyroSends:
        def value(draw: Draw, name: str) -> float:
            return draw.value(stream(seed, "uut", place, f"gyro_{axis}", "telemetry", name))

        return GyroSends(value(model.S, "S"), value(model.zero, "zero"), value(model.noise, "noise"), model.bits)

    telemetry = unit.telemetry
    return ImuTruth(
        tuple(draw_unit(unit.accelerometer(axis), seed, f"{place}/acc_{axis}") for axis in NAMES),
        tuple(draw_gyro(unit.gyro(axis), seed, place, f"gyro_{axis}") for axis in NAMES),
        tuple(map(drift, NAMES)),
        unit.supply.current,
        tuple(sends(axis, telemetry.gyros) for axis in NAMES) if telemetry else (),
        telemetry.clock.value(stream(seed, "uut", place, "telemetry", "clock")) if telemetry else 0.0,
    )


def stacked(truths: tuple[Truth, ...]) -> Truth:
    """Combine three sensors into one whose constants are columns (3, 1)."""
    columns: dict[str, Any] = {}
    for each in fields(truths[0]):
        values = [getattr(truth, each.name) for truth in truths]
        if each.name in OF_EACH:
            columns[each.name] = ()
        elif isinstance(values[0], tuple):
            columns[each.name] = tuple(map(_column, zip(*values, strict=True)))
        else:
            columns[each.name] = None if values[0] is None else _column(values)
    return type(truths[0])(**columns)


def _column(values: Iterable[float]) -> Array:
    return np.array([*values], np.float64)[:, np.newaxis]
