"""Hysteresis (play) of a charge-balancing converter in the counts of an oscillation (equations 5.3).

After a reversal of its input a ± converter gives no pulse until the charge has gone back by a pulse and the play. The
counts are those of a charge that lags at every reversal. How far it lags follows from the oscillation itself, which is
fitted, freed of the lag and fitted again until nothing changes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bench.methods.rate_table.reduction.samples import TableSamples
from bench.methods.rate_table.reduction.sine_fit import find_frequency, resolved
from bench.metrology.least_squares import Array, NotDetermined, least_squares

# Least stroke, of the play and at least of half a pulse: of 1.8 times the play (describing function of a play) the
# counts have a stroke of the play, and nothing can be taken out of fewer; the steps of counting hide another half.
LEAST_STROKE = 2.5
MOST_TURNS = 100  # iterations: the removed play depends on the remaining sine
SETTLED = 1e-3  # convergence, of a pulse
PHASES = 4096
HARMONICS = 2


def too_few_pulses(stroke: float, play_pulses: float) -> bool:
    """True if the charge changes by too little between two reversals for its counts to determine it."""
    return stroke < LEAST_STROKE * max(play_pulses, 0.5)


def without_hysteresis(samples: TableSamples, nominal_hz: float, play_pulses: float) -> TableSamples:
    """Samples of an oscillation with the counts of a converter without hysteresis, and the `stroke` of its charge.

    The counts are unchanged if there is no play, if the pulses are of one sign only, or if the stroke is no larger than
    the play.
    """
    if samples.problems or samples.sampled is not None:
        return samples
    try:
        frequency_hz = find_frequency(samples.time_s, samples.angle_deg, nominal_hz)
        behind, stroke = _settled(samples, frequency_hz, play_pulses / 2)
    except NotDetermined:
        return samples
    return replace(samples, total=samples.total - behind, behind=behind if play_pulses else None, stroke=stroke)


def _settled(samples: TableSamples, frequency_hz: float, half: float) -> tuple[Array, float]:
    """Lag of the counts (n,), iterated with the remaining sine until it does not change, and its stroke.

    One or two iterations suffice for many pulses, tens if the play is a large part of few pulses.
    """
    behind, stroke = np.zeros_like(samples.total), np.inf
    for _ in range(MOST_TURNS):
        before, (behind, stroke) = behind, _behind(samples.time_s, samples.total - behind, frequency_hz, half)
        if float(np.max(np.abs(behind - before))) < SETTLED:
            break
    return behind, stroke


def _behind(time_s: Array, pulses: Array, frequency_hz: float, half: float) -> tuple[Array, float]:
    """Difference of the counts (n,) from the charge, with the present counts taken as the charge, and its stroke."""
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
    stroke = _stroke(charge, turns)
    if not half or len(turns) != 2 or stroke <= 2 * half:
        return np.zeros_like(pulses), stroke
    at_s = np.mod(time_s, 1 / frequency_hz)
    goes_up = rising[np.minimum((at_s * frequency_hz * PHASES).astype(np.int64), PHASES - 1)]
    low, high = (phase[turns[rising[turns] == up][0]] for up in (True, False))
    since_s = np.mod(at_s - np.where(goes_up, low, high), 1 / frequency_hz)
    charge, began = design(time_s) @ coefficients, design(time_s - since_s) @ coefficients
    lagging = np.where(goes_up, np.maximum(began + half, charge - half), np.minimum(began - half, charge + half))
    return lagging - charge, stroke


def _stroke(charge: Array, turns: NDArray[np.intp]) -> float:
    """Least change of a charge over one period (n,) from one reversal to the next; that of a period without any."""
    if not len(turns):
        return float(abs(charge[-1] - charge[0]))
    at_turns = np.append(charge[turns], charge[turns[0]] + charge[-1] - charge[0])
    return float(np.min(np.abs(np.diff(at_turns))))
