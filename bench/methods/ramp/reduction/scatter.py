"""Uncertainty from scatter of the slope of a straight line over temperature, from the samples of a ramp.

Adjacent samples share a latch: a count that one has too many, the next has too few, and a slope contains little more
than the counting error at the ends of the legs. This part is computed from the latches. The rest is estimated from slow
waves, as for the line of a channel (`channel_scatter`), in the differences between consecutive cycles: effects that
repeat in every cycle, such as the lag after a turn of the ramp, are no scatter.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.methods.ramp.reduction.samples import RampLeg
from bench.metrology.gate_scatter import (
    LEAST_GATES,
    SMOOTH_DEGREE,
    WAVES_DEGREE,
    excess,
    own_scatter,
    unresolved_u,
)
from bench.metrology.gates import Gates
from bench.metrology.least_squares import Array, fit_polynomial

COUNT_STRIDE = 2  # neighbours share a latch, and therefore the counting error
PULSES_U = 1 / np.sqrt(6)  # standard deviation of the difference of two fractions of a pulse
HIDDEN = 0.5  # of the resolution: less scatter is not believed
TURN_SHARE = 0.2  # share of a leg left out: the ramp has just turned, or begun from rest


def resolution_u(legs: Sequence[RampLeg]) -> float:
    """Standard uncertainty of a rate by the fractions of a pulse at both ends of a sample; 0 if not counted."""
    counted = [leg.seconds[leg.seconds > 0] for leg in legs if leg.counted]
    return max((PULSES_U / float(np.median(seconds)) for seconds in counted if len(seconds)), default=0.0)


def shown_scatter(found: float, resolution: float) -> float:
    """Standard deviation of samples from their second differences, or their resolution if these hide it.

    The second differences of counts are 0 if the rate is close to a whole number of pulses in a sample.
    """
    return resolution if found < HIDDEN * resolution else found


class SlopeScatter(NamedTuple):
    """Standard uncertainties of a slope, in the unit of the output per °C: from counting, and from additional scatter.

    The latter has `dof` degrees of freedom.
    """

    counted: float
    own: float
    dof: int

    def together(self, other: SlopeScatter) -> SlopeScatter:
        """Uncertainties of the difference of two slopes."""
        own = float(np.hypot(self.own, other.own))
        return SlopeScatter(float(np.hypot(self.counted, other.counted)), own, min(self.dof, other.dof))


def slope_scatter(legs: Sequence[RampLeg]) -> SlopeScatter | None:
    """Uncertainties of the slope of one line through the samples of all legs; None if these are too short."""
    temperatures_c = [leg.temperature_c[_usable(leg)] for leg in legs]
    if not legs:
        return None
    centre_c = float(np.mean(np.concatenate(temperatures_c)))
    spread = sum(float(np.sum((each - centre_c) ** 2)) for each in temperatures_c)
    return sum_scatter(legs, [(each - centre_c) / spread for each in temperatures_c])


def sum_scatter(legs: Sequence[RampLeg], gains: Sequence[Array]) -> SlopeScatter | None:
    """Uncertainties of the sum of the usable samples of all legs, each times its gain, (n,) by leg; None as above."""
    parts = [_gates(leg) for leg in legs]
    if not parts or min(len(part.seconds) for part in parts) < LEAST_GATES:
        return None
    counted = [unresolved_u(gain[np.newaxis], part) for gain, part in zip(gains, parts, strict=True)]
    own = list(_between_cycles(legs, parts)) or [own_scatter(_departures(part), part) for part in parts]
    return SlopeScatter(
        counted=float(np.sqrt(sum(float(np.sum(each**2)) for each in counted))),
        own=float(np.sqrt(np.mean(np.square(own)) * sum(float(np.sum(gain**2)) for gain in gains))),
        dof=(WAVES_DEGREE - SMOOTH_DEGREE) * len(own),
    )


def _between_cycles(legs: Sequence[RampLeg], parts: Sequence[Gates]) -> Iterator[float]:
    """Standard deviation of a sample in the difference of each leg, with its part, from that of the cycle before."""
    in_order = sorted(zip(legs, parts, strict=True), key=lambda pair: pair[0].cycle)
    for direction in (1, -1):
        for before, after in pairwise(part for leg, part in in_order if leg.direction == direction):
            samples = min(len(before.seconds), len(after.seconds))
            rows = np.arange(int(TURN_SHARE * samples), samples)
            change = _departures(after.rows(rows)) - _departures(before.rows(rows))
            yield excess(change / np.sqrt(2), after.rows(rows))


def _departures(part: Gates) -> Array:
    """Deviations of the outputs of a leg from a smooth curve over the temperature."""
    return fit_polynomial(part.converter_c, part.rate, SMOOTH_DEGREE).residuals


def _usable(leg: RampLeg) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(leg.output) & np.isfinite(leg.temperature_c))


def _gates(leg: RampLeg) -> Gates:
    """Usable samples of a leg, with their temperature in place of the converter's."""
    usable = _usable(leg)
    seconds, temperature_c = leg.seconds[usable], leg.temperature_c[usable]
    nothing = np.zeros(len(seconds))
    return Gates(
        time_s=leg.time_s[usable],
        seconds=seconds,
        positive=leg.output[usable] * seconds,
        negative=nothing,
        converter_c=temperature_c,
        accelerometer_c=np.full(len(seconds), np.nan),
        quantisation_u=None if leg.counted else nothing,
    )
