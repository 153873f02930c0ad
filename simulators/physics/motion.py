"""One axis of a head or a table: its command, its encoder reading, and its true angle."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulators.physics.corrections import Table, correction_deg
from simulators.physics.profiles import Move, Profile, Slew, Swing, Turn
from simulators.physics.servo import Loop, Ripple

Angles = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class AxisErrors:
    """Errors of an axis that its encoder does not detect, in degrees.

    `table` holds corrections of indicated angles over one turn, in addition to the other errors. `cosines` and `sines`
    are the amplitudes of harmonics 1, 2, … of the error map; `backlash_deg` applies to an approach from above (the
    certificate is for an approach from below); `repeatability_deg` is the standard deviation of a new draw for each
    move.
    """

    zero_deg: float = 0.0
    cosines: tuple[float, ...] = ()
    sines: tuple[float, ...] = ()
    backlash_deg: float = 0.0
    repeatability_deg: float = 0.0
    table: Table = ((), ())

    def with_map(self, error_deg: Angles, angle_deg: Angles) -> Angles:
        """An error plus those of the error map and the table at the angles."""
        for cosine, sine, (along, across) in zip(self.cosines, self.sines, _multiples(angle_deg), strict=False):
            error_deg = error_deg + (cosine * along + sine * across)
        return error_deg + correction_deg(angle_deg, self.table) if self.table[0] else error_deg


class Axis:
    """An axis that moves, rotates and oscillates; times are true seconds of the world.

    Moves and oscillations begin from rest: one commanded during a motion starts from the present angle.
    """

    def __init__(
        self,
        errors: AxisErrors,
        acceleration_dps2: float,
        draws: np.random.Generator,
        loop: Loop | None = None,
        ripple: Ripple | None = None,
        rate_error: float = 0.0,
    ) -> None:
        self._errors = errors
        self._loop, self._ripple, self._rate_error = loop, ripple, rate_error
        self._acceleration = acceleration_dps2
        self._draws = draws
        self._profile: Profile = Move(0.0, 0.0, 0.0, 1.0, acceleration_dps2)
        self._from_above = False
        self._scatter_deg = 0.0
        self._rest_deg: float | None = None  # its true angle at rest, cached after the first query

    def start(self, at_s: float, target_deg: float, rate_dps: float, acceleration_dps2: float | None = None) -> None:
        """Begin a move to `target_deg`; the world has caught up to `at_s` before."""
        origin = self._profile.angle_at(at_s)
        self._begin(Move(at_s, origin, target_deg - origin, rate_dps, acceleration_dps2 or self._acceleration))
        if target_deg != origin:
            self._come_to_rest_anew(from_above=target_deg < origin)

    def place(self, at_s: float, angle_deg: float, *, from_above: bool) -> None:
        """Place it at an angle, without a motion."""
        self._begin(Move(at_s, angle_deg, 0.0, 1.0, self._acceleration))
        self._come_to_rest_anew(from_above=from_above)

    def _come_to_rest_anew(self, *, from_above: bool) -> None:
        self._from_above = from_above
        self._scatter_deg = self._errors.repeatability_deg * float(self._draws.standard_normal())

    def turn(self, at_s: float, rate_dps: float, acceleration_dps2: float) -> None:
        """Change the rate to `rate_dps` from the present one."""
        rate = Slew(self._profile.rate_at(at_s), rate_dps * (1 + self._rate_error), acceleration_dps2)
        self._begin(Turn(at_s, self._profile.angle_at(at_s), rate, self._ripple))
        if turning := rate.end or rate.begin:
            self._from_above = turning < 0

    def swing(self, at_s: float, amplitude_deg: Slew, frequency_hz: Slew, phase_deg: float) -> None:
        """Begin an oscillation about the present angle."""
        centre_deg = self._profile.angle_at(at_s)
        self._begin(Swing(at_s, centre_deg, amplitude_deg, frequency_hz, phase_deg, self._loop))

    def change_swing(self, at_s: float, amplitude_deg: float, frequency_hz: float, speeds: tuple[float, float]) -> None:
        """Change amplitude and frequency of the present oscillation at the `speeds`, in °/s and Hz/s."""
        if isinstance(self._profile, Swing):
            self._begin(self._profile.changed(at_s, amplitude_deg, frequency_hz, speeds))

    def stop(self, at_s: float) -> None:
        """Stop at the present angle."""
        self._begin(Move(at_s, self._profile.angle_at(at_s), 0.0, 1.0, self._acceleration))

    def done(self, at_s: float) -> bool:
        """Return whether the axis has completed its command."""
        return at_s >= self._profile.start_s + self._profile.duration_s

    def left_s(self, at_s: float) -> float:
        """Remaining time of its command."""
        return max(0.0, self._profile.start_s + self._profile.duration_s - at_s)

    def rests_in_s(self, at_s: float) -> float:
        """Remaining time until rest; infinite during an oscillation or rotation."""
        return math.inf if self._profile.endless else self.left_s(at_s)

    def moving(self, at_s: float) -> bool:
        """Return whether the axis moves."""
        return self._profile.endless or not self.done(at_s)

    def encoder_deg(self, at_s: float) -> float:
        """Encoder angle."""
        return self._profile.angle_at(at_s)

    def encoder_angles_deg(self, at_s: Angles) -> Angles:
        """Encoder angles at the times `at_s`."""
        return self._profile.angle_deg(at_s)

    def rate_dps(self, at_s: float) -> float:
        """Rate."""
        return self._profile.rate_at(at_s)

    def acceleration_dps2(self, at_s: float) -> float:
        """Angular acceleration."""
        return float(self._profile.accelerations_dps2(np.array([at_s]))[0])

    def target_deg(self) -> float:
        """Final angle of the last command, if it has one."""
        return self._profile.angle_at(self._profile.start_s + self._profile.duration_s)

    def still_deg(self, at_s: float) -> float | None:
        """The true angle of the axis; None while it moves."""
        if self.moving(at_s):
            return None
        if self._rest_deg is None:
            target = np.array([self.target_deg()])
            self._rest_deg = float(target[0] + self._error_deg(target)[0])
        return self._rest_deg

    def true_deg(self, at_s: Angles) -> Angles:
        """True angle of the axis."""
        still_deg = self.still_deg(float(at_s[0]))
        if still_deg is not None:
            return np.full_like(at_s, still_deg)
        angle = self._profile.angle_deg(at_s)
        return angle + self._error_deg(angle)

    def lasting_deg(self, angle_deg: Angles) -> Angles:
        """True angles for these indicated angles when approached from below, without scatter."""
        return angle_deg + self._errors.with_map(np.full_like(angle_deg, self._errors.zero_deg), angle_deg)

    def true_rates(self, at_s: Angles) -> tuple[Angles, Angles]:
        """True rate, °/s, and angular acceleration, °/s²."""
        if self.still_deg(float(at_s[0])) is not None:
            return np.zeros_like(at_s), np.zeros_like(at_s)
        rate_dps, change_dps2 = self._profile.rates_dps(at_s), self._profile.accelerations_dps2(at_s)
        slope, bend_per_deg = np.ones_like(at_s), np.zeros_like(at_s)
        multiples = enumerate(_multiples(self._profile.angle_deg(at_s)), start=1)
        for cosine, sine, (order, (along, across)) in zip(
            self._errors.cosines, self._errors.sines, multiples, strict=False
        ):
            per_deg = np.radians(order)
            slope += per_deg * (sine * along - cosine * across)
            bend_per_deg -= per_deg**2 * (cosine * along + sine * across)
        return rate_dps * slope, change_dps2 * slope + rate_dps**2 * bend_per_deg

    def _begin(self, profile: Profile) -> None:
        self._profile, self._rest_deg = profile, None

    def _error_deg(self, angle_deg: Angles) -> Angles:
        errors = self._errors
        total = np.full_like(angle_deg, errors.zero_deg + self._scatter_deg)
        if self._from_above:
            total += errors.backlash_deg
        return errors.with_map(total, angle_deg)


def _multiples(angle_deg: Angles) -> Iterator[tuple[Angles, Angles]]:
    """Cosines and sines of angles, and of twice, three times and further multiples of them, without end."""
    turn = np.radians(angle_deg)
    x, y = np.cos(turn), np.sin(turn)
    along, across = x, y
    while True:
        yield along, across
        along, across = along * x - across * y, along * y + across * x
