"""Results of a tumble over temperature against the truth: series, lines, loops, residuals and the closure.

The definitions, put to what the channel really was at the dwells, at the temperatures that the results state.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from campaigns.truth.campaign import Comparison, results_of, true_constants

QUANTITIES = ("K0T1", "K0T2", "K1T1", "K1T2")


def compare_coefficients(folder: Path) -> list[Comparison]:
    """Every coefficient of a run beside its truth."""
    truth = json.loads((folder / "truth.json").read_text("utf-8"))
    return [each for each in compared(truth, results_of(folder)) if each.quantity in QUANTITIES]


def compared(truth: dict, results: dict) -> list[Comparison]:
    """Compare a truth with results, including all results over temperature."""
    figures = {quantity: value for constant in ("K0", "K1") for quantity, value in _figures(truth, results, constant)}
    return [
        Comparison.of(truth["seed"], found, figures[key], found["at"].get("point", 0))
        for found in results["findings"]
        if (key := _key(found)) in figures
    ]


def _key(found: dict) -> str:
    """Quantity of a finding, of a loop with its two dwells."""
    return "@".join([found["quantity"], *found["at"]["dwells"]]) if "point" in found["at"] else found["quantity"]


def _figures(truth: dict, results: dict, constant: str) -> Iterator[tuple[str, float]]:
    found = results["findings"]
    dwells = [each for each in found if each["quantity"] == constant and "@" in each["id"]]
    values = np.array([true_constants(truth, each)[constant] for each in dwells])
    at_c = np.array([each["at"]["temperature_c"] for each in dwells])
    degree = max((int(model["id"][-1]) for model in results["models"] if model["quantity"] == constant), default=0)
    if not degree:
        return
    model, line = Polynomial.fit(at_c, values, degree), Polynomial.fit(at_c, values, 1)
    middle_c = (at_c.min() + at_c.max()) / 2
    relative = 1.0 if constant == "K0" else 1 / float(line(middle_c))
    yield f"{constant}/temperature_coefficient", float(line.deriv()(middle_c)) * relative
    reference_c = next((each["at"]["at_c"] for each in found if each["quantity"] == f"{constant}T1"), 0.0)
    own = 1.0 if constant == "K0" else 1 / float(model(reference_c))
    yield f"{constant}T1", float(model.deriv()(reference_c)) * own
    if degree > 1:
        yield f"{constant}T2", float(model.deriv(2)(reference_c)) / 2 * own
    yield f"{constant}/model_residual", float(np.max(np.abs(values - model(at_c)))) * abs(relative)
    if loops := dict(_loops(dwells, values, at_c, model)):
        yield f"{constant}/hysteresis", max(map(abs, loops.values())) * abs(relative)
        yield from ((f"{constant}/loop@{where}", loop * relative) for where, loop in loops.items())
    if constant == "K0":
        yield "K0/closure", _apart(values, at_c, model, len(values) - 1, 0)


def _loops(
    dwells: list[dict[str, Any]], values: np.ndarray, at_c: np.ndarray, model: Polynomial
) -> Iterator[tuple[str, float]]:
    """Rising less falling of every two dwells of one cycle at one set point, by the paths of both."""
    paths = [each["id"].partition("@")[2] for each in dwells]
    for i, up in enumerate(each["at"] for each in dwells):
        for j, down in enumerate(each["at"] for each in dwells):
            same = (up["cycle"], up["temperature_set_c"]) == (down["cycle"], down["temperature_set_c"])
            if same and (up["leg"], down["leg"]) == ("up", "down"):
                yield f"{paths[i]}@{paths[j]}", _apart(values, at_c, model, i, j)


def _apart(values: np.ndarray, at_c: np.ndarray, model: Polynomial, i: int, j: int) -> float:
    """By how much one dwell is more than another, brought to one temperature."""
    return float(values[i] - values[j] - model.deriv()((at_c[i] + at_c[j]) / 2) * (at_c[i] - at_c[j]))
