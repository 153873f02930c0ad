"""The inertial unit under test as drawn for one run: accelerometers, gyros, and their codes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Annotated, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from simulators.units.accelerometer import UnitTruth, coded, draw_unit
from simulators.units.drawn import At, drawn
from simulators.units.gyro import GyroTruth, draw_gyro
from simulators.units.imu_file import NAMES, ImuFile

Array = NDArray[np.float64]
OF_EACH = (
    "thresholds_c",
    "input_thresholds_g",
    "jumps",
)  # Constants of hysteresis, separate for each accelerometer


@dataclass(frozen=True, slots=True)
class ZeroDrift:
    """Bias drift of a gyro: linear in °/s², and from power-on in °/s with a time constant in s."""

    drift_dps2: Annotated[float, At("drift")]
    warm_up_dps: Annotated[float, At("warm_up.amplitude")]
    warm_up_s: Annotated[float, At("warm_up.time_constant")]


@dataclass(frozen=True, slots=True)
class GyroSends:
    """Codes of a gyro in place of pulses: codes per pulse/s, zero and noise in codes."""

    codes_per_pps: Annotated[float, At("S")]
    zero_code: Annotated[float, At("zero")]
    noise_code: Annotated[float, At("noise")]
    code_bits: Annotated[int, At("bits")]

    def codes(self, rate_pps: Array) -> Array:
        """Codes for a pulse rate, without noise and before rounding."""
        return coded(self.codes_per_pps * rate_pps + self.zero_code, self.code_bits)


@dataclass(frozen=True, slots=True)
class CircuitTruth:
    """Temperature circuit of a unit: output in Hz at `at_c`, its polynomial, and noise of a reading."""

    at_c: Annotated[float, At("at")]
    output_at_hz: Annotated[float, At("output")]
    linear_hz: Annotated[float, At("linear")]
    quadratic_hz: Annotated[float, At("quadratic")]
    noise_hz: Annotated[float, At("noise")]

    def output_hz(self, temperature_c: Array) -> Array:
        """Output at temperatures, without noise."""
        away_c = temperature_c - self.at_c
        return np.asarray(self.output_at_hz + away_c * (self.linear_hz + away_c * self.quadratic_hz))


@dataclass(frozen=True, slots=True)
class ImuTruth:
    """One unit as drawn for one run; accelerometers, gyros and bias drifts, x, y, z.

    A unit that sends codes has the codes of its gyros in `gyros_send`, and the relative error of its clock.
    `positions_m` are those of the accelerometers from the reference point of the unit, in its frame.
    """

    accelerometers: tuple[UnitTruth, ...]
    gyros: tuple[GyroTruth, ...]
    gyro_drifts: tuple[ZeroDrift, ...]
    supply_a: Annotated[float, At("supply.current")]
    gyros_send: tuple[GyroSends, ...] = ()
    clock: Annotated[float, At("telemetry.clock")] = 0.0
    positions_m: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),) * len(NAMES)
    circuit: CircuitTruth | None = None


Truth = TypeVar("Truth", UnitTruth, GyroTruth, ZeroDrift, GyroSends)


def draw_imu(unit: ImuFile, seed: int, place: str) -> ImuTruth:
    """Draw the unit of one run; each channel has streams of its own."""
    gyros = {f"gyro_{axis}": unit.gyro(axis) for axis in NAMES}
    codes = unit.telemetry.gyros if unit.telemetry else None
    circuit = unit.thermal.circuit
    own = [(axis, getattr(unit.accelerometers, axis).position) for axis in NAMES]
    return drawn(
        ImuTruth, unit, seed, place,
        accelerometers=tuple(draw_unit(unit.accelerometer(axis), seed, f"{place}/acc_{axis}") for axis in NAMES),
        gyros=tuple(draw_gyro(gyro, seed, place, name) for name, gyro in gyros.items()),
        gyro_drifts=tuple(drawn(ZeroDrift, gyro, seed, place, name, "gyro") for name, gyro in gyros.items()),
        positions_m=tuple(drawn(_position, each, seed, place, f"acc_{axis}", "position") for axis, each in own),
        gyros_send=tuple(drawn(GyroSends, codes, seed, place, name, "telemetry") for name in gyros if codes),
        circuit=None if circuit is None else drawn(CircuitTruth, circuit, seed, place, "circuit"),
    )  # fmt: skip


def _position(
    x: Annotated[float, At("x")], y: Annotated[float, At("y")], z: Annotated[float, At("z")]
) -> tuple[float, float, float]:
    return x, y, z


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
