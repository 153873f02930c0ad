"""Limits in a document: min and max, or a target with its tolerance; guard band, marginal band; largest uncertainty."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, Self

from pydantic import ConfigDict, Field, PlainValidator, ValidationInfo, WithJsonSchema, model_validator
from pydantic.config import JsonDict

from bench.metrology.results.limits import Limits
from bench.sequence.language.expressions import ValueProblem
from bench.sequence.language.values import QUANTITY_SCHEMA, holds_expression, in_words, value_of
from bench.sequence.steps.fields import is_known
from drivers.quantity.quantities import Quantity
from drivers.quantity.units import NO_DIMENSION, QuantityError, parse_unit
from drivers.schema.fields import UNKNOWN, InUnit, StrictModel, is_deferred
from drivers.schema.wording import expected, telling


def quantity(raw: Any) -> Quantity:
    """Parse a quantity of a document, for a validator; raises an error with the message."""
    try:
        value = value_of(raw)
    except ValueProblem as problem:
        raise telling(str(problem)) from None
    if not isinstance(value, Quantity):
        raise expected("a quantity", raw)
    return value


def _bound(raw: Any, info: ValidationInfo) -> Quantity:
    return UNKNOWN if holds_expression(raw) and is_deferred(info.context) else quantity(raw)


Bound = Annotated[Quantity | None, PlainValidator(_bound), WithJsonSchema(QUANTITY_SCHEMA)]
PositiveRatio = Annotated[float, InUnit("", above=0)]

# For the schema: keys that belong together.
_FORMS: JsonDict = {
    "oneOf": [
        {"anyOf": [{"required": ["min"]}, {"required": ["max"]}], "properties": {"target": False}},
        {"required": ["target", "tolerance"], "properties": {"min": False, "max": False, "relative": False}},
        {"required": ["target", "relative"], "properties": {"min": False, "max": False, "tolerance": False}},
        {"required": ["u_max"], "properties": dict.fromkeys(("min", "max", "target", "guard", "marginal"), False)},
    ],
    "dependentRequired": {"tolerance": ["target"], "relative": ["target"]},
}


class LimitEntry(StrictModel):
    """Limits of a value: from min to max, or target ± tolerance (in its unit) or ± relative (a ratio of it).

    With guard, a value passes only if it is inside by at least that many of its standard uncertainties. It is marginal
    if a limit is closer than marginal, by default its expanded uncertainty. With u_max, alone or beside other limits, a
    value passes only if its standard uncertainty is known and at most that: otherwise it is invalid, because the bench
    and not the unit is at fault.
    """

    model_config = ConfigDict(json_schema_extra=_FORMS)

    min: Bound = Field(None, description="lower limit")
    max: Bound = Field(None, description="upper limit")
    target: Bound = Field(None, description="nominal value")
    tolerance: Bound = Field(None, description="± tolerance of the target, in its unit")
    relative: PositiveRatio | None = Field(None, description="± tolerance of the target, as a ratio of it")
    guard: PositiveRatio | None = Field(None, description="guard band inside the limits, in standard uncertainties")
    marginal: Bound = Field(
        None, description="distance from a limit below which a value is marginal; default: its expanded uncertainty"
    )

    u_max: Bound = Field(
        None, description="largest standard uncertainty, in the unit of the value or as a ratio of it, such as 20 ppm"
    )

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if problem := self._problem_of_keys() or self._problem_of_sizes():
            raise telling(problem)
        return self

    def _problem_of_keys(self) -> str:
        has_sides = self.min is not None or self.max is not None
        widths = [key for key in ("tolerance", "relative") if getattr(self, key) is not None]
        if self.target is None:
            if widths:
                return f"{widths[0]} needs a target"
            return "" if has_sides else self._problem_without_sides()
        if has_sides:
            return "give min and max, or a target with its tolerance, not both"
        if not widths:
            return "a target needs tolerance, ± in its unit, or relative, ± a ratio of it"
        return "give tolerance or relative, not both" if len(widths) > 1 else ""

    def _problem_without_sides(self) -> str:
        bands = [key for key in ("guard", "marginal") if getattr(self, key) is not None]
        if self.u_max is None:
            return "needs min or max, or both, or a target with its tolerance, or u_max"
        return f"{bands[0]} needs min or max, or a target with its tolerance" if bands else ""

    def _problem_of_sizes(self) -> str:
        """Problem of the known values; their unit is checked by the caller."""
        target, tolerance = self.target, self.tolerance
        if self.min is not None and self.max is not None and _is_above(self.min, self.max):
            return "min is above max"
        if target is not None and tolerance is not None and not _go_together(target, tolerance):
            hint = "; write relative for a ratio of it" if tolerance.dimension == NO_DIMENSION else ""
            return f"tolerance is {in_words(tolerance)}, target is {in_words(target)}{hint}"
        if tolerance is not None and tolerance.base_value <= 0:
            return f"tolerance is {in_words(tolerance)}, expected more than 0"
        if target is not None and self.relative is not None and target.base_value == 0:
            return "nothing is relative to a target of 0; give tolerance, in its unit"
        if target is not None and math.isinf(abs(target.base_value) + self._width_of(target)):
            return "the target and its tolerance together are no finite number"
        if self.marginal is not None and self.marginal.base_value < 0:
            return f"marginal is {in_words(self.marginal)}, expected at least 0"
        if self.u_max is not None and self.u_max.base_value <= 0:
            return f"u_max is {in_words(self.u_max)}, expected more than 0"
        return ""

    def _width_of(self, target: Quantity) -> float:
        """Half-width of the tolerance about a target, in base units."""
        return abs(target.base_value) * (self.relative or 0.0) if self.tolerance is None else self.tolerance.base_value

    @property
    def sides(self) -> tuple[Quantity | None, Quantity | None]:
        """Lower and upper limit."""
        if self.target is None:
            return self.min, self.max
        width = Quantity(self._width_of(self.target), self.target.dimension)
        return self.target - width, self.target + width


def _go_together(one: Quantity, other: Quantity) -> bool:
    """True if two quantities have one dimension, as far as they are known."""
    return one.dimension == other.dimension or not (is_known(one) and is_known(other))


def _is_above(low: Quantity, high: Quantity) -> bool:
    return low.dimension == high.dimension and low > high


def unit_problems(entry: LimitEntry, unit: str) -> Iterator[tuple[str, str]]:
    """Keys of limits known to be in another unit than the limited quantity, with their problems."""
    for key in ("min", "max", "target", "tolerance", "marginal"):
        value = getattr(entry, key)
        try:
            if is_known(value):
                value.to(unit)
        except QuantityError as problem:
            yield key, f"{key}: {problem}"
    if entry.u_max is not None and (wrong := ratio_problem(entry.u_max, unit)):
        yield "u_max", f"u_max: {wrong}"


def ratio_problem(value: Quantity, unit: str) -> str:
    """Problem of a value known to be neither in a unit nor a ratio; empty without one."""
    try:
        if is_known(value):
            value_or_ratio(unit, value)
    except QuantityError as problem:
        return f"{problem}, or a ratio, such as 20 ppm"
    return ""


def limits_in(entry: LimitEntry, unit: str) -> Limits:
    """Limits as numbers in `unit`; QuantityError if they are in another dimension."""
    low, high = entry.sides
    u_max, u_max_relative = (None, None) if entry.u_max is None else value_or_ratio(unit, entry.u_max)
    return Limits(
        low=_in(unit, low),
        high=_in(unit, high),
        target=_in(unit, entry.target),
        guard_k=entry.guard,
        marginal=_in(unit, entry.marginal),
        u_max=u_max,
        u_max_relative=u_max_relative,
    )


def value_or_ratio(unit: str, value: Quantity) -> tuple[float | None, float | None]:
    """Value in `unit` and None, or None and a ratio if it has no dimension and `unit` has one; QuantityError."""
    if value.dimension == NO_DIMENSION and parse_unit(unit).dimension != NO_DIMENSION:
        return None, value.base_value
    return value.to(unit), None


def _in(unit: str, value: Quantity | None) -> float | None:
    return None if value is None else value.to(unit)
