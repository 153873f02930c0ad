"""Gates: what lies between consecutive readings of a slow ramp, with its length, output and temperatures."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from bench.metrology.least_squares import Array
from bench.metrology.pulse_counts import RESOLUTION_COUNTS


@dataclass(frozen=True, slots=True)
class Gates:
    """What lies between two consecutive readings, all arrays (n,).

    Its middle and its length in time, the pulses on either line, and the means of both temperatures. Of volts or codes
    their integral over it stands in place of the pulses, and `step_u` is what steps of codes hide from each mean: 0 for
    volts, None where pulses were counted.
    """

    time_s: Array
    seconds: Array
    positive: Array
    negative: Array
    converter_c: Array
    accelerometer_c: Array
    step_u: Array | None = None

    @property
    def rate(self) -> Array:
        """Net pulses in a second, or the mean of volts or codes."""
        return (self.positive - self.negative) / self.seconds

    def rows(self, which: NDArray[np.int_] | NDArray[np.bool_]) -> Gates:
        """A part of the gates, by their numbers or by a mask."""
        columns = {column.name: getattr(self, column.name) for column in fields(self)}
        return replace(self, **{name: values[which] for name, values in columns.items() if values is not None})

    @property
    def resolution(self) -> Array:
        """What a mean rate alone does not resolve, for what it is counted with or for the steps of codes."""
        return RESOLUTION_COUNTS / self.seconds if self.step_u is None else self.step_u
