"""Nonlinear least squares by the Gauss-Newton method with an analytic Jacobian (equations 1.8).

Each step is a linear fit by the kernel of `bench.metrology.least_squares`: on a column-scaled design, by its singular
values. A step that does not reduce the residuals is shortened.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from bench.metrology.least_squares import CONDITION_LIMIT, Array, LinearFit, NotDetermined, least_squares
from bench.metrology.results.flag import Flag

Model = Callable[[Array], tuple[Array, Array]]
"""Return, for parameters (p,), the model values (n,) and their Jacobian (n, p)."""

MOST_STEPS = 200
MOST_HALVINGS = 50
RELATIVE_STEP = 1e-9
STEP_PER_U = 1e-6
ROUNDING = 16 * float(np.finfo(np.float64).eps)  # rounding of a model value, relative to the largest reading
ANY_CONDITION = float(np.finfo(np.float64).max)


class NotConverged(ValueError):
    """No solution was found: the model does not suit the readings, or the start was too far away.

    `note` is the problem as a remark. `doubt` names the parameters that the readings hardly separate at the start.
    """

    def __init__(self, note: Flag, doubt: NotDetermined | None = None) -> None:
        super().__init__(str(note))
        self.note, self.doubt = note, doubt


@dataclass(frozen=True, slots=True)
class NonlinearFit:
    """Least squares y = model(parameters).

    `linear` is the linear fit of the last step, with gain, covariance, rank and condition there. `doubt` names the
    parameters that the readings hardly separate, because the condition number at the start or the end is above its
    limit: their values are valid, with large uncertainties.
    """

    parameters: Array
    linear: LinearFit
    iterations: int
    doubt: NotDetermined | None

    @property
    def residuals(self) -> Array:
        """Readings minus model."""
        return self.linear.residuals

    @property
    def covariance(self) -> Array:
        """Covariance (p, p) of the parameters, type A, from the residuals."""
        return self.linear.covariance

    @property
    def u(self) -> Array:
        """Standard uncertainties of the parameters, type A."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True, slots=True)
class _Place:
    """Parameters with their residuals and Jacobian; `misfit` is infinite if the model is not finite."""

    parameters: Array
    residuals: Array
    jacobian: Array
    misfit: float


def fit_nonlinear(
    model: Model,
    y: Array,
    start: Array,
    *,
    names: Sequence[str] | None = None,
    condition_limit: float = CONDITION_LIMIT,
) -> NonlinearFit:
    """Fit `model` to `y` (n,) from the parameters `start` (p,), whose names are `names`.

    It ends when no parameter x would change by more than 1e-9 |x| + 1e-6 u(x), or by more than the rounding of the
    readings accounts for, or when no step can reduce the residuals by more than that. Raises NotDetermined if the
    Jacobian has a rank below p, with the names of the parameters that cannot be separated; NotConverged if no solution
    is found.
    """
    names = names or [f"parameter {i}" for i in range(len(start))]
    rounding = ROUNDING * float(np.max(np.abs(y), initial=0.0))
    place = _place(model, y, np.asarray(start, dtype=np.float64))
    if place.misfit == np.inf:
        raise NotConverged(Flag("the model has no finite values where the fit begins"))
    doubt = _doubt(place, names, condition_limit)
    for iteration in range(1, MOST_STEPS + 1):
        linear = least_squares(place.jacobian, place.residuals, names=names, condition_limit=ANY_CONDITION)
        step, reading_sd = linear.coefficients, np.nan_to_num(linear.residual_sd)
        per_reading = np.sqrt(np.diag(linear.unscaled_covariance))
        enough = RELATIVE_STEP * np.abs(place.parameters) + (STEP_PER_U * reading_sd + rounding) * per_reading
        whole = _place(model, y, place.parameters + step)
        at_the_bottom = whole.misfit >= place.misfit and _gain(place, step) <= rounding * np.sqrt(len(y))
        if np.all(np.abs(step) <= enough) or at_the_bottom:
            doubt = doubt or _doubt(place, names, condition_limit)
            return NonlinearFit(whole.parameters, linear, iteration, doubt)
        nearer = whole if whole.misfit < place.misfit else _nearer(model, y, place, step)
        if nearer is None:
            raise NotConverged(Flag("no step makes the residuals smaller"), doubt)
        place = nearer
    raise NotConverged(Flag("the parameters still change after {steps} steps", values={"steps": MOST_STEPS}), doubt)


def _place(model: Model, y: Array, parameters: Array) -> _Place:
    with np.errstate(all="ignore"):  # a step may lead to an overflow of the model; it is then shortened
        value, jacobian = model(parameters)
        residuals = y - value
        misfit = float(np.linalg.norm(residuals))
        finite = np.isfinite(misfit) and np.isfinite(np.linalg.norm(jacobian))
    return _Place(parameters, residuals, jacobian, misfit if finite else np.inf)


def _nearer(model: Model, y: Array, place: _Place, step: Array) -> _Place | None:
    """First of the parameters after step/2, step/4, … with smaller residuals."""
    places = (_place(model, y, place.parameters + step / 2**halvings) for halvings in range(1, MOST_HALVINGS))
    return next((then for then in places if then.misfit < place.misfit), None)


def _gain(place: _Place, step: Array) -> float:
    """Reduction of the norm of the residuals by a step, for a linear model."""
    gained = float(np.sum((place.jacobian @ step) ** 2))
    return gained / (2 * place.misfit) if place.misfit else 0.0


def _doubt(place: _Place, names: Sequence[str], condition_limit: float) -> NotDetermined | None:
    try:
        least_squares(place.jacobian, place.residuals, names=names, condition_limit=condition_limit)
    except NotDetermined as doubt:
        return doubt
    return None
