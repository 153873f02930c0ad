"""Models of an inertial unit for its user: knots over temperature, and what specific force needs beside them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bench.methods.imu.reduction.budget import gyro_scale_unit
from bench.methods.imu.reduction.calibrate import ImuCalibration
from bench.methods.imu.reduction.knots import SAME_KNOT_C, TemperatureTable
from bench.methods.imu.reduction.regressed import Regressed, left_outs, nominal_output
from bench.metrology.calibration.force_terms import ForceTerms
from bench.metrology.calibration.temperature import Compensation
from bench.metrology.least_squares import Array
from bench.metrology.results.curves import Constant, KnotModel
from bench.metrology.results.finding import Finding
from bench.metrology.run_data import AXES, RunData, UnitUnderTest

AT_REST_G = (-1.0, 1.0)  # specific force along an axis in the attitudes of the calibration


@dataclass(frozen=True)
class UserModels:
    """Models of one unit from its calibration, with the uncertainties of the findings at its visits."""

    data: RunData
    unit: UnitUnderTest
    found: ImuCalibration
    at_visits: Sequence[Finding]
    outputs: Mapping[tuple[str, int], Regressed]

    def models(self) -> Iterator[KnotModel]:
        """Offset and scale factor of each channel."""
        for axis in range(len(AXES)):
            for sensor in ("acc", "gyro"):
                pair = self._knots(sensor, axis)
                yield from pair or ()

    def compensations(self, over_temperature: Sequence[Finding]) -> Iterator[Compensation]:
        """Compensation of each channel; counted accelerometers have force terms."""
        findings = [*self.at_visits, *over_temperature]
        for sensor, value_unit in (("acc", "g"), ("gyro", "°/s")):
            output_unit = self._output_unit(sensor)
            for axis, name in enumerate(AXES):
                pair = self._knots(sensor, axis)
                if pair is not None:
                    offset, scale = pair
                    force = force_terms(axis, findings) if sensor == "acc" and self.unit.is_counted else None
                    channel, output = f"{sensor}_{name}", self.outputs.get((sensor, axis))
                    yield Compensation(
                        channel, output_unit, value_unit, scale, offset, force=force,
                        thermometer=self.unit.thermometer(channel),
                        nominal=None if output is None else nominal_output(output, sensor, left_outs(findings, name)),
                    )  # fmt: skip

    def _knots(self, sensor: str, axis: int) -> tuple[KnotModel, KnotModel] | None:
        """Knots of zero and scale factor of a channel; None with fewer than two."""
        table = self.found.knots(sensor, axis)
        if not table.usable:
            return None
        zero_of, scale_of = ("K0", "K1") if sensor == "acc" else ("D0", "KG")
        u_scale = self._u_at(table, scale_of, axis)
        u_zero = self._u_at(table, zero_of, axis) * np.abs(table.scale)
        path = f"{self.data.label}/{self.unit.place}/{sensor}_{AXES[axis]}"

        def model(what: str, unit: str, values: Array, u: Array) -> KnotModel:
            return KnotModel(
                id=f"{path}/{what}", uut=self.unit.serial, quantity=f"{sensor}_{AXES[axis]}/{what}", unit=unit,
                knots_c=tuple(table.temperature_c.tolist()), values=tuple(values.tolist()), u=tuple(u.tolist()),
            )  # fmt: skip

        unit = self._output_unit(sensor)
        scale_unit = f"{unit}/g" if sensor == "acc" else gyro_scale_unit(self.unit)
        return model("offset", unit, table.zero, u_zero), model("scale", scale_unit, table.scale, u_scale)

    def _output_unit(self, sensor: str) -> str:
        return self.unit.output_unit if sensor == "acc" else self.unit.gyro_output_unit

    def _u_at(self, table: TemperatureTable, quantity: str, axis: int) -> Array:
        """Largest uncertainty of the findings averaged in a knot."""
        own = [each for each in self.at_visits if each.quantity == quantity and each.at["axis"] == AXES[axis]]
        return np.array([
            max((each.u for each in own if abs(each.at["temperature_c"] - at_c) < SAME_KNOT_C), default=math.nan)
            for at_c in table.temperature_c
        ])  # fmt: skip


def force_terms(axis: int, findings: Sequence[Finding]) -> ForceTerms | None:
    """Quadratic term and cross-coupling of the accelerometer `axis`; None if a visit determined none of them.

    They are means over the visits. Bias and scale factor differ from one visit to another, by hysteresis among others,
    by at most as much as two visits of the first set point did, and between knots by a quarter of the error of a knot
    that is left out: rectangular distributions.
    """
    own = [each for each in findings if each.at.get("axis") == AXES[axis]]
    quadratic = _mean([each for each in own if each.quantity == "K2"], "g/g²")
    toward = {name: [e for e in own if e.quantity == "misalignment" and e.at["toward"] == name] for name in AXES}
    cross = {f"acc_{name}": found for name, every in toward.items() if (found := _mean(every, "rad")) is not None}
    if quadratic is None or len(cross) < len(AXES) - 1:
        return None
    values = {each.quantity: each.value for each in own}
    bias_u_g, scale_u = (
        math.hypot(values.get(f"{name}/repeatability", 0.0), values.get(f"{name}/interpolation", 0.0) / 4)
        / math.sqrt(3)
        for name in ("K0", "K1")
    )
    return ForceTerms(quadratic, AT_REST_G, cross, bias_u_g=bias_u_g, scale_u=scale_u)


def _mean(found: Sequence[Finding], unit: str) -> Constant | None:
    """Mean over visits, with its standard uncertainty.

    An error of type B is one at all visits. Its share in a result differs from one to another, as readings in the dead
    band are left out; it is in the mean with the mean of its shares. Scatter is independent.
    """
    if not found:
        return None
    shares: dict[str, list[float]] = {}
    squares = 0.0
    for line in (line for each in found for line in each.budget):
        if line.type == "A":
            squares += (line.u / len(found)) ** 2
        else:
            shares.setdefault(line.source, []).append(line.u)
    squares += sum((sum(each) / len(found)) ** 2 for each in shares.values())
    return Constant(float(np.mean([each.value for each in found])), unit, math.sqrt(squares))
