"""Amplitude and phase of a sinusoidal input from the output of a sensor of known response (equations 5.3 and 5.5)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.metrology.calibration.second_order import FORM as RESPONSE_FORM
from bench.metrology.calibration.second_order import NAMES, second_order
from bench.metrology.calibration.temperature import Beyond
from bench.metrology.least_squares import Array
from bench.metrology.results.curves import Constant, Equation

FORM = "amplitude = output / |scale| / |H(f)|, phase = phase of the output - arg(scale · H(f))"


@dataclass(frozen=True, slots=True)
class ResponseCompensation:
    """Compensation of one channel at the frequencies `valid_hz`, by the constants K, f0, damping and delay of H(f).

    `correlation` is that of the constants in the order of NAMES; `found_at_c` is for people.
    """

    channel: str
    output_unit: str
    value_unit: str
    scale: Constant
    constants: Mapping[str, Constant]
    valid_hz: tuple[float, float]
    correlation: tuple[tuple[float, ...], ...] = ()
    found_at_c: float | None = None

    @classmethod
    def of_model(
        cls, model: Equation, channel: str, units: tuple[str, str], scale: Constant, found_at_c: float | None
    ) -> ResponseCompensation:
        """The compensation by a fitted response; `units` are those of the output and of the value."""
        valid_hz = model.valid["frequency_hz"]
        return cls(channel, *units, scale, model.constants, valid_hz, model.correlation, found_at_c)

    def to_json(self) -> dict[str, Any]:
        """Content of a calibration file."""
        return {
            "channel": self.channel,
            "output": self.output_unit,
            "value": self.value_unit,
            "form": FORM,
            "scale": self.scale.to_json(),
            "response": {
                "form": RESPONSE_FORM,
                **{name: asdict(each) for name, each in self.constants.items()},
                "correlation": [list(row) for row in self.correlation],
                "valid_hz": list(self.valid_hz),
            },
            **({"found_at_c": self.found_at_c} if self.found_at_c is not None else {}),
        }

    def apply(
        self, amplitude: Array, phase_deg: Array, frequency_hz: Array, beyond: Beyond = "hold"
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Amplitudes and phases (n,) of the input, and a mask of frequencies beyond those at which H is known.

        There the equation is extrapolated, or amplitude and phase are NaN.
        """
        low_hz, high_hz = self.valid_hz
        outside = (frequency_hz < low_hz) | (frequency_hz > high_hz)
        used_hz = np.where(outside & (beyond == "reject"), np.nan, frequency_hz)
        with np.errstate(invalid="ignore"):  # not-a-number for a missing frequency, and for its results
            response = second_order(used_hz, *(self.constants[name].value for name in NAMES))
        of_output = self.scale.value * response
        return amplitude / np.abs(of_output), phase_deg - np.degrees(np.angle(of_output)), outside
