"""Second-order low pass with delay fitted to a measured response: an equation for the user."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bench.methods.rate_table.reduction.response_points import SweepPoint
from bench.metrology.calibration.second_order import FORM, NAMES, second_order
from bench.metrology.least_squares import Array, NotDetermined
from bench.metrology.nonlinear import Model, NonlinearFit, NotConverged, fit_nonlinear
from bench.metrology.results.curves import Constant, Equation

LEAST_POINTS = 5
DESCRIBES = 0.02  # of the gain: a response farther from the equation is of another kind
LEAST_U = 1e-7  # of a gain: minimum uncertainty, without noise


def response_model(points: Sequence[SweepPoint], model_id: tuple[str, str], skew_u_s: float) -> Equation | None:
    """Equation of a response, by increasing frequency; None if it does not describe the response.

    `model_id` are the id of the model and the serial number of the unit; `skew_u_s` is the standard uncertainty of the
    time between the latches of encoder and pulses, which is in the delay.
    """
    if len(points) < LEAST_POINTS:
        return None
    frequency_hz = np.array([point.swing.frequency_hz for point in points])
    response = np.array([point.response for point in points])
    start = _start(frequency_hz, response, float(np.mean(frequency_hz)))
    weight = 1 / np.maximum([point.u_gain for point in points], LEAST_U * np.abs(response))
    middle_hz = float(np.mean(frequency_hz))
    try:
        fit = fit_nonlinear(
            _model(frequency_hz / middle_hz, weight), _apart(response * weight), start,
            names=NAMES,
        )  # fmt: skip
    except (NotDetermined, NotConverged):
        return None
    away = fit.residuals / np.concatenate([weight, weight])
    if np.max(np.abs(away)) > DESCRIBES * np.max(np.abs(response)):
        return None
    return _equation(fit, middle_hz, model_id, skew_u_s, (float(frequency_hz[0]), float(frequency_hz[-1])))


def _equation(
    fit: NonlinearFit, middle_hz: float, model_id: tuple[str, str], skew_u_s: float, valid_hz: tuple[float, float]
) -> Equation:
    scale = np.array([1.0, middle_hz, 1.0, 1 / middle_hz])
    value, u = fit.parameters * scale, fit.u * scale
    u[3] = np.hypot(u[3], skew_u_s)
    covariance = fit.covariance * np.outer(scale, scale)
    covariance[3, 3] = u[3] ** 2
    units = ("1", "Hz", "1", "s")
    return Equation(
        id=model_id[0],
        uut=model_id[1],
        quantity="response",
        form=FORM,
        constants={
            name: Constant(float(value[i]), units[i], float(u[i]) if np.isfinite(u[i]) else None)
            for i, name in enumerate(NAMES)
        },
        valid={"frequency_hz": valid_hz},
        correlation=tuple(tuple(row) for row in (covariance / np.outer(u, u)).tolist()),
    )


def _model(x: Array, weight: Array) -> Model:
    """Weighted real parts, then imaginary ones, and their derivatives; frequency and delay are scaled."""

    def model(parameters: Array) -> tuple[Array, Array]:
        gain, natural, damping, delay = parameters
        part = x / natural
        bend = 1 - part**2 + 2j * damping * part
        value = second_order(x, gain, natural, damping, delay)
        by_natural = -value * (2 * part**2 - 2j * damping * part) / natural / bend
        columns = [value / gain, by_natural, -value * 2j * part / bend, -2j * np.pi * x * value]
        return _apart(value * weight), np.column_stack([_apart(column * weight) for column in columns])

    return model


def _apart(values: Array | NDArray[np.complex128]) -> Array:
    return np.concatenate([np.real(values), np.imag(values)])


def _start(frequency_hz: Array, response: Array, middle_hz: float) -> Array:
    """Start values: half the power at the natural frequency, damping without a peak, delay from the rest of the lag."""
    gain = np.abs(response)
    below = np.flatnonzero(gain < gain[0] / np.sqrt(2))
    natural_hz = frequency_hz[below[0]] if len(below) else frequency_hz[-1]
    lag_s = -np.angle(response[0]) / (2 * np.pi * frequency_hz[0])
    delay_s = max(lag_s - 1.4 / (2 * np.pi * natural_hz), 0.0)
    return np.array([gain[0], natural_hz / middle_hz, 0.7, delay_s * middle_hz])
