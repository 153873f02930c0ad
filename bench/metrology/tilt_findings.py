"""Tilt error of an accelerometer with a drifting bias, with and without compensation (equations 6.4).

Held level it indicates asin((U - K0) / K1), with a constant K0, or with the model of K0 over temperature: the static
one of a tumble, the dynamic one of a ramp, for uses with fast changes. The span of the indicated tilt is the effect of
the bias for the user.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bench.metrology.extremes import interval_of_span, span_u
from bench.metrology.least_squares import Array
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import Finding, Subject
from bench.metrology.tilt import indicated_deg

SCATTER = "readings: scatter"
SELECTION = "readings: scatter makes the span of many larger"
NAMES = {
    "tilt/uncompensated": "span that it indicates over the temperatures, held level, with a constant bias",
    "tilt/compensated": "the same with the model of the bias over temperature, fitted to the same data (in sample)",
    "tilt/verified": "span that it indicates over the temperatures, held level, with the calibration of an earlier run",
    "tilt/verified_dynamic": "the same with the dynamic model of that calibration",
}


@dataclass(frozen=True, slots=True)
class TiltOrigin:
    """Source of the tilt; `sd_g` is the standard deviation of one bias, with `dof`.

    `scale_u` is the relative uncertainty of K1, `contained` names confounded terms of the compensated span, "" for
    none.
    """

    subject: Subject
    steps: tuple[str, ...]
    sd_g: float
    dof: int | None
    scale_u: float = 0.0
    scale_shared: str | None = None
    contained: str = ""


def tilt_findings(bias_g: Array, modelled_g: Array, origin: TiltOrigin) -> Iterator[Finding]:
    """Spans from biases (n,) at many temperatures, and from the model there; none for fewer than two."""
    if len(bias_g) < 2:
        return
    for quantity, left_g in (
        ("tilt/uncompensated", bias_g - np.mean(bias_g)), ("tilt/compensated", bias_g - modelled_g),
    ):  # fmt: skip
        yield from span_finding(quantity, left_g, origin, origin.contained if quantity == "tilt/compensated" else "")


def span_finding(
    quantity: str, left_g: Array, origin: TiltOrigin, contained: str = "", more: Sequence[BudgetLine] = ()
) -> Iterator[Finding]:
    """Span of the tilt indicated with biases (n,) left by a model; none for fewer than two, or beyond ±90°.

    `more` are contributions in ° besides scatter and scale.
    """
    span_deg = float(np.ptp(indicated_deg(left_g))) if len(left_g) > 1 else np.nan
    if not np.isfinite(span_deg):
        return
    yield origin.subject.finding(
        quantity, NAMES[quantity], span_deg, "°", [*more, *_lines(left_g, span_deg, origin, contained)], {},
        origin.steps,
        interval=interval_of_span(left_g, origin.sd_g).times(float(np.degrees(1.0))).beside(
            math.hypot(*(line.u for line in more))
        ),
    )  # fmt: skip


def _lines(left_g: Array, span_deg: float, origin: TiltOrigin, contained: str) -> Sequence[BudgetLine]:
    by_scatter, by_selection = (float(np.degrees(u)) for u in span_u(left_g, origin.sd_g))
    lines = [
        BudgetLine(SCATTER, "A", by_scatter, origin.dof),
        BudgetLine(SELECTION, "A", by_selection),
        BudgetLine("K1: misalignment in it", "B", span_deg * origin.scale_u, None, origin.scale_shared),
    ]
    return [*lines, BudgetLine(contained, "alias", 0.0)] if contained else lines
