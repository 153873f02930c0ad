"""What an output regressed to the nominal temperature T_N needs beside the curves of a channel (equations 4.5).

output_N = v scale(T_N) + offset(T_N),   v = (output - offset(T)) / scale(T)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

FORM = "output_N = v · scale(T_N) + offset(T_N), v = (output - offset(T)) / scale(T)"


@dataclass(frozen=True, slots=True)
class NominalOutput:
    """Nominal temperature, and standard uncertainties of differences of offset and scale factor from it.

    `offset_u` is in the unit of the output, `scale_u` relative. They contain the scatter of the readings, the
    differences of visits, and the errors between knots, but no error that the calibration has at all temperatures.
    """

    at_c: float
    offset_u: float
    scale_u: float

    def to_json(self) -> dict[str, Any]:
        """Content of a calibration file."""
        return {"form": FORM, "at_c": self.at_c, "offset_u": self.offset_u, "scale_u": self.scale_u}
