"""Hysteresis of an accelerometer in its input: a bias that depends on the history of the sensed specific force.

h = amplitude · Σ(A - y) / Σ r over the thresholds r, with the play operator y ← max(A - r, min(A + r, y)), y = A at the
start (Prandtl-Ishlinskii). It depends on the turning points of A and not on the rate: after excursions of many
thresholds it is +amplitude on the way up and -amplitude on the way down.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Play:
    """Play operators on one quantity, and their sum."""

    def __init__(self, amplitude: float, thresholds: Sequence[float]) -> None:
        self._thresholds = np.array(thresholds, np.float64)
        self._gain = amplitude / float(self._thresholds.sum()) if len(thresholds) else 0.0
        self._play: Array | None = None

    def follow(self, values: Array) -> Array:
        """Output after each of the consecutive values (n,)."""
        lags = np.empty(len(values))
        play = np.full(len(self._thresholds), values[0]) if self._play is None else self._play
        for number, value in enumerate(values.tolist()):
            play = np.clip(play, value - self._thresholds, value + self._thresholds)
            lags[number] = np.sum(value - play)
        self._play = play
        return self._gain * lags


class InputHysteresis:
    """Bias (g) of a unit from the history of its input; times are true seconds.

    `sensed_g` gives the specific force along the input axis at times (n,); `moves_until_s` the time, not after the
    second argument, at which motions of the first come to rest. The force is sampled every `look_s` until then.
    """

    def __init__(
        self, play: Play, sensed_g: Callable[[Array], Array], moves_until_s: Callable[[float, float], float],
        look_s: float,
    ) -> None:  # fmt: skip
        self._play, self._sensed_g, self._moves_until_s, self._look_s = play, sensed_g, moves_until_s, look_s
        self._times_s: list[Array] = [np.zeros(1)]
        self._bias_g: list[Array] = [np.zeros(1)]
        self._last_change = 0  # number of the first block after it
        self._still = False  # True if the last block has a constant force

    def follow(self, now_s: float) -> None:
        """Follow the input up to now; the stimulus has not changed since the last call."""
        last_s = float(self._times_s[-1][-1])
        rest_s = self._moves_until_s(last_s, now_s)
        looks = int(np.ceil((rest_s - last_s) / self._look_s))
        if self._still and looks == 0:
            self._times_s[-1][-1] = now_s
            return
        self._still = looks == 0
        times_s = np.concatenate([last_s + (rest_s - last_s) * np.arange(looks + 1) / max(looks, 1), [now_s]])
        moving, still = self._sensed_g(times_s[:-1]), self._sensed_g(times_s[-1:])
        self._times_s.append(times_s)
        self._bias_g.append(self._play.follow(np.concatenate([moving, still])))

    def before_change(self, now_s: float) -> None:
        """Follow the input up to now, before it changes; earlier history is no longer needed."""
        self.follow(now_s)
        self._times_s, self._bias_g = self._times_s[self._last_change :], self._bias_g[self._last_change :]
        self._last_change, self._still = len(self._times_s), False

    def bias_g(self, at_s: Array) -> Array:
        """Contribution to the bias at times (n,), none before the last change but one."""
        return np.interp(at_s, np.concatenate(self._times_s), np.concatenate(self._bias_g))
