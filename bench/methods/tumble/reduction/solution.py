"""The one-axis tumble: bias, scale factor, misalignment and K2 from readings at known angles (equations 1.4 to 1.6).

The model is E = c0 + K1 sin θ + (K1 d) cos θ + c2 sin² θ, θ the angle of the input axis above the horizontal, E in
output units (V, mA or pulse/s). The four-point formulas are its special case at 0°, 90°, 180° and 270°. Confounded
terms of a four-point tumble: K1 contains K3, c2 contains the asymmetry of a converter, d the zero error of the head.
More angles separate further terms: Kip sin θ cos θ, K3 sin³ θ, and a converter's |sin θ|.

A unit that is clocked, rotated by 90° about its input axis, has its output axis where the pendulous axis was: at its
readings d is the misalignment towards the output axis, and Kio takes the place of Kip. Readings in both mounts have
K0, K1, K2 and K3 in common.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from bench.metrology.least_squares import Array, LinearFit, NotDetermined, least_squares

Mask = NDArray[np.bool_]

FOUR_POINTS_DEG = (0.0, 90.0, 180.0, 270.0)
TERMS = ("c0", "K1", "d·K1", "c2")
OF_MOUNT = {
    "misalignment": False,
    "Kip": False,
    "misalignment_y": True,
    "Kio": True,
}  # terms of readings clocked or not
# Further terms and the largest condition number of the column-scaled design with which each is fitted. Eight angles and
# more have 6 with K3 and Kip, 15 to 20 with the asymmetry; six, a degree off the level, 80 with K3 (equations 1.5).
EXTRA = {"Kip": 10.0, "Kio": 10.0, "K3": 10.0, "asymmetry": 30.0}
LEAST_SHOWN = 0.1  # root mean square of a term; four angles near 0°, 90°, … show the cross couplings with 0.02
SAME_ANGLE_RAD = 1e-3
DRIFT_DOF = 2  # minimum degrees of freedom without a drift for a drift to be fitted
DRIFT_CONDITION = 1.5  # maximum increase of the condition number by the drift: it must not resemble a constant


@dataclass(frozen=True, slots=True)
class Tumble:
    """The solution of one tumble. Angles in rad; output units as the readings; g is local gravity.

    `extra` are the further terms that were fitted, `first` is the misalignment among the four. A linear drift may be a
    last term, not used further.
    """

    fit: LinearFit
    extra: tuple[str, ...] = ()
    first: str = "misalignment"

    @property
    def c0(self) -> float:
        """Bias in output units."""
        return float(self.fit.coefficients[0])

    @property
    def k1(self) -> float:
        """Scale factor, output units per g."""
        return float(self.fit.coefficients[1])

    @property
    def c2(self) -> float:
        """Square term, output units per g²."""
        return float(self.fit.coefficients[3])

    @property
    def k0_g(self) -> float:
        """Bias K0 = c0/K1, in g."""
        return self._over_k1(self.c0)

    @property
    def k2_g_per_g2(self) -> float:
        """Second-order coefficient K2 = c2/K1."""
        return self._over_k1(self.c2)

    @property
    def misalignment_rad(self) -> float:
        """Misalignment d of the input axis in the plane of the tumble; of two mounts, the one not clocked."""
        return self._over_k1(float(self.fit.coefficients[2]))

    def per_rad(self, angle_rad: Array, clocked: Mask) -> Array:
        """Derivative of the readings (n,) with respect to their angles, in output units per rad."""
        sine, cosine, values = np.sin(angle_rad), np.cos(angle_rad), self.values
        tilted = np.where(clocked, values.get("misalignment_y", 0.0), values.get("misalignment", 0.0))
        return np.asarray(self.k1 * (cosine - tilted * sine + 2 * self.k2_g_per_g2 * sine * cosine))

    def _over_k1(self, value: float) -> float:
        """Value / K1; NaN for a unit that does not follow its input at all."""
        return value / self.k1 if self.k1 else math.nan

    @property
    def values(self) -> dict[str, float]:
        """All coefficients by name, in g, output units and rad: K0, K1, misalignment, K2, and the further ones.

        The asymmetry is the difference of a converter's two scale factors relative to their mean.
        """
        found = (self.k0_g, self.k1, self.misalignment_rad, self.k2_g_per_g2)
        further = self.fit.coefficients[len(TERMS) : len(TERMS) + len(self.extra)] / self.k1 * self._per_term()
        names = ("K0", "K1", self.first, "K2", *self.extra)
        return dict(zip(names, (*found, *further.tolist()), strict=True))

    def _per_term(self) -> Array:
        """Factors from further terms / K1 to their coefficients."""
        return np.array([math.copysign(2.0, self.k1) if name == "asymmetry" else 1.0 for name in self.extra])

    def gain(self) -> Array:
        """Sensitivity of the coefficients to each reading (n,), a row for each in order of `values`."""
        return np.asarray(self._jacobian() @ self.fit.gain)

    def _jacobian(self) -> Array:
        """Derivatives of the coefficients with respect to the fitted terms: all but K1 are terms / K1."""
        scale = np.concatenate([[1.0, self.k1, 1.0, 1.0], self._per_term()])
        jacobian = np.diag(scale / self.k1)
        jacobian[:, 1] -= np.where(np.arange(len(scale)) == 1, 0.0, np.array(list(self.values.values())) / self.k1)
        drift = np.zeros((len(scale), len(self.fit.coefficients) - len(scale)))
        return np.concatenate([jacobian, drift], axis=1)


class IncompleteTumble(NotDetermined):
    """The readings of a tumble do not determine its four terms; `missing_deg` are the positions without a reading."""

    def __init__(self, cause: NotDetermined, missing_deg: Sequence[float]) -> None:
        super().__init__(cause.names, rank=cause.rank, of=cause.of, condition=cause.condition)
        self.missing_deg = tuple(missing_deg)
        if missing_deg:
            self.args = (f"{self}; no reading near {', '.join(f'{angle:g}°' for angle in missing_deg)}",)


def further_terms(angle_rad: Array, clocked: Mask | None = None) -> tuple[str, ...]:
    """Further terms that these angles of the input axis (n,) separate from all others, tested one after the other.

    Readings in two mounts, `clocked` (n,) or not, have the second misalignment in any case.
    """
    turned = np.zeros(len(angle_rad), dtype=np.bool_) if clocked is None else clocked
    angles = np.round(np.mod(angle_rad, 2 * np.pi) / SAME_ANGLE_RAD)
    distinct = len(np.unique(np.stack([angles, turned], axis=-1), axis=0))
    extra: tuple[str, ...] = ("misalignment_y",) if len(np.unique(turned)) > 1 else ()
    for name, most in EXTRA.items():
        design = design_of(angle_rad, (*extra, name), turned)
        readings = np.sum(turned == OF_MOUNT[name]) if name in OF_MOUNT else len(turned)
        shown = np.linalg.norm(design[:, -1]) > LEAST_SHOWN * np.sqrt(readings)  # also false without a reading
        if shown and distinct > len(TERMS) + len(extra) and _condition(design) < most:
            extra = (*extra, name)
    return extra


def _condition(design: Array) -> float:
    singular = np.linalg.svd(design / np.linalg.norm(design, axis=0), compute_uv=False)
    return float(singular[0] / max(singular[-1], np.finfo(np.float64).tiny))


def design_of(angle_rad: Array, extra: Sequence[str], clocked: Mask) -> Array:
    """Columns (n, p) of the terms at angles (n,) of the input axis above the horizontal, the unit clocked or not."""
    sine, cosine = np.sin(angle_rad), np.cos(angle_rad)
    first = np.where(clocked, 0.0, cosine) if "misalignment_y" in extra else cosine
    further = {
        "misalignment_y": np.where(clocked, cosine, 0.0),
        "Kip": np.where(clocked, 0.0, sine * cosine),
        "Kio": np.where(clocked, sine * cosine, 0.0),
        "K3": sine**3,
        "asymmetry": np.abs(sine),
    }
    return np.stack([np.ones_like(sine), sine, first, sine**2, *(further[name] for name in extra)], axis=-1)


def solve_tumble(
    angle_rad: Array, reading: Array, extra: Sequence[str] = (), time_s: Array | None = None,
    clocked: Mask | None = None,
) -> Tumble:  # fmt: skip
    """Least squares over `reading` (n,) in output units at the actual angles (n,) of the input axis above horizontal.

    `extra` are further terms to be fitted; those of a mount without a reading, `clocked` (n,) or not, are left out.
    With the times of the readings (n,), and enough of them, a linear drift is one more, so that it is neither in the
    coefficients, which are those of the mean time, nor in the scatter. Raises IncompleteTumble, with the terms and
    positions, if the angles do not determine the terms.
    """
    turned = np.zeros(len(angle_rad), dtype=np.bool_) if clocked is None else clocked
    first = "misalignment" if not turned.all() else "misalignment_y"
    extra = [name for name in extra if name != first and (name not in OF_MOUNT or np.any(turned == OF_MOUNT[name]))]
    design, names = design_of(angle_rad, extra, turned), (*TERMS, *extra)
    try:
        fit = least_squares(design, reading, names=names)
        if time_s is not None and fit.dof > DRIFT_DOF:
            since_s = time_s - time_s.mean()
            drifting = np.column_stack([design, since_s / np.max(np.abs(since_s))])
            if _condition(drifting) < DRIFT_CONDITION * fit.condition:
                fit = least_squares(drifting, reading, names=(*names, "drift"))
        return Tumble(fit, tuple(extra), first)
    except NotDetermined as cause:
        raise IncompleteTumble(cause, missing_positions_deg(np.degrees(angle_rad))) from None


def missing_positions_deg(angle_deg: Array) -> list[float]:
    """Positions of the four without an angle within 45°, half the way to the next."""
    return [wanted for wanted in FOUR_POINTS_DEG if not np.any(np.abs(turn_between_deg(wanted, angle_deg)) < 45)]


def turn_between_deg(start_deg: float, end_deg: Array) -> Array:
    """Shorter rotation from `start_deg` to `end_deg`, from -180 to 180."""
    return np.mod(end_deg - start_deg + 180, 360) - 180


@dataclass(frozen=True, slots=True)
class Hysteresis:
    """Largest |rising - falling|, in the unit of the values, at the set point `set_c`, and the two dwells.

    `differences` (m,) are all of them with their sign, of the dwells in the rows of `pairs` (m, 2).
    """

    value: float
    set_c: float
    rising: int
    falling: int
    differences: Array
    pairs: NDArray[np.int_]


def hysteresis(
    value: Array,
    temperature_c: Array,
    set_c: Array,
    *,
    rising: NDArray[np.bool_],
    cycle: NDArray[np.int_],
    slope: Callable[[Array], Array],
) -> Hysteresis | None:
    """Compare dwells (n,) of one cycle at one set point, reached once by rising and once by falling temperature.

    Slightly different temperatures are corrected by `slope`, the model's derivative at a temperature. None if no set
    point was visited in both directions.
    """
    visits: dict[tuple[int, float], tuple[list[int], list[int]]] = {}
    for dwell, at in enumerate(zip(cycle.tolist(), set_c.round(6).tolist(), strict=True)):
        up_and_down = visits.setdefault(at, ([], []))
        up_and_down[0 if rising[dwell] else 1].append(dwell)
    pairs = np.array([pair for up_and_down in visits.values() for pair in product(*up_and_down)], dtype=np.int_)
    if not len(pairs):
        return None
    up, down = pairs.T
    expected = slope((temperature_c[up] + temperature_c[down]) / 2) * (temperature_c[up] - temperature_c[down])
    difference = value[up] - value[down] - expected
    largest = int(np.argmax(np.abs(difference)))
    i, j = int(up[largest]), int(down[largest])
    return Hysteresis(float(np.abs(difference[largest])), float(set_c[i]), i, j, difference, pairs)
