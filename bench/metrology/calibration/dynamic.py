"""Dynamic model of a bias: over the temperature and over its rate, for uses that see fast changes (equations 6.3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.metrology.least_squares import Array
from bench.metrology.results.curves import Constant, TemperatureModel

SECONDS = 60.0  # in a minute: files have rates in °C/min
FASTER = 1.2  # times the fastest rate of the calibration, from which on a rate is beyond it
RATE_FORM = "bias = bias(T) + rate · dT/dt"


@dataclass(frozen=True, slots=True)
class DynamicBias:
    """Bias = `bias`(T) + `rate` · dT/dt, `rate` in g·min/°C, found at rates up to `fastest_c_per_min` either way."""

    bias: TemperatureModel
    rate: Constant
    fastest_c_per_min: float

    def at(self, held_c: Array, rate_c_per_s: Array) -> Array:
        """Bias (n,) at temperatures within the range of the calibration, NaN where a rate is missing."""
        return np.asarray(self.bias.at(held_c) + self.rate.value * SECONDS * rate_c_per_s)

    def is_beyond(self, rate_c_per_s: Array) -> NDArray[np.bool_]:
        """True (n,) for rates clearly faster than those of the calibration."""
        return np.asarray(np.abs(rate_c_per_s) * SECONDS > FASTER * self.fastest_c_per_min)

    def to_json(self) -> dict[str, Any]:
        """Content of an entry of a calibration file."""
        return {
            "form": RATE_FORM,
            "bias": self.bias.to_json(),
            "rate": self.rate.to_json(),
            "fastest_C_per_min": self.fastest_c_per_min,
        }
