"""Starter for a new sequence file: a copy of `starter.yaml` beside this module, renamed."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from bench.config.new_bench import expect_name
from bench.config.schema_file import path_to_schema
from bench.errors import InputError
from bench.files import written_new

_PACKAGE = Path(str(files("bench")))
_SCHEMA = "../../../docs/schema/sequence.schema.json"  # name in the starter


def write_starter(name: str, folder: Path) -> Path:
    """Write `FOLDER/NAME.yaml`; InputError if the name is invalid, the file exists, or it cannot be written."""
    expect_name(name)
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
    """Text of the starter with its title and the relative path to the schema."""
    text = (_PACKAGE / "sequence" / "document" / "starter.yaml").read_text("utf-8")
    title = name.replace("_", " ").capitalize()
    return text.replace(_SCHEMA, schema, 1).replace("title: Starter", f"title: {title}", 1)
