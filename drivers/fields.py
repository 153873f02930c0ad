"""Field types of the project's pydantic models: a number in the unit that its name states.

`dwell_s: Seconds` accepts "1 h 30 min" and holds 5400.0. While a sequence is checked before its loops are expanded,
a field may hold an expression whose value is not known yet; it then validates as not-a-number (`DEFERRED`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    GetCoreSchemaHandler,
    ModelWrapValidatorHandler,
    ValidationError,
    model_validator,
)
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError, core_schema

from drivers.quantities import NO_DIMENSION, Quantity, QuantityError, parse, parse_unit
from drivers.suggest import did_you_mean

DEFERRED = {"deferred": True}


@dataclass(frozen=True, slots=True)
class InUnit:
    """Validates text, a Quantity or (for ratios) a bare number into a float in `unit`."""

    unit: str
    at_least: float | None = None
    above: float | None = None
    at_most: float | None = None

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_plain_validator_function(self._validate)

    def _validate(self, raw: object, info: core_schema.ValidationInfo) -> float:
        if isinstance(raw, str) and "${" in raw and is_deferred(info.context):
            return math.nan
        try:
            value = self._quantity(raw).to(self.unit)
        except QuantityError as problem:
            raise PydanticCustomError("quantity", "{problem}", {"problem": str(problem)}) from None
        for bad, words, bound in (
            (self.at_least is not None and value < self.at_least, "at least", self.at_least),
            (self.above is not None and value <= self.above, "more than", self.above),
            (self.at_most is not None and value > self.at_most, "at most", self.at_most),
        ):
            if bad:
                message = f"is {value:g} {self.unit}, expected {words} {bound:g} {self.unit}"
                raise PydanticCustomError("quantity_range", "{problem}", {"problem": message})
        return value

    def _quantity(self, raw: object) -> Quantity:
        if isinstance(raw, Quantity):
            return raw
        if isinstance(raw, str):
            quantity = parse(raw)
            if quantity.dimension == NO_DIMENSION and parse_unit(self.unit).dimension != NO_DIMENSION:
                raise QuantityError(f"'{raw}' has no unit, expected a quantity in {self.unit}")
            return quantity
        if isinstance(raw, (int, float)) and not isinstance(raw, bool):
            if parse_unit(self.unit).dimension == NO_DIMENSION and math.isfinite(raw):
                return Quantity(float(raw))
            raise QuantityError(f"{raw} has no unit, write it like '{raw} {self.unit}'")
        raise QuantityError(f"expected a quantity in {self.unit or 'no unit'}, found {type(raw).__name__}")


def is_deferred(context: object) -> bool:
    """Whether a validation lets expressions pass unevaluated."""
    return isinstance(context, Mapping) and bool(context.get("deferred"))


Seconds = Annotated[float, InUnit("s", at_least=0)]
PositiveSeconds = Annotated[float, InUnit("s", above=0)]
Celsius = Annotated[float, InUnit("°C")]
PositiveCelsius = Annotated[float, InUnit("°C", above=0)]
CelsiusPerMinute = Annotated[float, InUnit("°C/min", above=0)]
CelsiusPerHour = Annotated[float, InUnit("°C/h", above=0)]
Degrees = Annotated[float, InUnit("°")]
DegreesPerSecond = Annotated[float, InUnit("°/s", above=0)]
Arcseconds = Annotated[float, InUnit("arcsec", at_least=0)]
Volts = Annotated[float, InUnit("V", at_least=0)]
PositiveAmperes = Annotated[float, InUnit("A", at_least=0)]
Amperes = Annotated[float, InUnit("A")]
Ratio = Annotated[float, InUnit("")]
Hertz = Annotated[float, InUnit("Hz", above=0)]


def _spelled(raw: object) -> object:
    """A serial number of digits only is a number to YAML; one with a point has lost what was written."""
    if isinstance(raw, float):
        raise PydanticCustomError("spelled", "put it in quotes, so that it is kept as it is written")
    return str(raw) if isinstance(raw, int) and not isinstance(raw, bool) else raw


Spelled = Annotated[str, BeforeValidator(_spelled)]


@dataclass(frozen=True, slots=True)
class FileBeside:
    """Validates the name of a file into the path of an existing one in the folder of the document, or below it.

    With `files_needed: False` in the context it need not exist: a bench file kept in a run names more than was kept.
    """

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_plain_validator_function(self._validate)

    def _validate(self, raw: object, info: core_schema.ValidationInfo) -> Path:
        context = info.context or {}
        folder = context.get("folder")
        if not isinstance(raw, str) or not raw or not isinstance(folder, Path):
            raise PydanticCustomError("file", "expected the name of a file beside this one")
        path = (folder / raw).resolve()
        if not path.is_relative_to(folder.resolve()):
            raise PydanticCustomError("file", "{problem}", {"problem": f"'{raw}' leaves the folder of this file"})
        if context.get("files_needed", True) and not path.is_file():
            raise PydanticCustomError("file", "{problem}", {"problem": f"there is no file '{raw}' beside this one"})
        return path


class StrictModel(BaseModel):
    """Frozen, closed: an unknown key is an error that suggests the right one."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True, arbitrary_types_allowed=True)

    @model_validator(mode="wrap")
    @classmethod
    def _suggest_keys(cls, data: Any, handler: ModelWrapValidatorHandler[Any]) -> Any:
        try:
            return handler(data)
        except ValidationError as error:
            raise _with_suggestions(error, cls) from None


def keys_of(model: type[BaseModel]) -> list[str]:
    """The keys a document may use for the fields of `model`."""
    return [field.alias or name for name, field in model.model_fields.items()]


def inner_errors(error: ValidationError, place: tuple[str | int, ...] = ()) -> list[InitErrorDetails]:
    """The errors of a part, to be raised again by the whole it stands in at `place`."""
    return [
        InitErrorDetails(
            type=PydanticCustomError("part", "{problem}", {"problem": item["msg"]}),
            loc=(*place, *item["loc"]),
            input=item["input"],
        )
        for item in error.errors(include_url=False)
    ]


def _with_suggestions(error: ValidationError, model: type[BaseModel]) -> ValidationError:
    """The same errors in plain words; an unknown key of `model` itself says which keys there are."""
    details = inner_errors(error)
    for index, item in enumerate(error.errors(include_url=False)):
        kind: PydanticCustomError
        if item["type"] == "extra_forbidden" and len(item["loc"]) == 1:
            problem = f"unknown key '{item['loc'][0]}'" + did_you_mean(str(item["loc"][0]), keys_of(model))
            kind = PydanticCustomError("unknown_key", "{problem}", {"problem": problem})
        elif item["type"] == "missing":
            kind = PydanticCustomError("missing_key", "the key is missing")
        else:
            continue
        details[index]["type"] = kind
    return ValidationError.from_exception_data(model.__name__, details)
