"""Line of one run of an accelerometer channel over temperature: pulse rate and drift (equations 2.5 and 2.7).

Two consecutive readings of the counters make a gate: a mean rate at a mean temperature of the converter. A straight
line goes through the gates of a run. For a converter with volts or codes their mean replaces the rate, and the rate is
in V or codes.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.methods.channel.words import FEW_GATES, HARDLY_ANY_GATES, MANY_OUTLIERS, THERMOSTAT
from bench.metrology.gates import Gates
from bench.metrology.least_squares import (
    EXCESSIVE_OUTLIERS,
    OUTLIER_SIGMAS,
    Array,
    NotDetermined,
    PolynomialFit,
    fit_polynomial,
    reject_outliers,
)
from bench.metrology.pulse_counts import LEAST_SHARE, STANDSTILL_PERIODS
from bench.metrology.results.flag import INVALID, Flag
from bench.metrology.rows import Rows
from bench.metrology.temperature_checks import broken_on_a_ramp, rates_c_per_s

NARROW, FAST = "insufficient_temperature_span", "ramp_too_fast"
RAMP_SLACK = 1.02  # relative to the ramp's limit
LEAST_GATES = 3  # fewer leave no scatter for an uncertainty
ABORT_SHARE = 0.1  # share of gates with the accelerometer off temperature from which the run should have ended
RAMP_PARTS = 10  # parts of a run for the rate of its temperature
UNKNOWN = (np.nan, np.nan)
LARGEST_READING = 2.0**53  # a double beyond this is not exact to the count; nor is such a time plausible


@dataclass(frozen=True, slots=True)
class ChannelRecord(Rows):
    """One row per reading of one run in any order, all arrays (n,); a missing number is NaN.

    `positive` and `negative` are cumulative counts, `converter_c` and `accelerometer_c` temperatures.
    """

    time_s: Array
    positive: Array
    negative: Array
    converter_c: Array
    accelerometer_c: Array


@dataclass(frozen=True, slots=True)
class ChannelRules:
    """Properties of the channel and requirements on a run.

    The rate refers to `reference_c`. `accelerometer_c` is the set temperature of the accelerometer; None if none is
    connected or its temperature is unknown. A gate longer than `longest_gate_s` spans an interruption of the record.
    """

    reference_c: float
    counter_bits: int
    max_rate_pps: float
    accelerometer_c: float | None = None
    accelerometer_tolerance_c: float = 0.2
    max_ramp_c_per_h: float = 30.0
    min_span_c: float = 5.0
    outlier_sigmas: float = OUTLIER_SIGMAS
    longest_gate_s: float = np.inf


@dataclass(frozen=True, slots=True)
class ChannelRun:
    """The line D = rate + slope (T - reference), with standard uncertainties of type A; NaN for unknown values.

    `dof_slope` are the degrees of freedom of the slope's uncertainty, None for unlimited. `span_c` is the temperature
    range of the gates used; `ramp_c_per_h` is negative in a run that mostly cools. `excluded` counts readings (missing,
    fractional_count, beyond_counter, duplicate, thermometer) and gates by reason. Flags: insufficient_temperature_span,
    ramp_too_fast, and invalid if too little of the run is left; `notes` describe problems without a flag. `gates` are
    those used, in time order.
    """

    rate: float
    u_rate: float
    slope_per_c: float
    u_slope_per_c: float
    residual_rms: float
    gates_used: int
    span_c: float
    ramp_c_per_h: float
    flags: tuple[str, ...]
    notes: tuple[Flag, ...]
    excluded: dict[str, int]
    gates: Gates = field(compare=False, repr=False)
    dof_slope: int | None = None

    @property
    def relative_slope_per_c(self) -> float:
        """Slope / rate; NaN without a rate."""
        return self.slope_per_c / self.rate if self.rate else np.nan

    @property
    def u_relative_slope_per_c(self) -> float:
        """Standard uncertainty of the relative slope; that of the rate is negligible against that of the slope."""
        return self.u_slope_per_c / abs(self.rate) if self.rate else np.nan

    @property
    def valid(self) -> bool:
        """True if the run may be used for decisions; a ramp that was too fast does not exclude it."""
        return not {NARROW, INVALID} & set(self.flags)


class ConverterRamp(NamedTuple):
    """Median rate of the converter's temperature, negative if it mostly fell, NaN without one.

    And the larger of the magnitudes of its rising and falling rates.
    """

    usual_c_per_h: float
    fastest_c_per_h: float


@np.errstate(over="ignore", invalid="ignore")  # no rule accepts the results of absurd numbers
def reduce_run(record: ChannelRecord, rules: ChannelRules) -> ChannelRun:
    """Fit the pulse rate of one run by a straight line over the converter's temperature.

    An unusable reading is passed over, and the gate extends from the one before it to the one after it. Of readings at
    one time the first usable one counts. Nothing is raised: undetermined results are NaN.
    """
    excluded: Counter[str] = Counter()
    readings, scheduled = _good_readings(record, rules, excluded)
    gates = _good_gates(_gates(readings, rules.counter_bits), rules, excluded)
    return run_through(gates, rules, excluded, scheduled, ramp_of(readings.time_s, readings.converter_c))


def run_through(
    gates: Gates, rules: ChannelRules, excluded: Counter[str], scheduled: int, ramp: ConverterRamp
) -> ChannelRun:
    """Fit the line through good gates out of `scheduled`; excluded readings are counted by reason."""
    line, kept = _line(gates.converter_c - rules.reference_c, gates, rules.outlier_sigmas)
    excluded["outlier"] = int(np.sum(~kept))
    used, temperature_c = int(np.sum(kept)), gates.converter_c[kept]
    span_c = float(np.ptp(temperature_c)) if used else np.nan
    shortage = _shortage(used, scheduled, excluded["outlier"])
    raised = {
        NARROW: span_c < rules.min_span_c,
        FAST: ramp.fastest_c_per_h > RAMP_SLACK * rules.max_ramp_c_per_h,
        INVALID: bool(shortage),
    }
    rate, slope_per_c = map(float, line.powers) if line else UNKNOWN
    u_rate, u_slope_per_c = map(float, line.u_powers) if line else UNKNOWN
    return ChannelRun(
        rate=rate,
        u_rate=u_rate,
        slope_per_c=slope_per_c,
        u_slope_per_c=u_slope_per_c,
        residual_rms=float(np.sqrt(np.mean(line.residuals**2))) if line else np.nan,
        gates_used=used,
        span_c=span_c,
        ramp_c_per_h=ramp.usual_c_per_h,
        flags=tuple(flag for flag, is_raised in raised.items() if is_raised),
        notes=(*shortage, *_thermostat_notes(excluded["accelerometer_temperature"], scheduled)),
        excluded=dict(excluded),
        gates=gates.rows(kept),
        dof_slope=max(used - 2, 1),
    )


def _good_readings(record: ChannelRecord, rules: ChannelRules, excluded: Counter[str]) -> tuple[ChannelRecord, int]:
    """Usable readings in time order, and the number of gates between all readings."""
    held = np.zeros_like(record.time_s) if rules.accelerometer_c is None else record.accelerometer_c
    needed = np.stack([record.time_s, record.positive, record.negative, record.converter_c, held])
    present = np.isfinite(needed).all(axis=0) & (np.abs(record.time_s) <= LARGEST_READING)
    fractional, beyond = no_counts(record, rules.counter_bits)
    readable = present & ~fractional & ~beyond
    order = np.lexsort((~readable, record.time_s))
    order = order[np.isfinite(record.time_s[order])]
    order = np.delete(order, np.flatnonzero(np.diff(record.time_s[order]) == 0) + 1)
    excluded["missing"] = int(np.sum(~present))
    excluded["fractional_count"] = int(np.sum(present & fractional))
    excluded["beyond_counter"] = int(np.sum(present & beyond & ~fractional))
    excluded["duplicate"] = int(np.sum(readable)) - int(np.sum(readable[order]))
    readings = record.rows(order[readable[order]])
    broken = broken_on_a_ramp(readings.time_s, readings.converter_c)
    excluded["thermometer"] = int(np.sum(broken))
    return readings.rows(~broken), max(len(order) - 1, 0)


def no_counts(record: ChannelRecord, counter_bits: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Mask of rows (n,) with an impossible count: one with a fraction, or beyond the counter's bits."""
    counts = np.stack([record.positive, record.negative])
    fractional = np.isfinite(counts) & (counts != np.round(counts))
    beyond = (counts < 0) | (counts >= min(2.0**counter_bits, LARGEST_READING))
    return np.any(fractional, axis=0), np.any(beyond, axis=0)


def _gates(readings: ChannelRecord, counter_bits: int) -> Gates:
    """Gates between readings; counters that wrap are taken modulo their range."""

    def middle(column: Array) -> Array:
        return column[1:] / 2 + column[:-1] / 2

    return Gates(
        time_s=middle(readings.time_s),
        seconds=np.diff(readings.time_s),
        positive=np.diff(readings.positive) % 2.0**counter_bits,
        negative=np.diff(readings.negative) % 2.0**counter_bits,
        converter_c=middle(readings.converter_c),
        accelerometer_c=middle(readings.accelerometer_c),
    )


def _good_gates(gates: Gates, rules: ChannelRules, excluded: Counter[str]) -> Gates:
    """Usable gates; the others are counted under the first reason that applies (equations 1.7)."""
    possible = gates.seconds * rules.max_rate_pps
    pulses = np.maximum(gates.positive, gates.negative)
    reasons = {
        "gap": gates.seconds > rules.longest_gate_s,
        "ambiguous_gap": possible >= 2.0**rules.counter_bits,
        "too_short": possible <= 1,  # too short for a pulse
        "impossible_rate": pulses > possible + 1,
        "saturated": pulses >= possible - 1,
        "stuck": _stuck(gates),
        "accelerometer_temperature": away_from_thermostat(gates, rules),
    }
    good = np.ones(len(gates.seconds), dtype=np.bool_)
    if np.isinf(rules.longest_gate_s):
        del reasons["gap"]
    for reason, bad in reasons.items():
        excluded[reason] = int(np.sum(good & bad))
        good &= ~bad
    return gates.rows(good)


def _stuck(gates: Gates) -> NDArray[np.bool_]:
    """Mask of gates in which no line pulsed for five times the usual period; all gates of a run without any pulse."""
    both = gates.positive + gates.negative
    pulsing = both > 0
    usual = float(np.median(both[pulsing] / gates.seconds[pulsing])) if pulsing.any() else np.inf
    return ~pulsing & (gates.seconds * usual > STANDSTILL_PERIODS)


def away_from_thermostat(gates: Gates, rules: ChannelRules) -> NDArray[np.bool_]:
    """Mask of gates with the accelerometer off its temperature."""
    if rules.accelerometer_c is None:
        return np.zeros(len(gates.seconds), dtype=np.bool_)
    rounding_c = 1e-9  # tolerance for rounding: 65.2 is within 0.2 of 65
    return np.abs(gates.accelerometer_c - rules.accelerometer_c) > rules.accelerometer_tolerance_c + rounding_c


def _line(away_c: Array, gates: Gates, sigmas: float) -> tuple[PolynomialFit | None, NDArray[np.bool_]]:
    """Straight line over `away_c` through the gates without outliers, and the mask of outliers.

    None without two temperatures.
    """
    kept = np.ones(len(away_c), dtype=np.bool_)
    if len(kept) < 2:
        return None, kept
    design = np.stack([np.ones_like(away_c), away_c - np.mean(away_c)], axis=-1)
    try:
        kept = reject_outliers(design, gates.rate, sigmas=sigmas, resolution=gates.resolution).kept
        return fit_polynomial(away_c[kept], gates.rate[kept], 1), kept
    except NotDetermined:
        return None, kept


def ramp_of(time_s: Array, temperature_c: Array) -> ConverterRamp:
    """Rate of the temperature of a run, from lines through stretches of a tenth of it.

    Medians are insensitive to soaks at the ends, and to the reversal of a run that rises and falls.
    """
    reach = max(len(time_s) // RAMP_PARTS, 1)
    if len(time_s) <= reach:
        return ConverterRamp(*UNKNOWN)
    every = max(reach // RAMP_PARTS, 1)
    rate_c_per_h = rates_c_per_s(time_s, temperature_c, reach + 1, every) * 3600.0
    pace_c_per_h, falls = np.abs(rate_c_per_h), rate_c_per_h < 0
    usual = float(np.median(pace_c_per_h))
    fastest = max(float(np.median(pace_c_per_h[way])) for way in (falls, ~falls) if way.any())
    return ConverterRamp(-usual if np.mean(falls) > 0.5 else usual, fastest)


def _shortage(used: int, scheduled: int, outliers: int) -> tuple[Flag, ...]:
    """Reason why too little of the run is left (equations 1.8, 1.10); empty if it is valid."""
    if used < LEAST_GATES:
        return (Flag(HARDLY_ANY_GATES, values={"used": used, "count": scheduled}),)
    if used < LEAST_SHARE * scheduled:
        return (Flag(FEW_GATES, values={"used": used, "count": scheduled}),)
    if outliers > EXCESSIVE_OUTLIERS * (used + outliers):
        return (Flag(MANY_OUTLIERS, values={"outliers": outliers, "count": used + outliers}),)
    return ()


def _thermostat_notes(away: int, scheduled: int) -> tuple[Flag, ...]:
    return (Flag(THERMOSTAT, values={"away": away, "count": scheduled}),) if away > ABORT_SHARE * scheduled else ()
