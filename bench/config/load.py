"""Validation of documents into models with the place of every problem, and search paths of files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal, TypeVar

from pydantic import BaseModel, ValidationError

from bench.config.document import Document, Place, Problem, read_document
from bench.errors import InputError
from drivers.schema.suggest import did_you_mean
from drivers.schema.wording import error_text

ModelT = TypeVar("ModelT", bound=BaseModel)
Kind = Literal["sequences", "config"]
_SUFFIX = ".yaml"
_KEY = "[key]"  # last part of the location of an error about a key itself


def load(document: Document, model: type[ModelT], **context: Any) -> ModelT:
    """Validate a document. Raises InputError with `file:line:column: problem` for each problem.

    The context of validators has the document's folder, the loader of files beside it, and `context`.
    """
    try:
        return model.model_validate(
            document.value, context={"folder": document.path.parent, "load": load_file, **context}
        )
    except ValidationError as error:
        raise InputError(*document.located(problems(document.value, error))) from None


def load_file(path: Path, model: type[ModelT]) -> ModelT:
    """Read and validate a file."""
    return load(read_document(path), model)


def problems(value: Any, error: ValidationError, prefix: Place = ()) -> Iterator[Problem]:
    """Yield the errors of pydantic for the part of a document's value at `prefix`."""
    for item in error.errors(include_url=False):
        place, missing = _place(value, (*prefix, *item["loc"]))
        problem = error_text(item)
        if missing:
            problem = f"the key '{missing}' {problem}"
        elif place and isinstance(place[-1], str):
            problem = f"{place[-1]}: {problem}"
        yield place, problem


def _place(value: Any, location: Place) -> tuple[Place, str]:
    """Return the place of an error's location in the document, and the key that is missing there.

    Locations also contain names that are in no document, such as the alternatives of a union; they are skipped.
    """
    place: list[str | int] = []
    for index, part in enumerate(location):
        if _has(value, part):
            value = value[part]
            place.append(part)
        elif index == len(location) - 1 and isinstance(value, Mapping) and isinstance(part, str) and part != _KEY:
            return tuple(place), part
    return tuple(place), ""


def _has(value: Any, part: str | int) -> bool:
    if isinstance(value, Mapping):
        return part in value
    return isinstance(value, list) and isinstance(part, int) and part < len(value)


def find(name: str, kind: Kind) -> Path:
    """Return a sequence or bench file: the path itself, else in `./sequences` or `./config`, else a shipped one."""
    given = Path(name)
    folders = [Path(kind), *shipped(kind)]
    candidates = [given] + [folder / name for folder in folders if given.name == name]
    try:
        for candidate in candidates:
            for path in (candidate, Path(f"{candidate}{_SUFFIX}")):
                if path.is_file():
                    return path
        if given.exists():
            return given  # the reader reports what it is instead of a file
    except (OSError, ValueError) as problem:
        raise InputError(f"{name}: cannot be read ({problem})") from None
    if given.name != name or given.suffix == _SUFFIX:
        raise InputError(f"{name}: there is no such file")
    known = sorted({path.stem for folder in folders if folder.is_dir() for path in folder.glob(f"*{_SUFFIX}")})
    what = "sequence" if kind == "sequences" else "bench"
    raise InputError(f"{name}: there is no such {what}{did_you_mean(name, known)}")


def shipped(kind: str) -> list[Path]:
    """Return the shipped files: in the wheel, or in the source tree around the package."""
    package = Path(str(files("bench")))
    return [package / "shipped" / kind, package.parent / kind]
