"""Case file and records, common to all off-line reductions; the formats are those of equations 9."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from bench.errors import InputError
from bench.offline.csv_record import Table, read_table, read_text
from drivers.schema.fields import FileBeside, StrictModel, keys_of
from drivers.schema.suggest import did_you_mean, nearest
from drivers.schema.wording import error_text, telling, value_text

LEGS = ("up", "down")  # of a record over temperature
CASE_LIMIT_BYTES = 2**20
DESCRIPTIONS = (
    "author", "comment", "date", "description", "id", "name", "note", "notes", "operator", "title", "uut", "version",
)  # fmt: skip
SettingsT = TypeVar("SettingsT", bound=BaseModel)


def not_zero(value: float) -> float:
    """Return the value. Raises ValueError if it is 0, for pydantic to report."""
    if value == 0:
        raise ValueError("is 0; a scale factor is not")
    return value


def without_nulls(content: Any) -> Any:
    """A mapping without the keys that are null, which count as not given. Anything else is returned unchanged."""
    return {key: value for key, value in content.items() if value is not None} if isinstance(content, dict) else content


def without_truths(content: Any) -> Any:
    """Return a mapping. Raises an error for pydantic to report if a value is true or false: no setting is."""
    for key, value in content.items() if isinstance(content, dict) else ():
        if isinstance(value, bool):
            raise telling(f"{key}: is {value_text(value)}, expected a number or a word")
    return content


def unknown_keys(model: type[BaseModel], content: Any) -> list[str]:
    """Keys of a mapping that `model` does not have."""
    known = keys_of(model)
    return [str(key) for key in content if key not in known] if isinstance(content, dict) else []


Scale = Annotated[float, AfterValidator(not_zero)]
Limit = Annotated[float, Field(ge=0)]
LocalGravity = Annotated[float, Field(ge=9.7, le=9.9)]
"""Plausible range of gravity on the ground, m/s²."""


class Tolerant(BaseModel):
    """Model that ignores unknown keys; null counts as not given."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False, defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _null_is_absent(cls, content: Any) -> Any:
        return without_nulls(content)


class Settings(StrictModel):
    """Settings of a reduction: no unknown keys, none true or false; null counts as not given."""

    model_config = ConfigDict(allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _given(cls, content: Any) -> Any:
        return without_truths(without_nulls(content))


class Described(Tolerant):
    """Model whose additional keys are descriptions for people; one similar to a known key is a typing error."""

    beside: ClassVar[tuple[str, ...]] = DESCRIPTIONS

    @model_validator(mode="before")
    @classmethod
    def _no_slips(cls, content: Any) -> Any:
        known = keys_of(cls)
        for key in unknown_keys(cls, content):
            meant = nearest(key, [*known, *cls.beside])
            if meant in known and meant not in content:
                raise telling(f"'{key[:40]}' is not known; did you mean '{meant}'?")
        return content


class Site(Described):
    """Site of the record."""

    latitude_deg: float | None = Field(None, alias="lat_deg", ge=-90, le=90)
    height_m: float | None = Field(None, alias="h_m", ge=-1000, le=10000)


class CaseFile(Described):
    """Content of `case.json`; the records are files in its folder or below."""

    format: Literal["itb-case/1"] = Field(alias="schema")
    method: str
    sub: str = ""
    site: dict[str, Any] = Field(default_factory=dict)
    settings: dict[str, Any] = Field(default_factory=dict)
    records: Annotated[dict[str, Annotated[Path, FileBeside()]], BeforeValidator(without_nulls)]


@dataclass(frozen=True, slots=True)
class Case:
    """A case file that was read, and its name for error messages; `notes` list ignored keys."""

    name: str
    content: CaseFile
    notes: tuple[str, ...] = ()

    def settings(self, model: type[SettingsT]) -> SettingsT:
        """Settings validated by `model`. Raises InputError, which names each invalid one."""
        return validated(model, self.content.settings, f"{self.name}: settings.")

    @property
    def site(self) -> Site:
        """Site of the record. Raises InputError, which names each invalid value."""
        return validated(Site, self.content.site, f"{self.name}: site.")

    def has(self, record: str) -> bool:
        """True if the case names a record."""
        return record in self.content.records

    def record(self, name: str, columns: str, optional: str = "") -> Table:
        """Table of the comma-separated `columns` of a record; one of the `optional` is blank if the file lacks it.

        Raises InputError if the record is missing or cannot be read.
        """
        if not self.has(name):
            raise InputError(f"{self.name}: records: '{name}' is missing; {self._title()} needs it")
        return read_table(self.content.records[name], columns.split(","), optional.split(",") if optional else ())

    def check_records(self, known: Collection[str]) -> None:
        """Raise InputError if the case names a record that its reduction does not read."""
        for name in self.content.records:
            if name not in known:
                raise InputError(f"{self.name}: records.{name[:40]}: is not known{did_you_mean(name, known)}")

    def _title(self) -> str:
        return f"{self.content.method} {self.content.sub}".rstrip()


@dataclass(frozen=True, slots=True)
class Reduction:
    """Reduction of one kind of cases; `records` are all that they may name.

    The flags of a result are `Flag`s or names. A result is empty if its `parts` are. Flags with the codes `lacking`
    make it incomplete: parts that could not be used.
    """

    reduce: Callable[[Case], dict[str, Any]]
    records: tuple[str, ...]
    parts: tuple[str, ...] = ()
    lacking: frozenset[str] = frozenset()


Reductions = Mapping[tuple[str, str], Reduction]


def read_case(path: Path) -> Case:
    """Read a case file and check that its records exist. Raises InputError, with the place."""
    content = read_json(path, CASE_LIMIT_BYTES)
    found = validated(CaseFile, content, f"{path.name}: ", folder=path.parent)
    validated(Site, found.site, f"{path.name}: site.")
    passed_over = [*unknown_keys(CaseFile, content), *(f"site.{key}" for key in unknown_keys(Site, found.site))]
    odd = [key[:40] for key in passed_over if key.removeprefix("site.") not in DESCRIPTIONS]
    return Case(path.name, found, (f"unknown keys were ignored: {', '.join(odd)}",) if odd else ())


def read_json(path: Path, limit_bytes: int) -> Any:
    """Read a JSON file. Raises InputError, with the place."""
    text = read_text(path, limit_bytes)
    if not text.strip():
        raise InputError(f"{path.name}: is empty")
    try:
        return json.loads(text, object_pairs_hook=_each_key_once)
    except _KeyTwiceError as problem:
        raise InputError(f"{path.name}: the key '{problem}' occurs twice in one mapping; remove one") from None
    except json.JSONDecodeError as problem:
        raise InputError(
            f"{path.name}: line {problem.lineno}, column {problem.colno}: is not JSON: {problem.msg}"
        ) from None
    except (RecursionError, ValueError):
        raise InputError(f"{path.name}: nested too deeply, or a number with too many digits") from None


class _KeyTwiceError(Exception):
    """A key occurs twice; JSON would keep the last one."""


def _each_key_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        keys = [key for key, _ in pairs]
        raise _KeyTwiceError(next(key for key in keys if keys.count(key) > 1)[:40])
    return content


def validated(model: type[SettingsT], content: Any, where: str, folder: Path | None = None) -> SettingsT:
    """Validate `content` by `model`, at the place `where`: a file, a colon, and keys within it that end in a point.

    Raises InputError with the file and every invalid place.
    """
    try:
        return model.model_validate(content, context={"folder": folder})
    except ValidationError as problem:
        file, colon, place = where.partition(": ")
        details = [
            place + ".".join(map(str, item["loc"])) + (": " if item["loc"] else "") + error_text(item)
            for item in problem.errors(include_url=False)
        ]
        raise InputError(file + colon + "; ".join(details)) from None
