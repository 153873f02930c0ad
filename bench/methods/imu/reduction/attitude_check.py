"""Check that a unit had its commanded attitudes, by gravity and earth rate (equations 4.7)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.methods.imu.reduction.attitudes import EARTH_RATE_DPS, HEADINGS, NAMES, NORTH, block
from bench.metrology.least_squares import Array
from bench.metrology.run_data import AXES

CLEAR = 0.15  # of the horizontal earth rate: with less scatter over the headings, gyros distinguish these
_HEADINGS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])  # sensitivities of two horizontal axes to north


def doubtful_attitudes(accelerometer_output: Array, tolerance_g: float) -> NDArray[np.bool_]:
    """Mask of the attitudes (24,) with readings unlike the others of their kind, from pulse/s (24, 3); NaN is missing.

    The reading of the vertical axis is compared with the median of the four attitudes in which that axis has the same
    direction. One g is half the difference of the medians; if that is zero the unit was not turned, and all are
    doubtful.
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
    """Attitudes with another heading than scheduled, and those whose heading the gyros cannot determine.

    The vertical accelerometer reads the same at every heading; the two horizontal gyros sense north. `gyro_output`
    (24, 3) are readings at rest, `pulse_per_deg` (3,) the gyros' scale factors; NaN is missing. The four headings
    of a kind share their mean, so exchanged ones are found, a single wrong one may not be.
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
        else:  # also for missing values
            unclear += range(first, first + HEADINGS)
    return exchanged, unclear
