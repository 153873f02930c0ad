"""Findings of the temperature coefficients of a model, each with its budget (equations 6.7)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from bench.methods.tumble.reduction.coefficients import bias_coefficients, scale_coefficients
from bench.metrology.least_squares import Array, PolynomialFit
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import Finding, Subject

TERMS = ("linear", "quadratic")
CONTAINED = "residuals of the model: contained"


@dataclass(frozen=True)
class Origin:
    """Source of a model: the unit, and the steps of the run.

    `budget` returns the lines of a result with sensitivities (n,) to the fitted values.
    """

    subject: Subject
    steps: tuple[str, ...]
    budget: Callable[[Array], Sequence[BudgetLine]]


def coefficient_findings(quantity: str, model: PolynomialFit, reference_c: float, origin: Origin) -> Iterator[Finding]:
    """T1 and T2 of K0 in g, or of K1 relative to it, about a reference temperature; a straight line has no T2.

    They describe the unit at these dwells, so that residuals of the model, such as hysteresis, are contained in the
    values and contribute no uncertainty: a second run of the same profile would give the same. Errors that are common
    to all dwells, of the head and of the time base, cancel.
    """
    of_bias = quantity == "K0"
    found = (bias_coefficients if of_bias else scale_coefficients)(model, reference_c)
    for index, value in enumerate((found.t1, found.t2)[: model.degree]):
        lines = [*origin.budget(found.gain[index]), BudgetLine(CONTAINED, "alias", 0)]
        name = f"{TERMS[index]} temperature coefficient of the {'bias' if of_bias else 'scale factor'}"
        unit = ("g/°C" if of_bias else "1/°C") + "²" * index
        yield origin.subject.finding(
            f"{quantity}T{index + 1}", name, value, unit, lines, {"at_c": reference_c}, origin.steps,
            flags=("extrapolated",) if found.extrapolated else (),
        )  # fmt: skip
