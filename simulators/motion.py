"""One axis of an indexing head: where it is told to be, where its encoder says it is, and where it really is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Angles = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class AxisErrors:
    """What the encoder does not see, all in degrees.

    `cosines` and `sines` are the amplitudes of harmonics 1, 2, … of the error map; `backlash_deg` shows when an angle
    is approached from above (the certificate holds for an approach from below); `repeatability_deg` is the standard
    deviation of a fresh draw for each move.
    """

    zero_deg: float = 0.0
    cosines: tuple[float, ...] = ()
    sines: tuple[float, ...] = ()
    backlash_deg: float = 0.0
    repeatability_deg: float = 0.0


@dataclass(frozen=True, slots=True)
class Move:
    """A trapezoid of rate from rest to rest, beginning at `start_s`."""

    start_s: float
    origin_deg: float
    distance_deg: float
    rate_dps: float
    acceleration_dps2: float

    @property
    def _ramp_s(self) -> float:
        triangle = math.sqrt(abs(self.distance_deg) / self.acceleration_dps2)
        return min(self.rate_dps / self.acceleration_dps2, triangle)

    @property
    def duration_s(self) -> float:
        """From start to rest."""
        if self.distance_deg == 0:
            return 0.0
        ramp = self._ramp_s
        return abs(self.distance_deg) / (ramp * self.acceleration_dps2) + ramp

    def angle_deg(self, at_s: Angles) -> Angles:
        """The angle at the times `at_s`."""
        total, ramp = self.duration_s, self._ramp_s
        if total == 0:
            return np.full_like(at_s, self.origin_deg)
        t = np.clip(at_s - self.start_s, 0, total)
        peak = ramp * self.acceleration_dps2
        speeding = 0.5 * self.acceleration_dps2 * np.minimum(t, ramp) ** 2
        cruising = peak * np.clip(t - ramp, 0, total - 2 * ramp)
        left = np.clip(t - (total - ramp), 0, ramp)
        braking = peak * left - 0.5 * self.acceleration_dps2 * left**2
        return self.origin_deg + math.copysign(1.0, self.distance_deg) * (speeding + cruising + braking)

    def angle_at(self, at_s: float) -> float:
        """The angle at one time."""
        if at_s >= self.start_s + self.duration_s:
            return self.origin_deg + self.distance_deg
        return float(self.angle_deg(np.array([at_s]))[0])


class Axis:
    """An axis that moves by trapezoids; times are true seconds of the world.

    Moves begin from rest: a move commanded while another is under way starts from where the axis then is.
    """

    def __init__(self, errors: AxisErrors, acceleration_dps2: float, draws: np.random.Generator) -> None:
        self._errors = errors
        self._acceleration = acceleration_dps2
        self._draws = draws
        self._move = Move(0.0, 0.0, 0.0, 1.0, acceleration_dps2)
        self._from_above = False
        self._scatter_deg = 0.0
        self._rest_deg: float | None = None  # where it truly stands at rest, once somebody asked

    def start(self, at_s: float, target_deg: float, rate_dps: float) -> None:
        """Begins a move to `target_deg`; the world has caught up to `at_s` before."""
        origin = self._move.angle_at(at_s)
        self._move = Move(at_s, origin, target_deg - origin, rate_dps, self._acceleration)
        self._rest_deg = None
        if target_deg != origin:
            self._from_above = target_deg < origin
            self._scatter_deg = self._errors.repeatability_deg * float(self._draws.standard_normal())

    def stop(self, at_s: float) -> None:
        """Stands still where it is now."""
        self._move = Move(at_s, self._move.angle_at(at_s), 0.0, 1.0, self._acceleration)
        self._rest_deg = None

    def moving(self, at_s: float) -> bool:
        """Whether a move is under way."""
        return at_s < self._move.start_s + self._move.duration_s

    def encoder_deg(self, at_s: float) -> float:
        """What the axis reports."""
        return self._move.angle_at(at_s)

    def target_deg(self) -> float:
        """Where the last command ends."""
        return self._move.origin_deg + self._move.distance_deg

    def true_deg(self, at_s: Angles) -> Angles:
        """Where the axis really is."""
        if self.moving(float(at_s[0])):
            angle = self._move.angle_deg(at_s)
            return angle + self._error_deg(angle)
        if self._rest_deg is None:
            target = np.array([self.target_deg()])
            self._rest_deg = float(target[0] + self._error_deg(target)[0])
        return np.full_like(at_s, self._rest_deg)

    def _error_deg(self, angle_deg: Angles) -> Angles:
        errors, turn = self._errors, np.radians(angle_deg)
        total = np.full_like(angle_deg, errors.zero_deg + self._scatter_deg)
        if self._from_above:
            total += errors.backlash_deg
        for order, (cosine, sine) in enumerate(zip(errors.cosines, errors.sines, strict=True), start=1):
            total += cosine * np.cos(order * turn) + sine * np.sin(order * turn)
        return total
