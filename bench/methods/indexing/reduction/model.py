"""The model of an accelerometer fitted to the sweeps of both its ends at once (equations 3.3 and 3.4).

U = c0 + c1 a + c2 a² + c3 a³ + c_xz a a_z, with the specific force a = sin(θ + s δ) along the input axis and
a_z = s cos(θ + s δ) along the seat's normal, in g; θ is the angle of the table, s = +1 with the unit's +z up and -1
with it down, and δ turns the input axis towards +z.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.metrology.least_squares import Array, NotDetermined
from bench.metrology.nonlinear import Model, NonlinearFit, NotConverged, fit_nonlinear
from bench.metrology.results.flag import Flag

TERMS = ("c0", "c1", "c2", "c3", "cxz", "delta")
HELD = (0.0, 1.0, 0.0, 0.0, 0.0, 0.0)  # values of terms that are not fitted
DRIFT = "seq"


@dataclass(frozen=True, slots=True)
class SweepModel:
    """Fitted terms, and `seq`, the change of c0 from dwell to dwell, if a drift is fitted.

    Terms are in V per power of g, δ in rad. `fit` is None when no solution was found, for the reason `problem`. `doubt`
    names terms that the readings cannot separate.
    """

    terms: tuple[str, ...]
    fit: NonlinearFit | None
    doubt: NotDetermined | None
    problem: NotDetermined | NotConverged | None = None

    @property
    def notes(self) -> tuple[Flag, ...]:
        """Remarks on the doubt and on the problem."""
        return tuple(dict.fromkeys(each.note for each in (self.doubt, self.problem) if each is not None))

    def value(self, term: str) -> float | None:
        """One of the terms; None if it was not requested or not found."""
        if self.fit is None or term not in self.terms:
            return None
        return float(self.fit.parameters[self.terms.index(term)])


def fit_sweeps(
    angle_rad: Array,
    side: Array,
    output_v: Array,
    terms: Sequence[str],
    *,
    since_first: Array | None = None,
    condition_limit: float,
) -> SweepModel:
    """Fit `terms` to outputs (n,) at angles (n,) of the table; `side` (n,) is +1 with +z up and -1 with it down.

    `since_first` (n,), the number of dwells since the first, adds a drift of the bias.
    """
    names = tuple(terms) if since_first is None else (*terms, DRIFT)
    start = np.array([_slope(np.sin(angle_rad), output_v) if name == "c1" else 0.0 for name in names])
    model = _model(angle_rad, side, terms, since_first)
    try:
        fit = fit_nonlinear(model, output_v, start, names=names, condition_limit=condition_limit)
    except (NotDetermined, NotConverged) as problem:
        doubt = problem if isinstance(problem, NotDetermined) else problem.doubt
        return SweepModel(names, None, doubt, problem)
    return SweepModel(names, fit, fit.doubt)


def _model(angle_rad: Array, side: Array, terms: Sequence[str], since_first: Array | None) -> Model:
    """Model function with the requested terms and the drift as parameters."""
    asked = [TERMS.index(term) for term in terms]
    drift = np.zeros((len(angle_rad), 0)) if since_first is None else since_first[:, np.newaxis]

    def model(parameters: Array) -> tuple[Array, Array]:
        every = np.array(HELD)
        every[asked] = parameters[: len(asked)]
        value, jacobian = output(every, angle_rad, side)
        return value + drift @ parameters[len(asked) :], np.hstack([jacobian[:, asked], drift])

    return model


def output(every: Array, angle_rad: Array, side: Array) -> tuple[Array, Array]:
    """Output (n,) in V and its derivatives (n, 6) with respect to `every` term, in the order of `TERMS`."""
    _, c1, c2, c3, cxz, delta = every
    a, a_z = np.sin(angle_rad + side * delta), side * np.cos(angle_rad + side * delta)
    to_delta = (c1 + 2 * c2 * a + 3 * c3 * a**2) * a_z + cxz * (a_z**2 - a**2)
    derivatives = np.stack([np.ones_like(a), a, a**2, a**3, a * a_z, to_delta], axis=-1)
    return np.asarray(derivatives[:, :5] @ every[:5]), derivatives


def _slope(sine: Array, output_v: Array) -> float:
    """Slope of the line through all readings; 1 without one."""
    away = sine - np.sum(sine) / max(len(sine), 1)
    power = float(away @ away)
    return float(away @ output_v) / power if power else 1.0
