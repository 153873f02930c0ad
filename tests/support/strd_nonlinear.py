"""Nonlinear reference data sets of NIST StRD, with their models, from `strd_nonlinear.txt`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

Function = Callable[[np.ndarray, np.ndarray], np.ndarray]
FILE = Path(__file__).with_suffix(".txt")


def _peak(x, height, centre, width):
    return height * np.exp(-((x - centre) ** 2) / width**2)


def _wave(x, cosine, sine, period):
    return cosine * np.cos(2 * np.pi * x / period) + sine * np.sin(2 * np.pi * x / period)


def _cubics(b, x):
    return (b[0] + b[1] * x + b[2] * x**2 + b[3] * x**3) / (1 + b[4] * x + b[5] * x**2 + b[6] * x**3)


MODELS: dict[str, Function] = {
    "Misra1a": lambda b, x: b[0] * (1 - np.exp(-b[1] * x)),
    "Misra1b": lambda b, x: b[0] * (1 - (1 + b[1] * x / 2) ** -2),
    "Chwirut1": lambda b, x: np.exp(-b[0] * x) / (b[1] + b[2] * x),
    "Chwirut2": lambda b, x: np.exp(-b[0] * x) / (b[1] + b[2] * x),
    "DanWood": lambda b, x: b[0] * x ** b[1],
    "Gauss1": lambda b, x: b[0] * np.exp(-b[1] * x) + _peak(x, *b[2:5]) + _peak(x, *b[5:8]),
    "Kirby2": lambda b, x: (b[0] + b[1] * x + b[2] * x**2) / (1 + b[3] * x + b[4] * x**2),
    "Hahn1": _cubics,
    "MGH17": lambda b, x: b[0] + b[1] * np.exp(-x * b[3]) + b[2] * np.exp(-x * b[4]),
    "MGH10": lambda b, x: b[0] * np.exp(b[1] / (x + b[2])),
    "Thurber": _cubics,
    "BoxBOD": lambda b, x: b[0] * (1 - np.exp(-b[1] * x)),
    "Rat42": lambda b, x: b[0] / (1 + np.exp(b[1] - b[2] * x)),
    "Rat43": lambda b, x: b[0] / (1 + np.exp(b[1] - b[2] * x)) ** (1 / b[3]),
    "Eckerle4": lambda b, x: b[0] / b[1] * np.exp(-0.5 * ((x - b[2]) / b[1]) ** 2),
    "Bennett5": lambda b, x: b[0] * (b[1] + x) ** (-1 / b[2]),
    "Lanczos3": lambda b, x: sum(b[i] * np.exp(-b[i + 1] * x) for i in (0, 2, 4)),
    "ENSO": lambda b, x: b[0] + _wave(x, b[1], b[2], 12) + _wave(x, b[4], b[5], b[3]) + _wave(x, b[7], b[8], b[6]),
}


@dataclass(frozen=True)
class Reference:
    """A data set; `parameters`, `deviations` and `residual_sum` of squares are the certified ones."""

    start: np.ndarray
    parameters: np.ndarray
    deviations: np.ndarray
    residual_sum: float
    x: np.ndarray
    y: np.ndarray


def reference(name: str) -> Reference:
    """A data set by its name."""
    keys = ("start", "parameters", "deviations", "residual_sum", "data")
    text = FILE.read_text().split(f"[{name}]")[1].split("[")[0]
    values = {}
    for key, following in zip(keys, (*keys[1:], None), strict=True):
        part = text.split(f"{key}:")[1]
        values[key] = (part.split(f"{following}:")[0] if following else part).split()
    y, x = np.array([pair.split(",") for pair in values["data"]], dtype=float).T
    start, parameters, deviations, (residual_sum,) = (np.array(values[key], dtype=float) for key in keys[:4])
    return Reference(start, parameters, deviations, float(residual_sum), x, y)


def with_jacobian(function: Function, x: np.ndarray) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """The model at x with its derivatives by steps in the imaginary direction, which are as exact as the function."""

    def model(b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        columns = [np.imag(function(b + 1e-150j * one, x)) / 1e-150 for one in np.eye(len(b))]
        return function(b, x), np.stack(columns, axis=-1)

    return model
