"""A new sequence file to start from: `starter.yaml` beside this module, under a name of its own."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from bench.config.schema_file import path_to_schema
from bench.errors import InputError
from bench.files import written_new
from drivers.schema.fields import Name
from drivers.schema.wording import in_plain_words

_PACKAGE = Path(str(files("bench")))
_SCHEMA = "../../../docs/schema/sequence.schema.json"  # as the starter names it


def write_starter(name: str, folder: Path) -> Path:
    """Writes `FOLDER/NAME.yaml`; InputError when that is no name, the file is there already, or cannot be written."""
    try:
        TypeAdapter(Name).validate_python(name)
    except ValidationError as error:
        raise InputError(f"NAME: {in_plain_words(error.errors()[0])}") from None
    path = folder / f"{name}.yaml"
    try:
        with written_new(path) as draft:
            draft.write_text(_starter(name, path_to_schema("sequence", folder)), encoding="utf-8")
    except FileExistsError:
        raise InputError(f"{path}: is there already; choose another name, or remove it first") from None
    except OSError as problem:
        raise InputError(f"{path}: cannot be written ({problem})") from None
    return path


def _starter(name: str, schema: str) -> str:
    """The text, with the title and with the way from its folder to the schema."""
    text = (_PACKAGE / "sequence" / "document" / "starter.yaml").read_text("utf-8")
    title = name.replace("_", " ").capitalize()
    return text.replace(_SCHEMA, schema, 1).replace("title: Starter", f"title: {title}", 1)
