"""Motion profiles of an axis: move, rotation, oscillation, each an exact function of time.

A table follows imperfectly (`simulators/physics/servo.py`): its rate has ripple, and it lags behind a sine.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from simulators.physics.servo import Loop, Ripple

Angles = NDArray[np.float64]


@dataclass(frozen=True)
class Profile(ABC):
    """The command of an axis, given at `start_s`: its angle and rate as exact functions of time."""

    start_s: float

    @property
    @abstractmethod
    def duration_s(self) -> float:
        """Duration until rest, the final rate, or the full amplitude and frequency of a sine."""

    @property
    @abstractmethod
    def endless(self) -> bool:
        """True if the motion continues after that."""

    @abstractmethod
    def angle_deg(self, at_s: Angles) -> Angles:
        """Angles at the times `at_s`."""

    @abstractmethod
    def rates_dps(self, at_s: Angles) -> Angles:
        """Rates at the times `at_s`."""

    @abstractmethod
    def accelerations_dps2(self, at_s: Angles) -> Angles:
        """Angular accelerations at the times `at_s`."""

    def angle_at(self, at_s: float) -> float:
        """Angle at one time."""
        return float(self.angle_deg(np.array([at_s]))[0])

    def rate_at(self, at_s: float) -> float:
        """Rate at one time, °/s."""
        return float(self.rates_dps(np.array([at_s]))[0])


@dataclass(frozen=True)
class Move(Profile):
    """A trapezoidal rate profile from rest to rest, beginning at `start_s`."""

    origin_deg: float
    distance_deg: float
    rate_dps: float
    acceleration_dps2: float

    endless = False

    @cached_property
    def _ramp_s(self) -> float:
        triangle = math.sqrt(abs(self.distance_deg) / self.acceleration_dps2)
        return min(self.rate_dps / self.acceleration_dps2, triangle)

    @cached_property
    def duration_s(self) -> float:
        """Duration from start to rest."""
        if self.distance_deg == 0:
            return 0.0
        ramp = self._ramp_s
        return abs(self.distance_deg) / (ramp * self.acceleration_dps2) + ramp

    def angle_deg(self, at_s: Angles) -> Angles:
        """Angles at the times `at_s`."""
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
        """Angle at one time."""
        return self.origin_deg + self.distance_deg if at_s >= self.start_s + self.duration_s else super().angle_at(at_s)

    def rates_dps(self, at_s: Angles) -> Angles:
        """Rates at the times `at_s`."""
        t = at_s - self.start_s
        ramping_s = np.clip(np.minimum(t, self.duration_s - t), 0.0, self._ramp_s)
        return np.copysign(ramping_s * self.acceleration_dps2, self.distance_deg)

    def accelerations_dps2(self, at_s: Angles) -> Angles:
        """Angular accelerations at the times `at_s`."""
        t, ramp = at_s - self.start_s, self._ramp_s
        left = self.duration_s - t
        speeding = ((t > 0) & (t < ramp)).astype(np.float64) - ((left > 0) & (left < ramp))
        return np.asarray(speeding * math.copysign(self.acceleration_dps2, self.distance_deg))

    def rate_at(self, at_s: float) -> float:
        """Rate at one time, °/s."""
        total, t = self.duration_s, at_s - self.start_s
        ramping_s = max(0.0, min(t, total - t, self._ramp_s))
        return math.copysign(ramping_s * self.acceleration_dps2, self.distance_deg)


@dataclass(frozen=True, slots=True)
class Slew:
    """A quantity that changes at constant speed from one value to another, and stays there."""

    begin: float
    end: float
    speed: float

    @property
    def duration_s(self) -> float:
        """Duration of the change."""
        return abs(self.end - self.begin) / self.speed

    def value(self, t_s: Angles) -> Angles:
        """Value at `t_s` after the start."""
        return self.begin + math.copysign(self.speed, self.end - self.begin) * np.minimum(t_s, self.duration_s)

    def slope(self, t_s: Angles) -> Angles:
        """Rate of change at `t_s` after the start."""
        return np.where(t_s < self.duration_s, math.copysign(self.speed, self.end - self.begin), 0.0)

    def integral(self, t_s: Angles) -> Angles:
        """Integral over the first `t_s`."""
        slewing_s = np.minimum(t_s, self.duration_s)
        slewed = (self.begin + 0.5 * math.copysign(self.speed, self.end - self.begin) * slewing_s) * slewing_s
        return slewed + self.end * (t_s - slewing_s)


@dataclass(frozen=True, slots=True)
class Turn(Profile):
    """A change of rate at constant acceleration, followed by rotation; a change to rate zero ends at rest."""

    origin_deg: float
    rate_dps: Slew
    ripple: Ripple | None = None

    @property
    def duration_s(self) -> float:
        """Duration until the rate is reached."""
        return self.rate_dps.duration_s

    @property
    def endless(self) -> bool:
        """True unless the final rate is zero."""
        return self.rate_dps.end != 0

    def angle_deg(self, at_s: Angles) -> Angles:
        """Angles at the times `at_s`."""
        even_deg = self._even_deg(at_s)
        return even_deg if self.ripple is None else self.ripple.angle_deg(even_deg, self.origin_deg)

    def rates_dps(self, at_s: Angles) -> Angles:
        """Rates at the times `at_s`."""
        rate_dps = self.rate_dps.value(np.maximum(at_s - self.start_s, 0))
        return rate_dps if self.ripple is None else rate_dps * (1 + self.ripple.slope(self._even_deg(at_s)))

    def accelerations_dps2(self, at_s: Angles) -> Angles:
        """Angular accelerations at the times `at_s`."""
        t = np.maximum(at_s - self.start_s, 0)
        change_dps2 = self.rate_dps.slope(t)
        if self.ripple is None:
            return change_dps2
        even_deg, rate_dps = self._even_deg(at_s), self.rate_dps.value(t)
        return change_dps2 * (1 + self.ripple.slope(even_deg)) + rate_dps**2 * self.ripple.bend_per_deg(even_deg)

    def _even_deg(self, at_s: Angles) -> Angles:
        """Angle without rate ripple."""
        return self.origin_deg + self.rate_dps.integral(np.maximum(at_s - self.start_s, 0))


@dataclass(frozen=True, slots=True)
class Swing(Profile):
    """A sine about an angle; amplitude and frequency grow from zero, slowly compared with the control loop."""

    centre_deg: float
    amplitude_deg: Slew
    frequency_hz: Slew
    phase_deg: float = 0.0
    loop: Loop | None = None

    endless = True

    def changed(self, at_s: float, amplitude_deg: float, frequency_hz: float, speeds: tuple[float, float]) -> Swing:
        """Return the oscillation that goes on from `at_s`, without a step, to another amplitude and frequency.

        They change at the `speeds`, in °/s and Hz/s.
        """
        t = np.array([max(at_s - self.start_s, 0.0)])
        phase_deg = 360 * float(self.frequency_hz.integral(t)[0]) + self.phase_deg
        amplitude = Slew(float(self.amplitude_deg.value(t)[0]), amplitude_deg, speeds[0])
        frequency = Slew(float(self.frequency_hz.value(t)[0]), frequency_hz, speeds[1])
        return Swing(at_s, self.centre_deg, amplitude, frequency, phase_deg, self.loop)

    @property
    def duration_s(self) -> float:
        """Duration until amplitude and frequency are reached."""
        return max(self.amplitude_deg.duration_s, self.frequency_hz.duration_s)

    def angle_deg(self, at_s: Angles) -> Angles:
        """Angles at the times `at_s`."""
        amplitude_deg, phase, _, _ = self._motion(at_s)
        return self.centre_deg + amplitude_deg * np.sin(phase)

    def rates_dps(self, at_s: Angles) -> Angles:
        """Rates at the times `at_s`."""
        amplitude_deg, phase, turning, growing_dps = self._motion(at_s)
        return growing_dps * np.sin(phase) + amplitude_deg * turning * np.cos(phase)

    def accelerations_dps2(self, at_s: Angles) -> Angles:
        """Angular accelerations at the times `at_s`."""
        amplitude_deg, phase, turning, growing_dps = self._motion(at_s)
        chirp = 2 * math.pi * self.frequency_hz.slope(np.maximum(at_s - self.start_s, 0))
        along = 2 * growing_dps * turning + amplitude_deg * chirp
        return along * np.cos(phase) - amplitude_deg * turning**2 * np.sin(phase)

    def _motion(self, at_s: Angles) -> tuple[Angles, Angles, Angles, Angles]:
        """Amplitude in °, phase in rad, and their derivatives: phase in rad/s, amplitude in °/s."""
        t = np.maximum(at_s - self.start_s, 0)
        amplitude_deg, frequency_hz = self.amplitude_deg.value(t), self.frequency_hz.value(t)
        growing_dps = self.amplitude_deg.slope(t)
        phase = 2 * math.pi * self.frequency_hz.integral(t) + math.radians(self.phase_deg)
        turning = 2 * math.pi * frequency_hz
        if self.loop is None:
            return amplitude_deg, phase, turning, growing_dps
        gain, lag = self.loop.follows(amplitude_deg, frequency_hz)
        gain_per_hz, lag_per_hz = self.loop.slopes(amplitude_deg, frequency_hz)
        chirp_hz_per_s = self.frequency_hz.slope(t)
        growing_dps = gain * (growing_dps + amplitude_deg * gain_per_hz * chirp_hz_per_s)
        return gain * amplitude_deg, phase + lag, turning + lag_per_hz * chirp_hz_per_s, growing_dps
