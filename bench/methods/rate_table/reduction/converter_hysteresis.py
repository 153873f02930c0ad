"""Hysteresis of a converter with a + and a - threshold, removed from its counts during an oscillation (equations 8.5).

An integrator with two thresholds gives a pulse of the other sign only when its charge has gone back one pulse farther
than forward. The counts follow the charge like a shaft with backlash: behind it by half the play upwards, ahead by half
downwards, at rest in between. For a sine of 20 pulses this reduces the amplitude by 6 parts in 1000, and shifts the
phase by 1.8°.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bench.methods.rate_table.reduction.samples import TableSamples
from bench.methods.rate_table.reduction.sine_fit import find_frequency, resolved
from bench.metrology.least_squares import Array, NotDetermined, least_squares

MOST_TURNS = 100  # iterations: the removed play depends on the remaining sine
SETTLED = 1e-3  # convergence, of a pulse
PHASES = 4096
HARMONICS = 2


def without_hysteresis(samples: TableSamples, nominal_hz: float, play_pulses: float) -> TableSamples:
    """Samples of an oscillation with the counts of a converter without hysteresis.

    Unchanged if there is no play, if the pulses are of one sign only, or if they do not reverse twice in a period, as
    for an oscillation smaller than the play.
    """
    if not play_pulses or samples.problems:
        return samples
    try:
        frequency_hz = find_frequency(samples.time_s, samples.angle_deg, nominal_hz)
        behind = _settled(samples, frequency_hz, play_pulses / 2)
    except NotDetermined:
        return samples
    return replace(samples, total=samples.total - behind, behind=behind)


def _settled(samples: TableSamples, frequency_hz: float, half: float) -> Array:
    """Lag of the counts (n,), iterated with the remaining sine until it does not change.

    One or two iterations suffice for many pulses, tens if the play is a large part of few pulses.
    """
    behind = np.zeros_like(samples.total)
    for _ in range(MOST_TURNS):
        before, behind = behind, _behind(samples.time_s, samples.total - behind, frequency_hz, half)
        if float(np.max(np.abs(behind - before))) < SETTLED:
            break
    return behind


def _behind(time_s: Array, pulses: Array, frequency_hz: float, half: float) -> Array:
    """Difference of the counts (n,) from the charge, with the present counts taken as the charge."""
    turn = 2 * np.pi * frequency_hz
    harmonics = [k for k in range(1, HARMONICS + 1) if resolved(time_s, k * frequency_hz)]

    def design(at_s: Array) -> Array:
        waves = [wave(k * turn * at_s) for k in harmonics for wave in (np.cos, np.sin)]
        return np.column_stack([np.ones_like(at_s), at_s, *waves])

    coefficients = least_squares(design(time_s), pulses).coefficients
    phase = np.arange(PHASES) / PHASES / frequency_hz
    charge = design(np.append(phase, 1 / frequency_hz)) @ coefficients
    rising = np.diff(charge) > 0
    turns = np.flatnonzero(rising != np.roll(rising, 1))
    if len(turns) != 2 or np.ptp(charge) <= 2 * half:
        return np.zeros_like(pulses)
    at_s = np.mod(time_s, 1 / frequency_hz)
    goes_up = rising[np.minimum((at_s * frequency_hz * PHASES).astype(np.int64), PHASES - 1)]
    low, high = (phase[turns[rising[turns] == up][0]] for up in (True, False))
    since_s = np.mod(at_s - np.where(goes_up, low, high), 1 / frequency_hz)
    charge, began = design(time_s) @ coefficients, design(time_s - since_s) @ coefficients
    return np.where(goes_up, np.maximum(began + half, charge - half), np.minimum(began - half, charge + half)) - charge
