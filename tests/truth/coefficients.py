"""Temperature coefficients against the truth: the same series, of a fit through what the channel really was."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from tests.truth.campaign import Comparison, results_of, true_constants

QUANTITIES = ("K0T1", "K0T2", "K1T1", "K1T2")


def compare_coefficients(folder: Path) -> list[Comparison]:
    """Every coefficient of a run beside its truth."""
    truth, results = json.loads((folder / "truth.json").read_text("utf-8")), results_of(folder)
    compared = []
    for found in results["findings"]:
        if found["quantity"] in QUANTITIES:
            quantity, order = found["quantity"][:2], int(found["quantity"][3])
            at_dwells = [each for each in results["findings"] if each["quantity"] == quantity and "@" in each["id"]]
            temperature_c = np.array([each["at"]["temperature_c"] for each in at_dwells]) - found["at"]["at_c"]
            values = [true_constants(truth, each)[quantity] for each in at_dwells]
            degree = max(int(model["id"][-1]) for model in results["models"] if model["quantity"] == quantity)
            powers = np.polynomial.Polynomial.fit(temperature_c, values, degree).convert().coef
            true = powers[order] / (1.0 if quantity == "K0" else powers[0])
            compared.append(Comparison(truth["seed"], 0, found["quantity"], found["value"], true, found["u"]))
    return compared
