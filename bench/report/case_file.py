"""A case file and its records, as every off-line reduction sees them; the formats are those of methods.md section 9."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from bench.errors import InputError
from bench.report.table import Table, read_table, read_text
from drivers.fields import FileBeside
from drivers.wording import in_plain_words

CASE_LIMIT_BYTES = 2**20
SettingsT = TypeVar("SettingsT", bound=BaseModel)


def not_zero(value: float) -> float:
    """The value itself. Raises ValueError when it is 0, for pydantic to report."""
    if value == 0:
        raise ValueError("is 0; a scale factor is not")
    return value


def without_nulls(content: Any) -> Any:
    """A mapping without the keys that are null: what is null is not given. Anything else as it is."""
    return {key: value for key, value in content.items() if value is not None} if isinstance(content, dict) else content


Scale = Annotated[float, AfterValidator(not_zero)]
Limit = Annotated[float, Field(ge=0)]


class Settings(BaseModel):
    """Settings that a reduction does not know are for somebody else and passed over; null is as if not given."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _null_is_absent(cls, content: Any) -> Any:
        return without_nulls(content)


class CaseFile(Settings):
    """What stands in `case.json`; the records are files in its folder or below."""

    format: Literal["itb-case/1"] = Field(alias="schema")
    method: str
    sub: str = ""
    site: dict[str, Any] = Field(default_factory=dict)
    settings: dict[str, Any] = Field(default_factory=dict)
    records: Annotated[dict[str, Annotated[Path, FileBeside()]], BeforeValidator(without_nulls)]


@dataclass(frozen=True, slots=True)
class Case:
    """A case file that was read, and its name for error messages."""

    name: str
    content: CaseFile

    def settings(self, model: type[SettingsT]) -> SettingsT:
        """The settings as `model` describes them. Raises InputError, which names each bad one."""
        return validated(model, self.content.settings, f"{self.name}: settings.")

    def site(self, model: type[SettingsT]) -> SettingsT:
        """The site as `model` describes it. Raises InputError, which names each bad value."""
        return validated(model, self.content.site, f"{self.name}: site.")

    def record(self, name: str, columns: str, optional: str = "") -> Table:
        """The comma-separated `columns` of a record; one of the `optional` is blank when the file lacks it.

        Raises InputError when the record is missing or cannot be read.
        """
        if name not in self.content.records:
            raise InputError(f"{self.name}: records: '{name}' is missing; {self._title()} needs it")
        return read_table(self.content.records[name], columns.split(","), optional.split(",") if optional else ())

    def _title(self) -> str:
        return f"{self.content.method} {self.content.sub}".rstrip()


def read_case(path: Path) -> Case:
    """Reads a case file; its records are looked for, not read. Raises InputError, with the place."""
    content = read_json(path, CASE_LIMIT_BYTES)
    return Case(path.name, validated(CaseFile, content, f"{path.name}: ", folder=path.parent))


def read_json(path: Path, limit_bytes: int) -> Any:
    """The content of a JSON file. Raises InputError, with the place."""
    text = read_text(path, limit_bytes)
    try:
        return json.loads(text)
    except json.JSONDecodeError as problem:
        raise InputError(f"{path.name}: line {problem.lineno}, column {problem.colno}: {problem.msg}") from None
    except (RecursionError, ValueError):
        raise InputError(f"{path.name}: nested too deeply, or a number with too many digits") from None


def validated(model: type[SettingsT], content: Any, where: str, folder: Path | None = None) -> SettingsT:
    """`content` as `model` describes it. Raises InputError that begins with `where` and names every bad place."""
    try:
        return model.model_validate(content, context={"folder": folder})
    except ValidationError as problem:
        details = [
            ".".join(map(str, item["loc"])) + (": " if item["loc"] else "") + in_plain_words(item)
            for item in problem.errors(include_url=False)
        ]
        raise InputError(where + "; ".join(details)) from None
