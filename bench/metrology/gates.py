"""Gates: intervals between consecutive readings of a slow ramp, with duration, output and temperatures."""

from __future__ import annotations

from dataclasses import dataclass

from bench.metrology.least_squares import Array
from bench.metrology.pulse_counts import RESOLUTION_COUNTS
from bench.metrology.rows import Rows


@dataclass(frozen=True, slots=True)
class Gates(Rows):
    """Intervals between consecutive readings, all arrays (n,).

    Mid-time and duration, the pulses on either line, and the means of both temperatures. For volts or codes their
    integral replaces the pulses, and `quantisation_u` is the quantisation uncertainty of each mean: 0 for volts, None
    for counted pulses.
    """

    time_s: Array
    seconds: Array
    positive: Array
    negative: Array
    converter_c: Array
    accelerometer_c: Array
    quantisation_u: Array | None = None

    @property
    def rate(self) -> Array:
        """Net pulses per second, or the mean of volts or codes."""
        return (self.positive - self.negative) / self.seconds

    @property
    def resolution(self) -> Array:
        """Resolution of a mean rate, by counting or by quantisation of codes."""
        return RESOLUTION_COUNTS / self.seconds if self.quantisation_u is None else self.quantisation_u
