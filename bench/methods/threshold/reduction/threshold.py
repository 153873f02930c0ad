"""Threshold and resolution: the smallest change of input that the output follows (equations 6.7, after IEEE 1293).

The threshold is the largest, over both senses, of the smallest input steps from a reference position whose output
change is at least half of what the nominal scale factor lets expect. About a biased input the same is the resolution.
The definition is silent on repeats and chance; here:

* A step passes when the mean of its repeats does. That all of them pass would ask more of a step the oftener it is
  repeated.
* The smallest step of a sense is the one above the largest that fails. A smaller one that passes is chance or a head
  that was not where it said, and flagged `not_monotonic`.
* Every step is held against the line between the readings at the reference position before and after it, so that a
  drift of the zero is no output change, nor an input step that the head did not make. What drifts within the time
  between them in another way than straight stays.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from math import inf, isfinite, nan, sqrt
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bench.metrology.least_squares import Array
from bench.metrology.results.coverage import coverage_factor
from bench.metrology.rows import Rows

PASSING_SHARE = 0.5  # of the expected output change
COUNT_SHARE = 0.2  # of a step: maximum size of one count
Relation = Literal["equal", "at_most", "more_than"]


@dataclass(frozen=True, slots=True)
class LadderRecord(Rows):
    """The readings of one ladder, in any order, arrays (n,); a missing number is NaN.

    `time_s` is the middle of a reading. `step` is the step commanded, with its sense, the same number for all repeats;
    0 at the reference position. `input_g` is the sine of the angle that was read back, `output_g` the net pulse rate
    over the nominal scale factor. `u_g`, above 0, is the standard uncertainty of one reading from errors independent
    between readings: noise, count, repeatability of the head. `count_g` is the size of one count: 1 / (pulse/s/g x
    dwell in s).
    """

    time_s: Array
    step: Array
    input_g: Array
    output_g: Array
    u_g: Array
    count_g: Array


@dataclass(frozen=True, slots=True)
class LadderStep:
    """One step, the mean of its repeats: changes of input and output in g, with their sense, and their ratio.

    `dof` are the degrees of freedom of `u_ratio`, None for unlimited. `too_short` is true if one count is not below a
    fifth of the step.
    """

    input_g: float
    output_g: float
    ratio: float
    u_ratio: float
    dof: int | None
    repeats: int
    too_short: bool

    @property
    def passed(self) -> bool:
        """True if the output changed by at least half of the expected change."""
        return self.ratio >= PASSING_SHARE

    @property
    def marginal(self) -> bool:
        """True if a repeated step might give another result: one half is within its expanded uncertainty."""
        return abs(self.ratio - PASSING_SHARE) < coverage_factor(self.dof) * self.u_ratio

    @property
    def size_g(self) -> float:
        """Magnitude of the input step."""
        return abs(self.input_g)

    @property
    def u_output_g(self) -> float:
        """Standard uncertainty of the output change."""
        return self.u_ratio * self.size_g


@dataclass(frozen=True, slots=True)
class Threshold:
    """The ladder by rising input, and the interval of the threshold: above `low_g`, up to `high_g`.

    `low_g` is 0 if no step failed; `high_g` is infinite if the largest did. `excess` is the ratio of the scatter of
    repeats to their uncertainties, with `dof` degrees of freedom: above 1 it multiplies the uncertainties; NaN without
    repeats. `left_out` readings are missing, or not between two at the reference position. Flags: one_sense,
    not_monotonic, too_short (some step), marginal (one of the steps that decide).
    """

    steps: tuple[LadderStep, ...]
    low_g: float
    high_g: float
    u_noise_g: float
    excess: float
    dof: int
    flags: tuple[str, ...]
    left_out: int

    @property
    def threshold_g(self) -> float:
        """Smallest step that passes, as the threshold is defined; NaN if the largest failed."""
        return self.high_g if isfinite(self.high_g) else nan

    @property
    def relation(self) -> Relation:
        """Relation of the threshold to `threshold_g`; "more_than" to `low_g`."""
        if not isfinite(self.high_g):
            return "more_than"
        return "equal" if self.low_g else "at_most"

    @property
    def u_ladder_g(self) -> float:
        """Type B standard uncertainty: the unit begins to follow between the two steps; NaN if the largest failed.

        `threshold_g` is the upper end: the root-mean-square distance of a uniform distribution from its end is width /
        √3.
        """
        return (self.threshold_g - self.low_g) / sqrt(3)


def find_threshold(record: LadderRecord) -> Threshold:
    """Threshold, or about a biased input the resolution, from a ladder of steps of both senses.

    A single sense is used for both, and flagged; without any step nothing is known: more than 0.
    """
    changes = _changes(record)
    excess, dof = changes.excess()
    steps = changes.steps(excess, dof) if excess > 1 else changes.steps(1.0, None)
    senses = [[step for step in steps if step.input_g * sense > 0] for sense in (-1, 1)]
    low_g, high_g = (max(ends) for ends in zip(*(_interval(sense) for sense in senses), strict=True))
    deciding = [step for step in steps if step.size_g in (low_g, high_g)]
    raised = {
        "one_sense": bool(steps) and not all(senses),
        "not_monotonic": any(_passes_below(sense) for sense in senses),
        "too_short": any(step.too_short for step in steps),
        "marginal": any(step.marginal for step in deciding),
    }
    return Threshold(
        steps=steps,
        low_g=low_g,
        high_g=high_g if steps else inf,
        # Above a dead band the output approaches half of the input by half of every g that is added.
        u_noise_g=max((step.u_output_g for step in deciding), default=nan) / (1 - PASSING_SHARE),
        excess=excess,
        dof=dof,
        flags=tuple(flag for flag, is_raised in raised.items() if is_raised),
        left_out=len(record.step) - changes.readings,
    )


def _interval(steps: Sequence[LadderStep]) -> tuple[float, float]:
    """Largest step of one sense that failed and the next larger one; both 0 if there is none."""
    low_g = max((step.size_g for step in steps if not step.passed), default=0.0)
    return low_g, min((step.size_g for step in steps if step.size_g > low_g), default=inf if steps else 0.0)


def _passes_below(steps: Sequence[LadderStep]) -> bool:
    """True if a step of one sense passed below one that failed."""
    low_g, _ = _interval(steps)
    return any(step.passed and step.size_g < low_g for step in steps)


@dataclass(frozen=True, slots=True)
class _Changes:
    """Every step that was made, (m,), relative to the reference readings around it; `readings` is the number used."""

    step: Array
    input_g: Array
    output_g: Array
    covariance: Array  # (m, m), of `output_g`: neighbours share a reading
    count_g: Array
    readings: int

    def excess(self) -> tuple[float, int]:
        """Ratio of the scatter of the repeats to that expected, pooled over all steps, and its degrees of freedom."""
        squares, dof = 0.0, 0
        for rows, ratio in self._repeats():
            covariance = self.covariance[np.ix_(rows, rows)]
            expected = float(np.trace(covariance) - np.sum(covariance) / len(rows))
            scatter = self.output_g[rows] - ratio * self.input_g[rows]
            if len(rows) > 1:
                squares += (len(rows) - 1) * float(np.sum(scatter**2)) / expected
                dof += len(rows) - 1
        return (sqrt(squares / dof), dof) if dof else (nan, 0)

    def steps(self, excess: float, dof: int | None) -> tuple[LadderStep, ...]:
        """Means of the repeats, by rising input; uncertainties times `excess`, with its degrees of freedom."""
        steps = []
        for rows, ratio in self._repeats():
            input_g = float(np.mean(self.input_g[rows]))
            u_output_g = excess * float(np.sqrt(np.sum(self.covariance[np.ix_(rows, rows)]))) / len(rows)
            steps.append(LadderStep(
                input_g=input_g,
                output_g=float(np.mean(self.output_g[rows])),
                ratio=ratio,
                u_ratio=u_output_g / abs(input_g),
                dof=dof,
                repeats=len(rows),
                too_short=bool(np.max(self.count_g[rows]) >= COUNT_SHARE * abs(input_g)),
            ))  # fmt: skip
        return tuple(sorted(steps, key=lambda step: step.input_g))

    def _repeats(self) -> Iterator[tuple[NDArray[np.int_], float]]:
        """Rows of each step and its ratio of output to input; a step without any input is left out."""
        for step in np.unique(self.step):
            rows = np.flatnonzero(self.step == step)
            input_g = float(np.mean(self.input_g[rows]))
            if input_g:
                yield rows, float(np.mean(self.output_g[rows])) / input_g


def _changes(record: LadderRecord) -> _Changes:
    """Steps minus the straight line between the nearest readings at the reference position before and after."""
    present = [np.isfinite(getattr(record, column.name)) for column in fields(record)]
    record = record.rows(np.flatnonzero(np.all(present, axis=0)))
    record = record.rows(np.unique(record.time_s, return_index=True)[1])
    reference, moved = np.flatnonzero(record.step == 0), np.flatnonzero(record.step)
    place = np.searchsorted(reference, moved)
    between = (place > 0) & (place < len(reference))
    moved, before, after = moved[between], reference[place[between] - 1], reference[place[between]]
    part = (record.time_s[moved] - record.time_s[before]) / (record.time_s[after] - record.time_s[before])
    gain = np.zeros((len(moved), len(record.time_s)))
    for rows, weight in ((moved, 1.0), (before, part - 1), (after, -part)):
        gain[np.arange(len(moved)), rows] = weight
    return _Changes(
        step=record.step[moved],
        input_g=gain @ record.input_g,
        output_g=gain @ record.output_g,
        covariance=gain * record.u_g**2 @ gain.T,
        count_g=np.max(np.where(gain != 0, record.count_g, 0.0), axis=1, initial=0.0),
        readings=int(np.sum(gain.any(axis=0))),
    )
