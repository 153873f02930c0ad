"""Stated scale factor of a sensor on a rate table, and its uncertainty."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.curves import Constant
from bench.metrology.run_data import RunData, UnitUnderTest

STATED = "scale factor as stated"
STATED_AT = "scale factor: temperature against that at which it is stated"


def stated_scale(unit: UnitUnderTest, settings: Mapping[str, Any], symbol: str) -> Constant:
    """Factor from the output of a unit to a value in the unit `symbol`, as stated by its sequence."""
    scale: float = settings["scale"][unit.output_unit]
    u = abs(scale) * settings.get("scale_u", 0.0)
    if symbol == "g":
        return Constant(scale, f"{unit.output_unit}/g", u)
    return Constant(scale, "pulse/°" if unit.is_counted else f"{unit.output_unit}/({symbol})", u)


def of_stated_scale(
    at_c: float, settings: Mapping[str, Any], data: RunData, unit: UnitUnderTest
) -> tuple[BudgetLine, ...]:
    """Lines of the stated scale factor of an accelerometer for a value of 1 proportional to it.

    It is stated at one temperature; the unit is at another, NaN if unknown.
    """
    away_c = float(np.hypot(at_c - settings["scale_c"], data.bench.temperature_u_c(unit.temperature, at_c)))
    return (
        BudgetLine(STATED, "B", settings["scale_u"], None, "scale"),
        BudgetLine(STATED_AT, "B", settings["scale_per_c_u"] * away_c, None, shared_per_degree(data, unit)),
    )


def shared_per_degree(data: RunData, unit: UnitUnderTest) -> str:
    """Identifier of the temperature coefficient of a unit's scale factor as one error common to all its results."""
    return data.subject(unit).id("scale_per_degree")
