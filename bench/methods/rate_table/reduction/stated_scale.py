"""The scale factor that a sequence states of a sensor on a rate table, and how well it is known of it."""

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
    """What makes a value in the unit `symbol` of the output of a unit, as its sequence says."""
    scale: float = settings["scale"][unit.output_unit]
    u = abs(scale) * settings.get("scale_u", 0.0)
    if symbol == "g":
        return Constant(scale, f"{unit.output_unit}/g", u)
    return Constant(scale, "pulse/°" if unit.is_counted else f"{unit.output_unit}/({symbol})", u)


def of_stated_scale(
    at_c: float, settings: Mapping[str, Any], data: RunData, unit: UnitUnderTest
) -> tuple[BudgetLine, ...]:
    """What the stated scale factor of an accelerometer gives to a value of 1 that goes with it.

    It is stated at one temperature, and the unit is at another, NaN where that is not known.
    """
    away_c = float(np.hypot(at_c - settings["scale_c"], data.bench.temperature_u_c(unit.temperature, at_c)))
    return (
        BudgetLine(STATED, "B", settings["scale_u"], None, "scale"),
        BudgetLine(STATED_AT, "B", settings["scale_per_c_u"] * away_c, None, shared_per_degree(data, unit)),
    )


def shared_per_degree(data: RunData, unit: UnitUnderTest) -> str:
    """The name of the error that the change of a unit's scale factor with temperature is in all its results."""
    return data.subject(unit).id("scale_per_degree")
