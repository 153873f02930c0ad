"""Field types of the project's pydantic models: a number in the unit that its name states.

`dwell_s: Seconds` accepts "1 h 30 min" and holds 5400.0. While a sequence is checked before its loops are expanded,
a field may hold an expression whose value is not known yet; it then validates as not-a-number (`DEFERRED`).
"""

from __future__ import annotations

import datetime as dt
import math
import re
import stat
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Generic, Self, TypeVar

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ModelWrapValidatorHandler,
    PlainValidator,
    Strict,
    ValidationError,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import CoreSchema, InitErrorDetails, core_schema

from drivers.quantity.quantities import Quantity, as_quantity, parse
from drivers.quantity.units import NO_DIMENSION, QuantityError, in_unit, parse_unit, quoted
from drivers.schema.suggest import did_you_mean, nearest
from drivers.schema.wording import error_text, expected, telling, value_text

ContentT = TypeVar("ContentT", bound=BaseModel)

DEFERRED = {"deferred": True}
UNKNOWN = Quantity(math.nan)  # value of an expression that is not evaluated yet
UNIT_KEYWORD = "x-unit"  # extension of JSON Schema: the unit of a quantity


@dataclass(frozen=True, slots=True)
class InUnit:
    """Validates text, a Quantity or (for ratios) a bare number into a float in `unit`."""

    unit: str
    at_least: float | None = None
    above: float | None = None
    at_most: float | None = None
    not_zero: bool = False

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_plain_validator_function(self._validate)

    def __get_pydantic_json_schema__(self, _: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Schema of a text that names the unit; the format is explained to the author, not checked by an editor."""
        is_ratio = parse_unit(self.unit).dimension == NO_DIMENSION
        allowed = (
            number for number in (1, self.at_least, self.at_most) if number is not None and not self._refusal(number)
        )
        example = self._spelled(next(allowed))
        bounds = (("at least", self.at_least), ("more than", self.above), ("at most", self.at_most))
        words = [in_unit(self.unit), f"like {example}"]
        words += [f"{what} {self._spelled(bound)}" for what, bound in bounds if bound is not None]
        words += ["not 0"] if self.not_zero else []
        return {
            "type": ["number", "string"] if is_ratio else "string", "minLength": 1,
            "description": ", ".join(words), "examples": [example], UNIT_KEYWORD: self.unit,
        }  # fmt: skip

    def _validate(self, raw: object, info: core_schema.ValidationInfo) -> float:
        if isinstance(raw, str) and "${" in raw and is_deferred(info.context):
            return math.nan
        try:
            value = self._quantity(raw).to(self.unit)
        except QuantityError as problem:
            raise telling(str(problem)) from None
        if refusal := self._refusal(value):
            raise telling(f"is {self._spelled(value)}, expected {refusal}")
        return value

    def _refusal(self, value: float) -> str:
        """Text of the violated bound of a number; empty if it keeps them all."""
        for bad, words, bound in (
            (self.at_least is not None and value < self.at_least, "at least", self.at_least),
            (self.above is not None and value <= self.above, "more than", self.above),
            (self.at_most is not None and value > self.at_most, "at most", self.at_most),
        ):
            if bad:
                return f"{words} {self._spelled(bound)}"
        return "a number other than 0" if self.not_zero and value == 0 else ""

    def _spelled(self, number: float | None) -> str:
        return f"{number:.12g} {self.unit}".rstrip()

    def _quantity(self, raw: object) -> Quantity:
        """Parse a quantity, whose dimension `to` checks."""
        is_ratio = parse_unit(self.unit).dimension == NO_DIMENSION
        if isinstance(raw, Quantity):
            return raw
        if isinstance(raw, str) and raw:
            try:
                quantity = parse(raw)
            except QuantityError as problem:
                raise QuantityError(f"{problem}; expected {in_unit(self.unit)}") from None
            if quantity.dimension == NO_DIMENSION and not is_ratio:
                if not raw.strip()[-1].isdigit():
                    raise QuantityError(f"'{raw}' is a ratio, expected {in_unit(self.unit)}")
                raise QuantityError(f"'{raw}' has no unit, write it like '{raw} {self.unit}'")
            return quantity
        if isinstance(raw, (int, float)) and not isinstance(raw, bool) and math.isfinite(raw):
            if is_ratio:
                return Quantity(float(raw))
            raise QuantityError(f"{raw} has no unit, write it like '{raw} {self.unit}'")
        raise QuantityError(f"is {value_text(raw)}, expected {in_unit(self.unit)}")


def is_deferred(context: object) -> bool:
    """Return whether a validation accepts unevaluated expressions."""
    return isinstance(context, Mapping) and bool(context.get("deferred"))


EXPRESSION = r"^\$\{[^{}]*\}$"  # pattern of an expression, for a schema


class _OrExpression:
    """Accepts an expression in place of a text as long as it is not evaluated."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_wrap_validator_function(self._validate, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        expression = {"type": "string", "pattern": EXPRESSION, "description": "an expression ${…}"}
        return {"anyOf": [handler(schema), expression]}

    @staticmethod
    def _validate(
        raw: object, inner: core_schema.ValidatorFunctionWrapHandler, info: core_schema.ValidationInfo
    ) -> object:
        return raw if isinstance(raw, str) and "${" in raw and is_deferred(info.context) else inner(raw)


OR_EXPRESSION = _OrExpression()

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


def _any_quantity(raw: object, info: core_schema.ValidationInfo) -> Quantity:
    if not isinstance(raw, str) or not raw:
        try:
            return as_quantity(raw)
        except QuantityError:
            raise expected("a quantity like 20 °C", raw) from None
    if "${" in raw and is_deferred(info.context):
        return UNKNOWN
    try:
        return parse(raw)
    except QuantityError as problem:
        raise telling(str(problem)) from None


# Unit of a quantity equals that of the limit it is compared with.
AnyQuantity = Annotated[
    Quantity, PlainValidator(_any_quantity), WithJsonSchema({"type": ["number", "string"], "minLength": 1})
]


class _NotEmpty:
    """Validates that a list or a mapping is not empty; min_length would count only its valid entries."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_before_validator_function(self._validate, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        found = handler(schema)
        return {**found, "minItems" if found["type"] == "array" else "minProperties": 1}

    @staticmethod
    def _validate(raw: object) -> object:
        if isinstance(raw, (list, tuple, Mapping)) and not raw:
            raise expected("at least one", raw)
        return raw


NOT_EMPTY = _NotEmpty()
WholeNumber = Annotated[int, Strict()]
Number = Annotated[float, Strict()]
Flag = Annotated[bool, Strict()]


@dataclass(frozen=True, slots=True)
class TextLike:
    """Validates text that completely matches `pattern`; `what` describes it in messages."""

    pattern: str
    what: str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self.validate, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {**handler(schema), "pattern": f"^(?:{self.pattern})$", "description": self.what}

    def validate(self, text: object) -> str:
        """Return the text; raises an error with the message."""
        if not isinstance(text, str):
            raise expected("text", text)
        if re.fullmatch(self.pattern, text) is None:
            raise expected(self.what, text)
        return text


NAME = TextLike("[a-z][a-z0-9_]{0,31}", "a name: at most 32 lower-case letters, digits and _, a letter first")
Name = Annotated[str, NAME]


def _as_written(raw: object) -> object:
    """Text of a serial number that YAML has parsed as an integer; one with a decimal point cannot be restored."""
    if isinstance(raw, float):
        raise telling("put it in quotes, so that it is kept as it is written")
    return str(raw) if isinstance(raw, int) and not isinstance(raw, bool) else raw


Spelled = Annotated[str, BeforeValidator(_as_written), WithJsonSchema({"type": ["string", "integer"]})]


def _date(raw: object) -> dt.date:
    try:
        if isinstance(raw, str) and (date := dt.date.fromisoformat(raw)).isoformat() == raw:
            return date
    except ValueError:
        pass
    raise expected("a date like 2026-01-31", raw)


def _instant(raw: object) -> dt.datetime:
    try:
        if isinstance(raw, str) and (instant := dt.datetime.fromisoformat(raw)).tzinfo is not None:
            return instant.astimezone(dt.UTC)
    except (ValueError, OverflowError):
        pass
    raise expected("a time with its zone like 2026-01-31T08:00:00Z", raw)


Date = Annotated[
    dt.date,
    BeforeValidator(_date),
    WithJsonSchema({"type": "string", "pattern": r"^\d{4}-\d{2}-\d{2}$", "examples": ["2026-01-31"]}),
]
Instant = Annotated[
    dt.datetime, BeforeValidator(_instant), WithJsonSchema({"type": "string", "examples": ["2026-01-31T08:00:00Z"]})
]


@dataclass(frozen=True, slots=True)
class FileBeside:
    """Validates a file name into the path of an existing file in the folder of the document, or below it.

    With `files_needed: False` in the context it need not exist: a run does not store all files that its stored bench
    file names. A file larger than `limit_bytes` is rejected before it is read.
    """

    limit_bytes: int | None = None

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_plain_validator_function(self.path)

    def __get_pydantic_json_schema__(self, _: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"type": "string", "minLength": 1, "description": "the name of a file beside this one, or below it"}

    def path(self, raw: object, info: core_schema.ValidationInfo) -> Path:
        """Return the file; raises an error with the message."""
        context = info.context or {}
        folder = context.get("folder")
        if not isinstance(raw, str) or not raw or not isinstance(folder, Path):
            raise expected("the name of a file beside this one", raw)
        try:
            exists = _is_file(folder / raw)  # first: a link to itself has no location
            path = (folder / raw).resolve()
            inside = path.is_relative_to(folder.resolve())
        except OSError as problem:
            raise telling(f"{quoted(raw)} cannot be read ({problem.strerror})") from None
        except ValueError:  # a zero byte, an incomplete character
            raise telling(f"{quoted(raw)} cannot be read (no file can have this name)") from None
        if not inside:
            raise telling(f"{quoted(raw)} leaves the folder of this file")
        if context.get("files_needed", True) and not exists:
            raise telling(f"there is no file {quoted(raw)} beside this one; a copied file needs what it names as well")
        if exists and self.limit_bytes is not None and (size := path.stat().st_size) > self.limit_bytes:
            raise telling(f"{quoted(raw)} has {size} bytes, at most {self.limit_bytes} are read; is it the right file?")
        note_named(raw, context)
        return path


def note_named(name: str, context: Mapping[str, Any]) -> None:
    """Record the name of a file that the document uses, if the validation context collects them."""
    if isinstance(named := context.get("named"), set) and not Path(name).is_absolute():
        named.add(name)


def _is_file(path: Path) -> bool:
    """Return whether there is a regular file; OSError if that is undecidable, as for a link to itself.

    `Path.is_file` and `Path.resolve` behave differently in different versions of Python.
    """
    try:
        return stat.S_ISREG(path.stat().st_mode)
    except (FileNotFoundError, NotADirectoryError):
        return False


@dataclass(frozen=True, slots=True)
class DocumentFile(Generic[ContentT]):
    """A file beside a document and the model in it; `content` is None if only a run stores the document."""

    path: Path
    content: ContentT | None


@dataclass(frozen=True, slots=True)
class ModelBeside:
    """Validates the name of a file beside the document into the `model` that it contains; accepts a DocumentFile as is.

    The validation context provides `load` to read such files; its errors are not caught.
    """

    model: type[BaseModel]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_plain_validator_function(self._validate)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return FileBeside().__get_pydantic_json_schema__(schema, handler)

    def _validate(self, raw: object, info: core_schema.ValidationInfo) -> DocumentFile[Any]:
        if isinstance(raw, DocumentFile):
            return raw
        path = FileBeside().path(raw, info)
        load: Callable[[Path, type[BaseModel]], BaseModel] = (info.context or {})["load"]
        return DocumentFile(path, load(path, self.model) if path.is_file() else None)


class StrictModel(BaseModel):
    """Frozen model that rejects unknown keys and suggests the right one."""

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True, defer_build=True)

    @model_validator(mode="wrap")
    @classmethod
    def _say_it_plainly(cls, data: Any, handler: ModelWrapValidatorHandler[Any]) -> Any:
        try:
            return handler(data)
        except ValidationError as error:
            raise _with_suggestions(error, cls) from None


class Range(StrictModel):
    """From `min` to `max`, declared by subclasses in their unit."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        low, high = getattr(self, "min", None), getattr(self, "max", None)
        if low is not None and high is not None and low >= high:
            raise telling("min is not below max")
        return self


def keys_of(model: type[BaseModel]) -> list[str]:
    """Keys that a document may use for the fields of `model`."""
    return [field.alias or name for name, field in model.model_fields.items()]


def inner_errors(error: ValidationError, place: tuple[str | int, ...] = ()) -> list[InitErrorDetails]:
    """Errors of a part in plain text, to be raised again by the model that contains it at `place`."""
    return [
        InitErrorDetails(type=telling(error_text(item)), loc=(*place, *item["loc"]), input=item["input"])
        for item in error.errors(include_url=False)
    ]


def _with_suggestions(error: ValidationError, model: type[BaseModel]) -> ValidationError:
    """The same errors in plain text; for an unknown key of `model` itself the likely key is suggested.

    The suggested key is not also reported as missing: one mistake is one problem. Nor is the integer part of a number
    with a decimal comma, which YAML splits between braces.
    """
    found = error.errors(include_url=False)
    keys = keys_of(model)
    unknown = {item["loc"]: str(item["loc"][0]) for item in found if item["type"] == "extra_forbidden"}
    meant = {nearest(key, keys) for key in unknown.values()}
    parted = {key for key in unknown.values() if key[:1].isdecimal()}
    whole = next((item["input"] for item in found if isinstance(item["input"], int)), 0)
    details = []
    for item, plain in zip(found, inner_errors(error), strict=True):
        if item["type"] == "missing" and item["loc"][0] in meant:
            continue
        if parted and isinstance(item["input"], int):
            continue
        if item["loc"] in unknown and unknown[item["loc"]] in parted:
            meant_number = f"{whole}.{unknown[item['loc']]}"
            plain["type"] = telling(f"a comma ends a value between braces; use a decimal point: {meant_number}")
        elif item["loc"] in unknown:
            plain["type"] = telling(f"unknown key{did_you_mean(unknown[item['loc']], keys)}")
        details.append(plain)
    return ValidationError.from_exception_data(model.__name__, details)
