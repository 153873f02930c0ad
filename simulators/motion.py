"""One axis of a head or a table: what it is told to do, where its encoder says it is, and where it really is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from simulators.corrections import Table, lacking_deg

Angles = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class AxisErrors:
    """What the encoder does not see, all in degrees.

    `table` is what must be added to angles that are read, over one turn, which the other errors come on top of.
    `cosines` and `sines` are the amplitudes of harmonics 1, 2, … of the error map; `backlash_deg` shows when an angle
    is approached from above (the certificate holds for an approach from below); `repeatability_deg` is the standard
    deviation of a fresh draw for each move.
    """

    zero_deg: float = 0.0
    cosines: tuple[float, ...] = ()
    sines: tuple[float, ...] = ()
    backlash_deg: float = 0.0
    repeatability_deg: float = 0.0
    table: Table = ((), ())

    def with_map(self, error_deg: Angles, angle_deg: Angles) -> Angles:
        """An error with what the error map and the table have at the angles beside it."""
        turn = np.radians(angle_deg)
        for order, (cosine, sine) in enumerate(zip(self.cosines, self.sines, strict=True), start=1):
            error_deg = error_deg + (cosine * np.cos(order * turn) + sine * np.sin(order * turn))
        return error_deg + lacking_deg(angle_deg, self.table) if self.table[0] else error_deg


class Profile(Protocol):
    """What an axis was told to do: its angle and rate as exact functions of time."""

    @property
    def start_s(self) -> float:
        """When it was told."""

    @property
    def duration_s(self) -> float:
        """Until it is done: at rest, at its rate, or at the amplitude and frequency of its sine."""

    @property
    def endless(self) -> bool:
        """Whether it goes on when it is done."""

    def angle_deg(self, at_s: Angles) -> Angles:
        """The angle at the times `at_s`."""

    def angle_at(self, at_s: float) -> float:
        """The angle at one time."""

    def rate_at(self, at_s: float) -> float:
        """The rate at one time, °/s."""


@dataclass(frozen=True, slots=True)
class Move:
    """A trapezoid of rate from rest to rest, beginning at `start_s`."""

    start_s: float
    origin_deg: float
    distance_deg: float
    rate_dps: float
    acceleration_dps2: float

    endless = False

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

    def rate_at(self, at_s: float) -> float:
        """The rate at one time, °/s."""
        total, t = self.duration_s, at_s - self.start_s
        ramping_s = max(0.0, min(t, total - t, self._ramp_s))
        return math.copysign(ramping_s * self.acceleration_dps2, self.distance_deg)


@dataclass(frozen=True, slots=True)
class Slew:
    """A quantity that goes from one value to another at a constant speed, and stays there."""

    begin: float
    end: float
    speed: float

    @property
    def duration_s(self) -> float:
        """From one value to the other."""
        return abs(self.end - self.begin) / self.speed

    def value(self, t_s: Angles) -> Angles:
        """The quantity `t_s` after it began."""
        return self.begin + math.copysign(self.speed, self.end - self.begin) * np.minimum(t_s, self.duration_s)

    def integral(self, t_s: Angles) -> Angles:
        """Its integral over the first `t_s`."""
        slewing_s = np.minimum(t_s, self.duration_s)
        slewed = (self.begin + 0.5 * math.copysign(self.speed, self.end - self.begin) * slewing_s) * slewing_s
        return slewed + self.end * (t_s - slewing_s)


@dataclass(frozen=True, slots=True)
class Turn:
    """A change of rate at a constant acceleration, and then turning on; a change to rate zero ends at rest."""

    start_s: float
    origin_deg: float
    rate_dps: Slew

    @property
    def duration_s(self) -> float:
        """Until the rate is reached."""
        return self.rate_dps.duration_s

    @property
    def endless(self) -> bool:
        """Whether it turns on."""
        return self.rate_dps.end != 0

    def angle_deg(self, at_s: Angles) -> Angles:
        """The angle at the times `at_s`."""
        return self.origin_deg + self.rate_dps.integral(np.maximum(at_s - self.start_s, 0))

    def angle_at(self, at_s: float) -> float:
        """The angle at one time."""
        return float(self.angle_deg(np.array([at_s]))[0])

    def rate_at(self, at_s: float) -> float:
        """The rate at one time, °/s."""
        return float(self.rate_dps.value(np.array([max(at_s - self.start_s, 0.0)]))[0])


@dataclass(frozen=True, slots=True)
class Swing:
    """A sine about an angle; its amplitude and its frequency grow from nothing."""

    start_s: float
    centre_deg: float
    amplitude_deg: Slew
    frequency_hz: Slew
    phase_deg: float = 0.0

    endless = True

    @property
    def duration_s(self) -> float:
        """Until amplitude and frequency are reached."""
        return max(self.amplitude_deg.duration_s, self.frequency_hz.duration_s)

    def angle_deg(self, at_s: Angles) -> Angles:
        """The angle at the times `at_s`."""
        t = np.maximum(at_s - self.start_s, 0)
        return self.centre_deg + self.amplitude_deg.value(t) * np.sin(self._phase(t))

    def angle_at(self, at_s: float) -> float:
        """The angle at one time."""
        return float(self.angle_deg(np.array([at_s]))[0])

    def rate_at(self, at_s: float) -> float:
        """The rate at one time, °/s."""
        t = np.array([max(at_s - self.start_s, 0.0)])
        growing_dps = self.amplitude_deg.speed if t[0] < self.amplitude_deg.duration_s else 0.0
        swinging = self.amplitude_deg.value(t) * 2 * math.pi * self.frequency_hz.value(t) * np.cos(self._phase(t))
        return float((growing_dps * np.sin(self._phase(t)) + swinging)[0])

    def _phase(self, t_s: Angles) -> Angles:
        """In radians."""
        return 2 * math.pi * self.frequency_hz.integral(t_s) + math.radians(self.phase_deg)


class Axis:
    """An axis that moves, turns and swings; times are true seconds of the world.

    Moves and swings begin from rest: one commanded while the axis is under way starts from where it then is.
    """

    def __init__(self, errors: AxisErrors, acceleration_dps2: float, draws: np.random.Generator) -> None:
        self._errors = errors
        self._acceleration = acceleration_dps2
        self._draws = draws
        self._profile: Profile = Move(0.0, 0.0, 0.0, 1.0, acceleration_dps2)
        self._from_above = False
        self._scatter_deg = 0.0
        self._rest_deg: float | None = None  # where it truly stands at rest, once somebody asked

    def start(self, at_s: float, target_deg: float, rate_dps: float, acceleration_dps2: float | None = None) -> None:
        """Begins a move to `target_deg`; the world has caught up to `at_s` before."""
        origin = self._profile.angle_at(at_s)
        self._begin(Move(at_s, origin, target_deg - origin, rate_dps, acceleration_dps2 or self._acceleration))
        if target_deg != origin:
            self._from_above = target_deg < origin
            self._scatter_deg = self._errors.repeatability_deg * float(self._draws.standard_normal())

    def turn(self, at_s: float, rate_dps: float, acceleration_dps2: float) -> None:
        """Changes the rate to `rate_dps`, from what it is now."""
        rate = Slew(self._profile.rate_at(at_s), rate_dps, acceleration_dps2)
        self._begin(Turn(at_s, self._profile.angle_at(at_s), rate))
        if turning := rate.end or rate.begin:
            self._from_above = turning < 0

    def swing(self, at_s: float, amplitude_deg: Slew, frequency_hz: Slew, phase_deg: float) -> None:
        """Begins to swing about where it is now."""
        self._begin(Swing(at_s, self._profile.angle_at(at_s), amplitude_deg, frequency_hz, phase_deg))

    def stop(self, at_s: float) -> None:
        """Stands still where it is now."""
        self._begin(Move(at_s, self._profile.angle_at(at_s), 0.0, 1.0, self._acceleration))

    def done(self, at_s: float) -> bool:
        """Whether the axis has come to what it was told to do."""
        return at_s >= self._profile.start_s + self._profile.duration_s

    def moving(self, at_s: float) -> bool:
        """Whether it is not at rest."""
        return self._profile.endless or not self.done(at_s)

    def encoder_deg(self, at_s: float) -> float:
        """What the axis reports."""
        return self._profile.angle_at(at_s)

    def rate_dps(self, at_s: float) -> float:
        """How fast it turns."""
        return self._profile.rate_at(at_s)

    def target_deg(self) -> float:
        """Where the last command ends, if it does."""
        return self._profile.angle_at(self._profile.start_s + self._profile.duration_s)

    def still_deg(self, at_s: float) -> float | None:
        """Where the axis really stands; None while it moves."""
        if self.moving(at_s):
            return None
        if self._rest_deg is None:
            target = np.array([self.target_deg()])
            self._rest_deg = float(target[0] + self._error_deg(target)[0])
        return self._rest_deg

    def true_deg(self, at_s: Angles) -> Angles:
        """Where the axis really is."""
        still_deg = self.still_deg(float(at_s[0]))
        if still_deg is not None:
            return np.full_like(at_s, still_deg)
        angle = self._profile.angle_deg(at_s)
        return angle + self._error_deg(angle)

    def lasting_deg(self, angle_deg: Angles) -> Angles:
        """Where it stands, as often as it comes from below to where it reports these angles, but for scatter."""
        return angle_deg + self._errors.with_map(np.full_like(angle_deg, self._errors.zero_deg), angle_deg)

    def _begin(self, profile: Profile) -> None:
        self._profile, self._rest_deg = profile, None

    def _error_deg(self, angle_deg: Angles) -> Angles:
        errors = self._errors
        total = np.full_like(angle_deg, errors.zero_deg + self._scatter_deg)
        if self._from_above:
            total += errors.backlash_deg
        return errors.with_map(total, angle_deg)
