"""Starter bench files: copies of existing ones, with the files that they refer to."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from bench.config.bench import load_bench
from bench.config.load import find
from bench.config.schema_file import path_to_schema
from bench.errors import InputError
from bench.files import written_new
from drivers.schema.fields import Name
from drivers.schema.wording import error_text

_SCHEMA = re.compile(r"(?<=\$schema=)\S*bench\.schema\.json")
_TITLE = re.compile(r"^title: .*$", re.MULTILINE)


def expect_name(name: str) -> None:
    """Raise InputError for an invalid name of a new file or package."""
    try:
        TypeAdapter(Name).validate_python(name)
    except ValidationError as error:
        raise InputError(f"NAME: {error_text(error.errors()[0])}") from None


def write_bench(name: str, source: str, folder: Path) -> list[Path]:
    """Write `FOLDER/NAME.yaml` and the files it refers to, all or nothing; return the files, the bench file last.

    An existing file is never replaced; one with the same content is shared. Raises InputError for an invalid name, an
    invalid source, conflicting files and errors of writing.
    """
    expect_name(name)
    given = find(source, "config")
    named = set[str]()
    load_bench(given, named=named)
    bench = folder / f"{name}.yaml"
    beside = {folder / each: _read(each, given) for each in sorted(named)}
    if bench.exists() or bench in beside:
        raise InputError(f"{bench}: is there already; choose another name, or remove it first")
    if in_the_way := [path for path, data in beside.items() if not _is_free(path, data)]:
        raise InputError(*(f"{path}: is there already, and is another; choose another --dir" for path in in_the_way))
    text = _renamed(given.read_text("utf-8"), name, path_to_schema("bench", folder))
    return _write_all({**{path: data for path, data in beside.items() if not path.exists()}, bench: text.encode()})


def _renamed(text: str, name: str, schema: str) -> str:
    """Return the text with the title of the new bench and the path to its schema."""
    title = name.replace("_", " ").capitalize()
    return _TITLE.sub(f"title: {title}", _SCHEMA.sub(lambda _: schema, text, count=1), count=1)


def _read(name: str, bench: Path) -> bytes:
    """Read a file that a bench file refers to. Raises InputError if its copy would be outside the folder."""
    path = bench.parent / name
    if not path.resolve().is_relative_to(bench.parent.resolve()):
        raise InputError(f"{bench}: {name} leaves the folder of this file; name it by its whole path")
    try:
        return path.read_bytes()
    except OSError as problem:
        raise InputError(f"{path}: cannot be read ({problem})") from None


def _is_free(path: Path, data: bytes) -> bool:
    """Return True if `data` can be written to a path without replacing other content."""
    try:
        return not path.exists() or path.read_bytes() == data
    except OSError:  # a folder, or not readable
        return False


def _write_all(contents: Mapping[Path, bytes]) -> list[Path]:
    made: list[Path] = []
    for path, data in contents.items():
        try:
            with written_new(path) as draft:
                draft.write_bytes(data)
        except OSError as problem:
            for each in made:
                each.unlink(missing_ok=True)
            raise InputError(f"{path}: cannot be written ({problem}); nothing was copied") from None
        made.append(path)
    return made
