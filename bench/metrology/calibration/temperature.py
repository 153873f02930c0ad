"""Conversion of the output of a calibrated channel to the measured quantity at its present temperature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bench.metrology.calibration.dynamic import DynamicBias
from bench.metrology.calibration.force_terms import ForceTerms
from bench.metrology.calibration.linearity import Linearity
from bench.metrology.calibration.nominal_output import NominalOutput
from bench.metrology.least_squares import Array
from bench.metrology.results.curves import Constant, KnotModel, TemperatureModel

Curve = TemperatureModel | KnotModel | Constant
Beyond = Literal["hold", "reject"]
FORM = "value = (output - offset(T)) / scale(T) - bias(T)"


@dataclass(frozen=True, slots=True)
class Compensation:
    """Of one channel: value = (output - offset(T)) / scale(T) - bias(T), T the temperature its thermometer indicates.

    `offset` is in the unit of the output, `bias` in that of the value; None means zero. With a `linearity` this is its
    x, and the value is its v. For people: `serves` names the inputs of the calibration, `found_at_c` its temperature,
    if it was a single one, `thermometer` the reading by which T was found. `force` is what specific force over a record
    needs beside the curves, `nominal` what an output regressed to the nominal temperature does. `dynamic` is the model
    of the bias that takes the place of `bias` where the rate of the temperature is known.
    """

    channel: str
    output_unit: str
    value_unit: str
    scale: Curve
    offset: Curve | None = None
    bias: Curve | None = None
    linearity: Linearity | None = None
    serves: tuple[str, ...] = ()
    found_at_c: float | None = None
    force: ForceTerms | None = None
    thermometer: str = ""
    nominal: NominalOutput | None = None
    dynamic: DynamicBias | None = None

    @property
    def valid_c(self) -> tuple[float, float] | None:
        """Temperature range in which all its curves are known; None if none of them depends on temperature."""
        known = [_valid_c(curve) for curve in (self.scale, self.offset, self.bias) if curve is not None]
        ends = [each for each in known if each is not None]
        return (max(low for low, _ in ends), min(high for _, high in ends)) if ends else None

    def to_json(self) -> dict[str, Any]:
        """Content of a calibration file."""
        curves = {"offset": self.offset, "scale": self.scale, "bias": self.bias}
        return {
            "channel": self.channel,
            "output": self.output_unit,
            "value": self.value_unit,
            "form": FORM,
            **{name: None if curve is None else curve.to_json() for name, curve in curves.items()},
            "valid_c": None if self.valid_c is None else list(self.valid_c),
            **({} if self.linearity is None else {"linearity": self.linearity.to_json()}),
            **({"serves": list(self.serves)} if self.serves else {}),
            **({"found_at_c": self.found_at_c} if self.found_at_c is not None else {}),
            **({"thermometer": self.thermometer} if self.thermometer else {}),
            **({"force": self.force.to_json()} if self.force is not None else {}),
            **({"nominal": self.nominal.to_json()} if self.nominal is not None else {}),
            **({"dynamic": self.dynamic.to_json()} if self.dynamic is not None else {}),
        }

    def apply(self, output: Array, temperature_c: Array, beyond: Beyond = "hold") -> tuple[Array, NDArray[np.bool_]]:
        """Values (n,) of outputs at temperatures (n,), and a mask of those out of range.

        Out of range the curves keep their end values, or the value is NaN. It is also NaN for missing data.
        """
        held_c, outside = self.held(temperature_c, beyond)
        offset, scale, bias = (
            values_of(curve, held_c) if curve is not None else 0.0 for curve in (self.offset, self.scale, self.bias)
        )
        value = np.asarray((output - offset) / scale - bias)
        if self.linearity is None:
            return value, outside
        value, beyond_range = self.linearity.true(value)
        return np.where(beyond_range & (beyond == "reject"), np.nan, value), outside | beyond_range

    def regressed(
        self, output: Array, temperature_c: Array, nominal_c: float, beyond: Beyond = "hold"
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Outputs (n,) at the nominal temperature, their standard uncertainties, and a mask of those out of range.

        Of a channel without a linearity; the uncertainty is NaN without `nominal`, and without knots.
        """
        value, outside = self.apply(output, temperature_c, beyond)
        at_c = np.array([nominal_c])
        offset, scale, bias = (
            0.0 if curve is None else values_of(curve, at_c) for curve in (self.offset, self.scale, self.bias)
        )
        regressed = np.asarray((value + bias) * scale + offset)
        if self.nominal is None or not isinstance(self.scale, KnotModel):
            return regressed, np.full_like(regressed, np.nan), outside
        held_c, _ = self.held(temperature_c, beyond)
        return regressed, self.nominal.u(value, held_c, self.scale.knots_c, nominal_c), outside

    def apply_at_rate(
        self, output: Array, temperature_c: Array, rate_c_per_s: Array, beyond: Beyond = "hold"
    ) -> tuple[Array, NDArray[np.bool_]]:
        """The same with the dynamic model of the bias, and dT/dt (n,); as `apply` without one.

        A rate beyond those of the calibration is out of range, and extrapolated unless rejected. A value is NaN where
        the rate is missing.
        """
        static, outside = self.apply(output, temperature_c, beyond)
        if self.dynamic is None:
            return static, outside
        fast = self.dynamic.is_beyond(rate_c_per_s)
        value = static - self.dynamic_less_static(temperature_c, rate_c_per_s)
        return np.where(fast & (beyond == "reject"), np.nan, value), outside | fast

    def dynamic_less_static(self, temperature_c: Array, rate_c_per_s: Array) -> Array:
        """Bias (n,) of the dynamic model less that of the static one; 0 without a dynamic model."""
        if self.dynamic is None:
            return np.zeros(len(temperature_c))
        held_c, _ = self.held(temperature_c, "hold")
        static = 0.0 if self.bias is None else values_of(self.bias, held_c)
        return np.asarray(self.dynamic.at(held_c, rate_c_per_s) - static)

    def held(self, temperature_c: Array, beyond: Beyond) -> tuple[Array, NDArray[np.bool_]]:
        """Temperatures (n,) at which its curves are taken, and a mask of those out of range: held, or NaN."""
        if self.valid_c is None:
            return temperature_c, np.zeros(len(temperature_c), dtype=np.bool_)
        low_c, high_c = self.valid_c
        outside = (temperature_c < low_c) | (temperature_c > high_c)
        return np.where(outside & (beyond == "reject"), np.nan, np.clip(temperature_c, low_c, high_c)), outside


def _valid_c(curve: Curve) -> tuple[float, float] | None:
    match curve:
        case TemperatureModel():
            return curve.valid_c
        case KnotModel():
            return curve.knots_c[0], curve.knots_c[-1]
        case Constant():
            return None


def values_of(curve: Curve, temperature_c: Array) -> Array:
    """Values (n,) of a curve at temperatures (n,)."""
    match curve:
        case TemperatureModel():
            return curve.at(temperature_c)
        case KnotModel():
            return np.interp(temperature_c, curve.knots_c, curve.values)
        case Constant():
            return np.full_like(temperature_c, curve.value)
