"""Records of the output of a unit in motion: counts between readings, or samples in volts or codes (equations 2.5).

The net pulses between two readings, over the time between them, are the mean output of that interval: no rate is
sampled, and a fraction of a pulse that one interval lacks is in the next. So quantisation is in a velocity twice, at
the first reading and at the last. A converter with one charge integrator fires a pulse when its charge is a whole one
away from the last: what it holds has the sign of its last pulse, half of one in the mean.

A sample is the mean over the period that ends at its time, so that samples in a row are the whole record; or it is the
output at its time, and between two samples the output is a cubic with their slopes. What a lost sample had is in no
other one: it is taken to be between its neighbours.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bench.metrology.least_squares import SIGMA_PER_MAD, Array

GAP = 1.5  # times the usual interval: readings are missing between two rows
MOST_BRIDGED = 10  # usual intervals without a sample that are bridged; beyond, the motion is unknown
OF_SECOND_DIFFERENCE = 6**0.5  # standard deviations of a value in that of v[i-1] - 2 v[i] + v[i+1]


@dataclass(frozen=True, slots=True)
class CountRecord:
    """Readings of counters and thermometer at increasing times, (n,) each.

    `net_pulses` (n - 1,) of each channel are those between two readings, positive less negative, NaN if unknown.
    Between two readings the temperature is their mean. `own_c` are the temperatures of channels with a thermometer of
    their own.
    """

    time_s: Array
    temperature_c: Array
    net_pulses: Mapping[str, Array]
    own_c: Mapping[str, Array] = field(default_factory=dict)

    def output_c(self, channel: str) -> Array:
        """Temperature (n - 1,) of each output of a channel."""
        read_c = _read_c(self, channel)
        return np.asarray((read_c[1:] + read_c[:-1]) / 2)

    def output(self, channel: str) -> Array:
        """Mean output (n - 1,) of a channel in each interval, in pulse/s."""
        return _charge(self.net_pulses[channel]) / np.diff(self.time_s)

    def mean(self, of_outputs: Array) -> Array:
        """Mean (n - 1,) over each interval of a quantity that was computed from each output."""
        return of_outputs

    def any(self, of_outputs: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Mask (n - 1,) of intervals with a marked output."""
        return of_outputs

    def lost_s(self) -> Array:
        """Time (n - 1,) in each interval of which nothing is known: none, since counters go on."""
        return np.zeros(len(self.time_s) - 1)


@dataclass(frozen=True, slots=True)
class SampleRecord:
    """Samples of outputs at increasing times, and the temperature then, (n,) each; NaN if unknown.

    `own_c` are the temperatures of channels with a thermometer of their own. With `averaged` a sample is the mean over
    the usual interval before its time, else the output at its time.
    """

    time_s: Array
    temperature_c: Array
    samples: Mapping[str, Array]
    averaged: bool
    own_c: Mapping[str, Array] = field(default_factory=dict)

    def output_c(self, channel: str) -> Array:
        """Temperature (n,) of each sample of a channel: of a mean that in the middle of its time."""
        read_c = _read_c(self, channel)
        if not self.averaged:
            return read_c
        return np.asarray((np.concatenate((read_c[:1], read_c[:-1])) + read_c) / 2)

    def output(self, channel: str) -> Array:
        """Samples (n,) of a channel."""
        return self.samples[channel]

    def mean(self, of_outputs: Array) -> Array:
        """Mean (n - 1,) over each interval of a quantity that was computed from each sample, NaN if unknown."""
        seconds, usual_s = np.diff(self.time_s), self._usual_s
        lost_s = self.lost_s()
        between = (of_outputs[:-1] + of_outputs[1:]) / 2
        if self.averaged:
            means = of_outputs[1:] + lost_s / seconds * (between - of_outputs[1:])
        else:
            slopes = np.gradient(of_outputs, self.time_s, edge_order=2 if len(of_outputs) > 2 else 1)
            means = between + np.where(lost_s > 0, 0.0, seconds / 12 * (slopes[:-1] - slopes[1:]))
        return np.where(lost_s > MOST_BRIDGED * usual_s, np.nan, means)

    def any(self, of_outputs: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Mask (n - 1,) of intervals with a marked sample."""
        return of_outputs[1:] if self.averaged else of_outputs[:-1] | of_outputs[1:]

    def lost_s(self) -> Array:
        """Time (n - 1,) in each interval of which nothing is known, as a sample is missing."""
        seconds, usual_s = np.diff(self.time_s), self._usual_s
        return np.where(seconds > GAP * usual_s, seconds - usual_s, 0.0)

    def scatter(self, channel: str) -> float:
        """Standard deviation of the samples of a channel about their neighbours, robust; 0 with fewer than three."""
        bent = np.abs(np.diff(self.samples[channel], 2))
        bent = bent[np.isfinite(bent)]
        return SIGMA_PER_MAD * float(np.median(bent)) / OF_SECOND_DIFFERENCE if len(bent) else 0.0

    @property
    def _usual_s(self) -> float:
        return float(np.median(np.diff(self.time_s)))


Record = CountRecord | SampleRecord


def _read_c(record: Record, channel: str) -> Array:
    """Temperature (n,) of a channel at the times of a record."""
    return record.own_c.get(channel, record.temperature_c)


def _charge(net_pulses: Array) -> Array:
    """Charge (m,) of intervals in pulses: that of the pulses, and half a pulse with the sign of the last at each end.

    An interval without pulses has the sign of the one before it.
    """
    sign = np.sign(net_pulses)
    fired = np.flatnonzero(np.abs(sign) == 1)
    if not len(fired):
        return net_pulses
    last = np.searchsorted(fired, np.arange(len(sign)), side="right") - 1
    at_end = sign[fired[np.maximum(last, 0)]]
    return np.asarray(net_pulses + np.diff(at_end, prepend=at_end[0]) / 2)
