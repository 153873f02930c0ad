"""A new sequence file to start from: `starter.yaml` beside this module, under a name of its own."""

from __future__ import annotations

import os
from importlib.resources import files
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from bench.errors import InputError
from drivers.fields import Name
from drivers.wording import in_plain_words

_PACKAGE = Path(str(files("bench")))
_SCHEMA = Path("docs/schema/sequence.schema.json")


def write_starter(name: str, folder: Path) -> Path:
    """Writes `FOLDER/NAME.yaml`; InputError when that is no name, the file is there already, or cannot be written."""
    try:
        TypeAdapter(Name).validate_python(name)
    except ValidationError as error:
        raise InputError(f"NAME: {in_plain_words(error.errors()[0])}") from None
    path = folder / f"{name}.yaml"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8") as file:
            file.write(_starter(name, folder))
    except FileExistsError:
        raise InputError(f"{path}: is there already; choose another name, or remove it first") from None
    except OSError as problem:
        raise InputError(f"{path}: cannot be written ({problem})") from None
    return path


def _starter(name: str, folder: Path) -> str:
    """The text, with the title and with the way from its folder to the schema."""
    text = (_PACKAGE / "sequence" / "starter.yaml").read_text("utf-8")
    schema = os.path.relpath(_schema(), folder.resolve())
    title = name.replace("_", " ").capitalize()
    return text.replace(f"../../{_SCHEMA}", schema, 1).replace("title: Starter", f"title: {title}", 1)


def _schema() -> Path:
    """Where the schema is: in the wheel, or in the source tree around the package."""
    shipped = _PACKAGE / "shipped" / _SCHEMA
    return shipped if shipped.is_file() else _PACKAGE.parent / _SCHEMA
