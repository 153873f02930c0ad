"""Channel without pulse counts: means of the volts or codes of its converter, over the gates of a ramp."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.methods.channel.reduction.line import ChannelRules, ChannelRun, away_from_thermostat, ramp_of, run_through
from bench.metrology.acquisition import Array, Codes, Voltages
from bench.metrology.gates import Gates
from bench.metrology.outputs import outputs_between
from bench.metrology.sampled_codes import hidden_by_steps, sampled_at_s
from bench.metrology.temperature_checks import broken_on_a_ramp


@dataclass(frozen=True, slots=True)
class Means:
    """Gates of a run in time order; unusable ones are not-a-number, and counted in `problems`."""

    gates: Gates
    problems: Counter[str]


def means_of(found: Voltages | Codes, edges_s: Array, converter_c: Array, accelerometer_c: Array) -> Means:
    """Mean outputs between consecutive edges (n,), with the means of both temperatures there (n - 1,)."""
    _, output, problems = outputs_between(found, edges_s)
    seconds = np.diff(edges_s)
    gates = Gates(
        time_s=(edges_s[1:] + edges_s[:-1]) / 2,
        seconds=seconds,
        positive=output * seconds,
        negative=np.zeros_like(output),
        converter_c=converter_c,
        accelerometer_c=accelerometer_c,
        quantisation_u=np.full(len(output), _quantisation_u(found, edges_s)),
    )
    return Means(gates, problems)


def _quantisation_u(found: Voltages | Codes, edges_s: Array) -> float:
    """Quantisation uncertainty of a mean; the scatter is that within a gate, where the output hardly changes."""
    if isinstance(found, Voltages) or len(edges_s) < 2:
        return 0.0
    parts = np.split(found.values, np.searchsorted(sampled_at_s(found), edges_s))[1:-1]
    scatters = [float(np.std(part, ddof=1)) for part in parts if len(part) > 1]
    return hidden_by_steps(float(np.median(scatters)) if scatters else 0.0, found.step)


def joined(parts: Sequence[Means]) -> Means:
    """Gates of several ramps as those of one run."""
    return Means(Gates.joined([part.gates for part in parts]), sum((part.problems for part in parts), Counter()))


def reduce_means(means: Means, rules: ChannelRules) -> ChannelRun:
    """Fit the output of one run by a straight line over the converter's temperature, as `reduce_run` for counts."""
    gates, excluded = means.gates, means.problems.copy()
    excluded["missing"] += int(np.sum(~np.isfinite(gates.rate))) - sum(means.problems.values())
    held_c = np.zeros_like(gates.time_s) if rules.accelerometer_c is None else gates.accelerometer_c
    good = np.isfinite(gates.rate)
    unknown = ~np.isfinite(gates.converter_c + held_c)
    excluded["missing"] += int(np.sum(good & unknown))
    good &= ~unknown
    broken = np.zeros_like(good)
    broken[good] = broken_on_a_ramp(gates.time_s[good], gates.converter_c[good])
    excluded["thermometer"] = int(np.sum(broken))
    good &= ~broken
    ramp = ramp_of(gates.time_s[good], gates.converter_c[good])
    away = good & away_from_thermostat(gates, rules)
    excluded["accelerometer_temperature"] = int(np.sum(away))
    return run_through(gates.rows(good & ~away), rules, excluded, len(gates.seconds), ramp)
