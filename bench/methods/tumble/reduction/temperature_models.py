"""Models of a quantity over the temperatures of its dwells, and its hysteresis, of runs and cases (equations 6.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.methods.tumble.reduction.dwells import SolvedDwell
from bench.methods.tumble.reduction.solution import Hysteresis, hysteresis
from bench.metrology.least_squares import Array, NotDetermined, PolynomialFit, choose_degree, fit_polynomial
from bench.metrology.results.flag import ILL_CONDITIONED, TOO_FEW_TEMPERATURES, Flag

HIGHEST_DEGREE = 4


@dataclass(frozen=True, slots=True)
class TemperatureModels:
    """One quantity over temperature: None where the temperatures allow no model, no line or no comparison of both ways.

    Flags: `<quantity>:too_few_temperatures` where the model has a lower degree than was asked for, or there is none;
    `<quantity>:ill_conditioned` where the temperatures measured do not determine a fit.
    """

    model: PolynomialFit | None
    line: PolynomialFit | None
    loop: Hysteresis | None
    flags: tuple[Flag, ...]


def temperature_models(
    quantity: str, value: Array, dwells: Sequence[SolvedDwell], degree: int | None, *, lowest: int = 1
) -> TemperatureModels:
    """Models of `value` (n,), one for each dwell: of `degree`, or of the highest that the set points allow.

    None chooses the degree by the data among 1 to 4. `lowest` is the degree below which there is no model: 0 takes the
    mean of one set point for a model.
    """
    temperature_c = np.array([dwell.temperature_c for dwell in dwells])
    set_c = np.array([dwell.set_c for dwell in dwells])
    allowed = len(np.unique(set_c)) - 1
    flags = [Flag(TOO_FEW_TEMPERATURES, of=quantity)] if allowed < (degree or 1) else []

    def fitted(wanted: int) -> PolynomialFit | None:
        try:
            return fit_polynomial(temperature_c, value, wanted)
        except NotDetermined:
            flags.append(Flag(ILL_CONDITIONED, of=quantity))
            return None

    wanted = choose_degree(temperature_c, value, min(HIGHEST_DEGREE, max(allowed, 1))) if degree is None else degree
    model = fitted(min(wanted, allowed)) if allowed >= lowest else None
    line = fitted(1) if allowed >= 1 else None
    loop = None if model is None else hysteresis(
        value, temperature_c, set_c, slope=model.slope,
        rising=np.array([dwell.rising for dwell in dwells]), cycle=np.array([dwell.cycle for dwell in dwells]),
    )  # fmt: skip
    return TemperatureModels(model, line, loop, tuple(flags))
