"""What the specific force of a record needs beside the curves of a channel over temperature.

    x = v + quadratic · (v² - 1) + sum of cross[b] · v_b

x is (output - offset(T)) / scale(T) - bias(T), v the specific force along the axis and v_b that along another axis of
the unit, in g. Zero and scale factor were found at 1 g of either sign, where the quadratic term is zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from bench.metrology.results.curves import Constant

FORM = "x = v + quadratic · (v² - 1) + sum of cross[b] · v_b, x = (output - offset(T)) / scale(T) - bias(T)"

Sample = Literal["", "mean", "instant"]


@dataclass(frozen=True, slots=True)
class ForceTerms:
    """Quadratic term in g/g², sensitivity to the other axes by their channels, and how the errors are correlated.

    `correlation` is that of the coefficients of scale, offset and bias in their order, and of the quadratic term.
    Without one the errors of scale, offset and bias are independent, each of them one error with the `u` of its curve
    at all temperatures. `bias_u_g` and `scale_u` (relative) are standard uncertainties of the curves beside the `u` of
    their coefficients: between knots, and from one visit of a temperature to another. `valid_g` are the specific forces
    of the calibration. `sample` is what one output of a record is: "" for counts, else the mean over the period that
    ends at its time, or the output then; `step` is the quantisation step of a sample in the unit of the output.
    """

    quadratic: Constant
    valid_g: tuple[float, float]
    cross: Mapping[str, Constant] = field(default_factory=dict)
    correlation: tuple[tuple[float, ...], ...] = ()
    bias_u_g: float = 0.0
    scale_u: float = 0.0
    sample: Sample = ""
    step: float = 0.0

    def to_json(self) -> dict[str, Any]:
        """Content of a calibration file."""
        return {
            "form": FORM,
            "quadratic": asdict(self.quadratic),
            "cross": {channel: asdict(each) for channel, each in self.cross.items()},
            "correlation": [list(row) for row in self.correlation],
            "bias_u_g": self.bias_u_g,
            "scale_u": self.scale_u,
            "valid_g": list(self.valid_g),
            **({"sample": self.sample, "step": self.step} if self.sample else {}),
        }
