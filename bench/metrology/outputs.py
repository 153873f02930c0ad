"""Output of a unit over an acquisition, by any instrument: a pulse rate, or the mean of voltages or codes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from bench.metrology.acquisition import (
    Acquisition,
    Array,
    ClockReading,
    Codes,
    Counts,
    Integers,
    Output,
    Turned,
    Voltages,
    Window,
)
from bench.metrology.pulse_counts import LEAST_SHARE, RESOLUTION_COUNTS, Rate, mean_rate, mean_rates, since_first
from bench.metrology.sampled_codes import (
    FEWEST_CODES,
    has_restarted,
    host_per_device,
    mean_between,
    mean_code,
    sampled_at_s,
    stuck,
)

if TYPE_CHECKING:  # a run starts without loading what only its results need
    from bench.metrology.calibration.force_terms import Sample
    from bench.metrology.run_data import RunData, UnitUnderTest

FEWEST_VOLTAGES = 2  # minimum number for a standard deviation
NO_VOLTAGES = Voltages(np.empty(0), np.empty(0))
NO_CODES = Codes(
    np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0), np.empty(0), 1, 1.0, 1.0, lost=0, dropped=0, invalid=0
)
AT_BEGIN, AT_ENDS = 301, 1500  # number of latches at each place whose clock is compared with that of the host
STABLE_PART_S = 10.0  # duration of compared means (equations 3.2)


Measured = Counts | Voltages | Codes


def measured(acquisition: Acquisition, unit: UnitUnderTest) -> Measured:
    """Raw data of a unit during an acquisition."""
    if unit.telemetry is not None:
        return acquisition.codes.get(unit.telemetry, NO_CODES)
    if unit.voltmeter is not None:
        return acquisition.voltages.get(unit.voltmeter, NO_VOLTAGES)
    return acquisition.counts[unit.channel]


def sampled_as(data: RunData, unit: UnitUnderTest) -> tuple[Sample, float]:
    """Kind of the samples of a unit in a run, and their quantisation step in its unit; the step of volts is unknown.

    The readings of a voltmeter have the times of their middles.
    """
    match measured(data.acquisitions[0], unit):
        case Counts():
            return "", 0.0
        case Voltages():
            return "instant", 0.0
        case Codes() as codes:
            return ("mean" if codes.averaged else "instant"), codes.step


def mean_output(acquisition: Acquisition, unit: UnitUnderTest) -> Output:
    """Mean output of a unit, in its unit; NaN if nothing was measured.

    Problems: those of `mean_rate` and `mean_code`, too_few_voltages, and unstable if the output did not become stable
    as required.
    """
    found = measured(acquisition, unit)
    output = mean_of(found if acquisition.over_s is None else _last(found, acquisition.over_s))
    if acquisition.stable is None or unit.place in acquisition.stable:
        return output
    return output._replace(problems=(*output.problems, "unstable"))


def mean_of(found: Measured) -> Output:
    """Mean of raw data; problems as in `mean_output`."""
    match found:
        case Counts():
            rate = mean_rate(found)
            return Output(rate.net_pps, _resolution_pps(rate), rate.problems)
        case Voltages():
            return _mean_voltage(found)
        case Codes():
            return mean_code(found)


def _resolution_pps(rate: Rate) -> float:
    """Resolution of a rate by counting; NaN without a time between latches."""
    return RESOLUTION_COUNTS / rate.span_s if rate.span_s else float("nan")


def _mean_voltage(read: Voltages) -> Output:
    if len(read.values_v) < FEWEST_VOLTAGES:
        return Output(float("nan"), float("nan"), ("too_few_voltages",))
    scatter_v = float(np.std(read.values_v, ddof=1) / np.sqrt(len(read.values_v)))
    return Output(float(np.mean(read.values_v)), scatter_v, ())


def windows_of(channels: Mapping[str, Counts | Codes], turned: Turned | None = None) -> dict[str, Window]:
    """Mean of each channel, and its duration.

    During a rotation, samples are used between the first and the last detected standstill of the table, by their times.
    A common delay of the samples shifts both ends alike: whole turns remain whole.
    """
    counted = {channel: found for channel, found in channels.items() if isinstance(found, Counts)}
    rates = mean_rates(counted)
    clocks = {id(each.tick): channel for channel, each in counted.items()}  # channels of one counter share its clock
    compared = {
        clock: _compared(counted[channel], rates[channel].span_s, has_turned=turned is not None)
        for clock, channel in clocks.items()
    }
    windows = {channel: _counted(rates[channel], *compared[id(each.tick)]) for channel, each in counted.items()}
    sent = {channel: _sent(found, turned) for channel, found in channels.items() if isinstance(found, Codes)}
    return windows | sent


def _compared(counts: Counts, span_s: float, *, has_turned: bool) -> tuple[float, ClockReading | None]:
    """Seconds of the host's clock per second of the counter's, and a reading of the counter's clock.

    The ratio is 1 if the table has not turned. 1 and None if the clock of the counter does not advance.
    """
    if not span_s > 0:
        return 1.0, None
    first = slice(AT_BEGIN)
    late_s = counts.host_s[first] - _since_first_s(counts, first)
    late_s.sort()
    began_s = float(late_s[len(late_s) // 2])
    wraps_s, number = (1 << counts.tick_bits) * counts.tick_period_s, len(counts.tick)
    reading = ClockReading(float(counts.tick[0]) * counts.tick_period_s, wraps_s, began_s)
    if not has_turned:
        return 1.0, reading
    takes_all = number <= 2 * AT_ENDS or span_s >= wraps_s  # a wrap between the two ends would not be seen
    rows = slice(None) if takes_all else np.r_[:AT_ENDS, number - AT_ENDS : number]  # all would take half as long again
    return host_per_device(_since_first_s(counts, rows), counts.host_s[rows]), reading


def _since_first_s(counts: Counts, rows: slice | Integers) -> Array:
    """Times of some latches (n,) by the counter's clock, since the first of them."""
    return np.asarray(since_first(counts.tick[rows], counts.tick_bits) * counts.tick_period_s, np.float64)


def _counted(rate: Rate, host_per_counter: float, clock: ClockReading | None) -> Window:
    host_span_s, resolution_pps = host_per_counter * rate.span_s, _resolution_pps(rate)
    return Window(rate.net_pps, rate.span_s, host_span_s, rate.problems, resolution_pps, clock=clock)


def _sent(codes: Codes, turned: Turned | None) -> Window:
    if turned is not None:
        mean, span_s = mean_between(codes, turned.from_s, turned.to_s), turned.to_s - turned.from_s
    else:
        mean, at_s = mean_code(codes), sampled_at_s(codes)
        span_s = float(at_s[-1] - at_s[0]) if len(at_s) else 0.0
    return Window(mean.value, span_s, span_s, mean.problems, mean.single_u, mean.quantisation_u)


def _last(found: Measured, span_s: float) -> Measured:
    """Raw data of the last `span_s`."""
    at_s = _times(found)
    first = int(np.searchsorted(at_s, at_s[-1] - span_s - 1e-6)) if len(at_s) else 0
    if isinstance(found, Voltages):
        return Voltages(found.at_s[first:], found.values_v[first:])
    if not first:
        return found
    return found.part(first) if isinstance(found, Codes) else found.part(first, len(at_s) - 1)


def _times(found: Measured) -> Array:
    match found:
        case Counts():
            return found.host_s
        case Voltages():
            return found.at_s
        case Codes():
            return sampled_at_s(found)


# Parts of raw data


def outputs_between(found: Measured, edges_s: Array) -> tuple[Array, Array, Counter[str]]:
    """Mean outputs between consecutive edges: the edges used, the outputs, and the number of each problem.

    An output is NaN if it has a problem; samples of a unit that has restarted have no reliable times. A rate goes from
    the first latch after an edge to the first after the next, so that consecutive rates share a latch and nothing is
    lost between them; edges without one are left out.
    """
    if isinstance(found, Voltages):
        output = means_between(found.at_s, found.values_v, edges_s)
        return edges_s, output, Counter(too_few_voltages=int(np.count_nonzero(np.isnan(output))))
    if isinstance(found, Codes):
        output = _means_of_codes(found, edges_s)
        problem = "irregular_clock" if has_restarted(found) else "too_few_codes"
        return edges_s, output, Counter({problem: int(np.count_nonzero(np.isnan(output)))})
    latches = np.searchsorted(found.host_s, edges_s)
    latches = latches[latches < len(found.host_s)]
    rates = [mean_rate(found.part(first, last)) for first, last in pairwise(latches.tolist())]
    problems = Counter(problem for rate in rates for problem in rate.problems)
    return found.host_s[latches], np.array([np.nan if rate.problems else rate.net_pps for rate in rates]), problems


def _means_of_codes(found: Codes, edges_s: Array) -> Array:
    """Means of samples between edges; the required share of samples is that of a whole acquisition."""
    if len(found.values) < FEWEST_CODES or has_restarted(found):
        return np.full(max(len(edges_s) - 1, 0), np.nan)
    at_s, usable = sampled_at_s(found), ~stuck(found)
    usual_s = float(np.median(np.diff(at_s) / np.diff(found.sequence)))
    came = np.diff(np.searchsorted(at_s[usable], edges_s))
    means = means_between(at_s[usable], found.values[usable], edges_s)
    return np.where(came < LEAST_SHARE * np.diff(edges_s) / usual_s, np.nan, means)


def means_between(at_s: Array, values: Array, edges_s: Array) -> Array:
    """Mean over time of the values between consecutive edges; not-a-number if there is none.

    The values change in between, so that the times of the readings matter.
    """
    known = np.isfinite(values)
    at_s, values = at_s[known], values[known]
    if len(at_s) < 2:
        return np.full(max(len(edges_s) - 1, 0), np.nan)
    area = np.concatenate(([0.0], np.cumsum(np.diff(at_s) * (values[1:] + values[:-1]) / 2)))
    inside_s = np.clip(edges_s, at_s[0], at_s[-1])
    span_s = np.diff(inside_s)
    is_read = (np.diff(np.searchsorted(at_s, edges_s)) > 0) & (span_s > 0)
    return np.where(is_read, np.diff(np.interp(inside_s, at_s, area)) / np.where(is_read, span_s, 1.0), np.nan)


def steadiness(found: Measured, over_s: float, part_s: float = STABLE_PART_S) -> tuple[float, float] | None:
    """Standard deviation of the means of parts of the last `over_s`, and the slope per second of a line through them.

    None if the data are shorter or have a problem.
    """
    at_s = _times(found)
    count = round(over_s / part_s)
    if not len(at_s) or at_s[-1] - at_s[0] < over_s - part_s / 2:
        return None
    edges_s = np.linspace(max(at_s[-1] - over_s, at_s[0]), at_s[-1], count + 1)
    _, means, _ = outputs_between(found, edges_s)
    if len(means) < count or not np.isfinite(means).all():
        return None
    middle_s = (edges_s[1:] + edges_s[:-1]) / 2
    away_s = middle_s - middle_s.mean()
    return float(np.std(means, ddof=1)), float(away_s @ means / (away_s @ away_s))
