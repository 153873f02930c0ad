"""What an output regressed to the nominal temperature T_N needs beside the curves of a channel (equations 4.5).

output_N = v scale(T_N) + offset(T_N),   v = (output - offset(T)) / scale(T)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.metrology.least_squares import Array

FORM = "output_N = v · scale(T_N) + offset(T_N), v = (output - offset(T)) / scale(T)"


@dataclass(frozen=True, slots=True)
class NominalOutput:
    """Nominal temperature, and standard uncertainties of offset and scale factor at T less those at T_N.

    `offset_u` and `scale_u` (k,) are due to the readings at each knot, in the units of the curves; `offset_beside_u`
    and `scale_beside_u` to what differs from one visit of a temperature to another, and between knots. An error that
    the calibration has at all temperatures cancels.
    """

    at_c: float
    offset_u: tuple[float, ...] = ()
    scale_u: tuple[float, ...] = ()
    offset_beside_u: float = 0.0
    scale_beside_u: float = 0.0

    def u(self, value: Array, temperature_c: Array, knots_c: tuple[float, ...], nominal_c: float) -> Array:
        """Standard uncertainties (n,) of outputs regressed to `nominal_c`, for values v at temperatures (n,)."""
        zero = np.full(len(value), self.offset_beside_u**2)
        scale = np.full(len(value), self.scale_beside_u**2)
        for knot, offset_u, scale_u in zip(np.eye(len(knots_c)), self.offset_u, self.scale_u, strict=True):
            share = np.interp(temperature_c, knots_c, knot) - np.interp(nominal_c, knots_c, knot)
            zero += (share * offset_u) ** 2
            scale += (share * scale_u) ** 2
        return np.asarray(np.sqrt(zero + value**2 * scale))

    def to_json(self) -> dict[str, Any]:
        """Content of a calibration file."""
        return {
            "form": FORM,
            "at_c": self.at_c,
            "offset_u": list(self.offset_u),
            "scale_u": list(self.scale_u),
            "offset_beside_u": self.offset_beside_u,
            "scale_beside_u": self.scale_beside_u,
        }
