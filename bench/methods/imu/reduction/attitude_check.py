"""Whether a unit stood as it was meant to: what gravity and earth rate say of its attitudes (equations 4.7)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.methods.imu.reduction.attitudes import AXES, EARTH_RATE_DPS, HEADINGS, NAMES, NORTH, block
from bench.metrology.least_squares import Array

CLEAR = 0.15  # of the horizontal earth rate: gyros that scatter less about the headings tell them apart
_HEADINGS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])  # of two horizontal axes: how much each points north


def doubtful_attitudes(accelerometer_output: Array, tolerance_g: float) -> NDArray[np.bool_]:
    """Which of the attitudes (24,) read otherwise than the others of their kind, from pulse/s (24, 3); NaN is missing.

    The reading of the vertical axis is held against the median of the four attitudes in which that axis points the same
    way. One g is half the difference of the medians; if there is none the unit was not turned, and all are doubtful.
    """
    doubtful = np.zeros(len(NAMES), dtype=np.bool_)
    for axis in range(len(AXES)):
        kinds = accelerometer_output[block(axis), axis].reshape(2, HEADINGS)
        present = np.isfinite(kinds)
        if not present.any(axis=-1).all():
            continue
        median = np.array([np.median(kind[there]) for kind, there in zip(kinds, present, strict=True)])
        one_g = abs(median[0] - median[1]) / 2
        away = np.abs(kinds - median[:, np.newaxis])
        doubtful[block(axis)] = (present & ((away > tolerance_g * one_g) | (one_g == 0))).ravel()
    return doubtful


@np.errstate(divide="ignore", invalid="ignore", over="ignore")
def exchanged_headings(gyro_output: Array, pulse_per_deg: Array, latitude_deg: float) -> tuple[list[int], list[int]]:
    """Attitudes whose heading was another than scheduled, and those of which the gyros cannot tell it.

    The own accelerometer reads the same at every heading; the two horizontal gyros see north. `gyro_output` (24, 3) are
    readings at rest, `pulse_per_deg` (3,) the gyros' scale factors; NaN is missing. The four headings of a kind share
    their mean, so exchanged ones are found, a single wrong one may not be.
    """
    horizontal = pulse_per_deg * EARTH_RATE_DPS * np.cos(np.radians(latitude_deg))
    exchanged: list[int] = []
    unclear: list[int] = []
    for first in range(0, len(NAMES), HEADINGS):
        kind = slice(first, first + HEADINGS)
        others = [axis for axis in range(len(AXES)) if axis != first // (2 * HEADINGS)]
        readings = gyro_output[kind, others]
        north = (readings - readings.mean(axis=0)) / horizontal[others]
        distance = np.linalg.norm(north[:, np.newaxis] - _HEADINGS, axis=-1)
        nearest = _HEADINGS[np.argmin(distance, axis=-1)]
        if np.sqrt(np.mean((north - nearest) ** 2)) < CLEAR:
            wrong = np.any(nearest != NORTH[kind, others], axis=-1)
            exchanged += (first + np.flatnonzero(wrong)).tolist()
        else:  # also where something is missing
            unclear += range(first, first + HEADINGS)
    return exchanged, unclear
