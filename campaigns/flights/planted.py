"""Mistakes planted in the conversion of counts to velocity, which flights must see."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np

from bench.metrology import velocity
from bench.metrology.motion_records import SampleRecord
from bench.offline import count_series, motion, sample_series


def white_errors() -> AbstractContextManager[object]:
    """Errors of the calibration as if each interval had its own: added as squares."""
    honest = velocity.integrate

    def mistaken(force: velocity.SpecificForce, *rest: Any) -> velocity.Velocity:
        found = honest(force, *rest)
        squares = np.sum([(error * force.seconds) ** 2 for error in force.errors], axis=0)
        gravity: velocity.Gravity = rest[0]
        white = gravity.mps2 * np.sqrt(np.concatenate(([0.0], np.cumsum(squares))))
        return replace(found, u_model_mps=white)

    return mock.patch.object(motion, "integrate", mistaken)


def sign_lost() -> AbstractContextManager[object]:
    """The magnitude of a scale factor."""
    honest = velocity.values_of

    def mistaken(curve: Any, temperature_c: Any) -> Any:
        found = honest(curve, temperature_c)
        return np.abs(found) if curve.unit == "pulse/s/g" else found

    return mock.patch.object(velocity, "values_of", mistaken)


def one_axis_alone() -> AbstractContextManager[object]:
    """No cross-coupling."""
    honest = velocity._Axis.force_g

    def mistaken(axis: velocity._Axis, own_g: Any, _: object) -> Any:
        return honest(axis, own_g, dict.fromkeys(axis.terms.cross, np.zeros_like(own_g)))

    return mock.patch.object(velocity._Axis, "force_g", mistaken)


def standard_gravity() -> AbstractContextManager[object]:
    """Standard gravity for that of the calibration."""
    honest = motion.Gravity
    return mock.patch.object(motion, "Gravity", lambda _, u_mps2: honest(9.80665, u_mps2))


def other_samples() -> AbstractContextManager[object]:
    """Means taken for outputs at their times, and the reverse."""
    honest = sample_series.SampleRecord

    def mistaken(*columns: Any, averaged: bool, **named: Any) -> SampleRecord:
        return honest(*columns, averaged=not averaged, **named)

    return mock.patch.object(sample_series, "SampleRecord", mistaken)


def exchanged_counters() -> AbstractContextManager[object]:
    """The + and - counters the wrong way round."""
    return mock.patch.object(count_series, "SIGNS", ("_neg", "_pos"))


PLANTED: Mapping[str, Callable[[], AbstractContextManager[object]]] = {
    "correlated errors added as white ones": white_errors,
    "sign of the scale factor lost": sign_lost,
    "standard gravity for that of the calibration": standard_gravity,
    "exchanged counters": exchanged_counters,
    "no cross-coupling": one_axis_alone,
}
PLANTED_IN_SAMPLES: Mapping[str, Callable[[], AbstractContextManager[object]]] = {
    "standard gravity for that of the calibration": standard_gravity,
    "means for outputs at their times, or the reverse": other_samples,
}
