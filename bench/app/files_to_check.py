"""Files for a check, named or found in folders; their kind is that of their `schema:`."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from bench.config.document import SIZE_LIMIT_BYTES
from bench.config.load import find
from bench.errors import InputError

SEQUENCE = "sequence"
UNREADABLE = "schema: itb-sequence/?"
SUFFIXES = (".yaml", ".yml", ".json")
RUN = "run.db"  # in a directory of a run, whose copies of files are a record
# found by their text, so that a file which is no valid YAML has a kind as well; compiled when used, for the usual file
# of a short command does not need them
_USUAL = "\nschema: itb-sequence/"
_SCHEMA = r"""^(?:\{\s*|\s*(?="))?["']?schema["']?\s*:\s*["']?itb-([a-z]+)/"""
_CALL = r"""\bcall:\s*["']?([^\s"',}#]+)"""


class FileToCheck(NamedTuple):
    """File and its kind. `is_called`: another sequence of its folder calls it, and it is not named itself."""

    path: Path
    kind: str
    is_named: bool = False
    is_called: bool = False


def find_files(words: Iterable[str], kinds: Collection[str]) -> tuple[list[FileToCheck], int]:
    """Return the files of `kinds` among files, folders and names of shipped sequences, and the number of others there.

    Raises InputError for a folder without any. A named file of no known kind is taken as a sequence, and so is the name
    of a file that does not exist: its check reports that.
    """
    files: dict[Path, FileToCheck] = {}
    called: set[Path] = set()
    others = 0
    for word in words:
        path = _found(word)
        if path.is_dir():
            found, calls, count = _in_folder(path, kinds)
            files = {each.path.resolve(): each for each in found} | files
            called |= calls
            others += count
        else:
            kind = _kind(_text(path))
            files[path.resolve()] = FileToCheck(path, kind if kind in kinds else SEQUENCE, is_named=True)
    return [each._replace(is_called=at in called and not each.is_named) for at, each in files.items()], others


def _in_folder(folder: Path, kinds: Collection[str]) -> tuple[list[FileToCheck], set[Path], int]:
    """Return the files of `kinds` in a folder, those that they call, and the number of others. Raises InputError."""
    files: list[FileToCheck] = []
    called: set[Path] = set()
    others = 0
    for path in _files_in(folder):
        text = _text(path)
        if (kind := _kind(text)) in kinds:
            files.append(FileToCheck(path, kind))
            called |= {(path.parent / name).resolve() for name in re.findall(_CALL, text)}
        else:
            others += 1
    if not files:
        raise InputError(f"{folder}: no {' or '.join(kinds)} file is in this folder; is it the right one?")
    return files, called, others


def _found(word: str) -> Path:
    try:
        return find(word, "sequences")
    except InputError:
        return Path(word)


def _files_in(folder: Path) -> Iterator[Path]:
    """Yield all files below a folder in the order of their names, except hidden ones and directories of runs."""
    for path, folders, names in os.walk(folder):
        folders[:] = [] if RUN in names else sorted(name for name in folders if not name.startswith("."))
        if RUN not in names:
            yield from (Path(path, name) for name in sorted(names) if not name.startswith("."))


def _text(path: Path) -> str:
    """Return the text of a YAML or JSON file as far as it is read; "" for other files."""
    if path.suffix not in SUFFIXES or not path.is_file():
        return ""
    try:
        with path.open("rb") as file:
            return file.read(SIZE_LIMIT_BYTES).decode("utf-8-sig", "replace")
    except OSError:
        return UNREADABLE  # its check reports why


def _kind(text: str) -> str:
    if _USUAL in text:
        return SEQUENCE
    found = re.search(_SCHEMA, text, re.MULTILINE)
    return found[1] if found else ""
