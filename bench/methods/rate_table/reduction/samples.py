"""Samples of an acquisition on a rate table: output of a unit and encoder at common latches.

Pulses, or the ends of the samples of a unit, and encoder are latched together, so that both have one clock. A sample is
the mean over the interval before its time, and both changes in that interval are known without a model.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from bench.methods.rate_table.reduction.blocks import Block
from bench.methods.rate_table.reduction.sampling import Kept, integration
from bench.methods.rate_table.reduction.temperatures import MeanTemperature
from bench.methods.rate_table.reduction.turning_readings import HARMONICS, LEAST_DOF, TurningReadings, table_correlated
from bench.metrology.acquisition import Array, Integers
from bench.metrology.least_squares import LinearFit, NotDetermined, least_squares
from bench.metrology.pulse_counts import RESOLUTION_COUNTS

PARTS = 40  # parts of a block, whose rates give the uncertainty of that of the block
PARTS_DOF = PARTS - 3 - 2 * HARMONICS
BETWEEN_PARTS = 1.5  # variance of a rate over a part, over that of a rate between the means of two
SATURATED = 0.01  # of the samples
# Of the clip level. That is stated to about the error of a scale factor, some parts in 1000: a sensor may be at its end
# a little below it. One that is still linear there counts as saturated too; a range test has no business there. The
# upper bound is wider, because nothing but a glitch is beyond the end of the range.
AT_CLIP = (1 - 2e-3, 1 + 1e-2)
TURN_DEG = 360.0


@dataclass(frozen=True, slots=True)
class Steady:
    """Mean output in its unit and mean table rate in deg/s, with standard uncertainties, type A.

    `dof` are the degrees of freedom of that of the output.
    """

    output: float
    u_output: float
    rate_dps: float
    u_rate_dps: float
    saturated: bool
    dof: int


@dataclass(frozen=True, slots=True)
class TableSamples:
    """Latches of one acquisition, (n,) by time since the first, with cumulative values at each.

    `temperature` is the mean of the thermometer at the unit, not-a-number without a reading. `total` is what its
    output has summed up to: net pulses, or code·s or V·s. `angle_deg` is that of the encoder over whole turns;
    `interval_s` is the time between two latches, `problems` make the acquisition unusable. `behind` is by how
    much the converter's pulses stood behind for its play, which is no longer in `total`. Of samples that came at the
    latches `sampled` is what they leave of a sine, None of what was counted up; `step_of_codes` is how far two codes
    are apart, and `hidden_u` what that hides from a mean. `readings` are those that were taken at other times.
    `rate_u_dps` is the standard uncertainty of the table's rate where `angle_deg` is a line through the angles of an
    encoder of unknown scatter; None where its resolution tells it. `stroke` is the least change of a charge in pulses
    from one reversal of an oscillation to the next, or over a period without any; infinite of other samples.
    """

    step: str
    temperature: MeanTemperature
    time_s: Array
    total: Array
    angle_deg: Array
    latch: Integers
    interval_s: float
    resolution_deg: float
    problems: tuple[str, ...]
    behind: Array | None = None
    sampled: Kept | None = None
    step_of_codes: float = 0.0
    hidden_u: float = 0.0
    readings: TurningReadings | None = None
    rate_u_dps: float | None = None
    stroke: float = np.inf

    def block(self, per_pulse: float) -> Block:
        """Samples as a block: time, the encoder's angle then, and the mean output before, in units of `per_pulse`.

        Samples after a lost latch are left out, since they are means over another interval.
        """
        whole = np.diff(self.latch) == 1
        output = np.diff(self.total) / np.diff(self.time_s) * per_pulse
        return Block(
            self.time_s[1:][whole], self.angle_deg[1:][whole], output[whole], int(np.ptp(self.latch)),
            table_step=self.resolution_deg,
        )  # fmt: skip

    def swing(self, per_pulse: float) -> Block:
        """Best data for the fit of a sine: the samples themselves, or the cumulative counts at each latch."""
        if self.sampled is None:
            return self.summed(per_pulse)
        return replace(self.block(per_pulse), rounding=self.step_of_codes * abs(per_pulse), kept=self.sampled)

    def summed(self, per_pulse: float) -> Block:
        """Cumulative data by latch: time, angle and output; a lost latch does not matter."""
        scheduled = int(np.ptp(self.latch)) + 1
        behind = None if self.behind is None else self.behind * per_pulse
        return Block(
            self.time_s, self.angle_deg, self.total * per_pulse, scheduled, per_pulse, behind, kept=integration,
            table_step=self.resolution_deg,
        )  # fmt: skip

    @property
    def temperature_c(self) -> float:
        """Mean of the thermometer at the unit."""
        return self.temperature.value_c


def summed_up(values: Array, latch: Integers, time_s: Array) -> Array:
    """Cumulative sum of samples (n,) with these numbers; missing ones are interpolated linearly."""
    if not len(latch):
        return values
    filled = np.cumsum(np.interp(np.arange(latch[0], latch[-1] + 1), latch, values))[latch - latch[0]]
    return np.concatenate(([0.0], np.cumsum(np.diff(filled) / np.diff(latch) * np.diff(time_s))))


def steady(samples: TableSamples, per_pulse: float, clip: float | None = None) -> Steady:
    """Mean output and table rate over whole turns, or over all data if there is none (equations 1.7).

    Both are between the same two latches, so that unevenness of the table is common to both. Readings at other times
    are corrected to that rate.
    """
    last = _whole_turns(samples.angle_deg)
    span_s = float(samples.time_s[last])
    rate_dps = float(samples.angle_deg[last]) / span_s
    if samples.readings is not None:
        mean, scatter, dof = samples.readings.at_rate(rate_dps)
        u = float(np.hypot(scatter, samples.hidden_u))
    else:
        mean, (u, dof) = float(samples.total[last]) / span_s, _u_mean(samples, last)
    by_resolution_dps = RESOLUTION_COUNTS * samples.resolution_deg / span_s
    return Steady(
        output=mean * per_pulse,
        u_output=u * abs(per_pulse),
        rate_dps=rate_dps,
        u_rate_dps=by_resolution_dps if samples.rate_u_dps is None else samples.rate_u_dps,
        saturated=clip is not None and is_saturated(samples.block(per_pulse).output, clip),
        dof=dof,
    )


def _u_mean(samples: TableSamples, last: int) -> tuple[float, int]:
    """Of the mean up to a latch, and its degrees of freedom.

    It has the steps of counting at both ends, or of codes, and what its parts scatter by, each sample one where they
    are few. What the parts owe to the table, which turns a little unevenly and takes the sensor through gravity, is no
    scatter.
    """
    few = last < PARTS
    edges = np.arange(last + 2) if few else np.linspace(0, last, PARTS + 1).astype(np.int64)
    fit = _fitted(_between_parts(samples.total, samples, edges), _owed_to_the_table(samples, edges))
    scatter = fit.residual_sd * np.sqrt(1 / last if few else BETWEEN_PARTS / PARTS)
    steps = RESOLUTION_COUNTS / samples.time_s[last] if samples.sampled is None else samples.hidden_u
    return float(np.hypot(scatter, steps)), min(fit.dof, PARTS_DOF)


def _between_parts(cumulative: Array, samples: TableSamples, edges: Integers) -> Array:
    """Rate of something cumulative (n,) from the mean over each part to that over the next.

    Counting errors average out in the means. For white noise such a rate has 2/3 of the variance of the rate over a
    part.
    """
    centre_s, centre = (
        np.add.reduceat(values[: edges[-1]], edges[:-1]) / np.diff(edges) for values in (samples.time_s, cumulative)
    )
    return np.asarray(np.diff(centre) / np.diff(centre_s))


def _owed_to_the_table(samples: TableSamples, edges: Integers) -> Iterator[list[Array]]:
    """Of the same parts: the table's rate, and harmonics of the angle, summed up as the output is."""
    angle = np.radians(samples.angle_deg)
    table_dps = _between_parts(samples.angle_deg, samples, edges)

    def cumulative(values: Array) -> Array:
        return np.cumsum(values) if samples.sampled is None else summed_up(values, samples.latch, samples.time_s)

    waves = [
        _between_parts(cumulative(wave(order * angle)), samples, edges)
        for order in range(1, HARMONICS + 1)
        for wave in (np.cos, np.sin)
    ]
    return table_correlated(table_dps - np.mean(table_dps), waves)


def _fitted(values: Array, designs: Iterable[list[Array]]) -> LinearFit:
    """Fit of the first design whose coefficients the values (n,) determine with degrees of freedom left."""
    for columns in designs:
        with suppress(NotDetermined):
            fit = least_squares(np.column_stack(columns), values)
            if fit.dof >= LEAST_DOF or len(columns) == 1:
                return fit
    raise ValueError("a mean is always determined")


def harmonics_u_dps(samples: TableSamples, harmonics_u_deg: tuple[float, ...]) -> float:
    """Effect of encoder errors over a turn on the rate of `steady`: zero over whole turns.

    Harmonic n differs between angles θ apart by up to 2 sin(nθ/2) of its amplitude.
    """
    last = _whole_turns(samples.angle_deg)
    turned = np.radians(samples.angle_deg[last])
    parts = [2 * np.sin(order * turned / 2) * u for order, u in enumerate(harmonics_u_deg, start=1)]
    return float(np.linalg.norm(parts) / samples.time_s[last])


def _whole_turns(angle_deg: Array) -> int:
    """Latch nearest to the largest number of whole turns after the first; the last one without a whole turn."""
    turned = np.abs(angle_deg - angle_deg[0])
    turns = np.floor(turned[-1] / TURN_DEG)
    return int(np.argmin(np.abs(turned - turns * TURN_DEG))) if turns else len(angle_deg) - 1


def is_saturated(output: Array, clip: float) -> bool:
    """True if more than a few samples (n,) are at a clip level, of either sign."""
    low, high = AT_CLIP
    return bool(np.mean((np.abs(output) >= low * clip) & (np.abs(output) <= high * clip)) > SATURATED)


def mean_c(temperatures_c: Sequence[float]) -> float | None:
    """Mean of the known temperatures; None without one."""
    known = [each for each in temperatures_c if np.isfinite(each)]
    return float(np.mean(known)) if known else None
