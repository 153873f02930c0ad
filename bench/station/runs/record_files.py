"""Files of a run, as its own record lists them. Nothing else of its directory is served."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from pydantic import BaseModel, ConfigDict, Field

from bench.errors import InputError, StoreError
from bench.report.revision import REVISIONS
from bench.store.kept_json import TEXT, named, nullable, object_of, read_kept
from bench.store.manifest_form import SEAL_FORM
from bench.store.runs import MANIFEST, SEAL, RunSummary

ACTIVE = frozenset({".html", ".htm", ".svg", ".xml", ".xhtml", ".js", ".pdf"})
TYPES = {
    ".json": "application/json", ".yaml": "text/plain; charset=utf-8", ".csv": "text/csv; charset=utf-8",
    ".dbc": "text/plain; charset=utf-8", ".html": "text/html; charset=utf-8", ".svg": "image/svg+xml",
    ".pdf": "application/pdf", ".db": "application/octet-stream",
}  # fmt: skip
_REPORTS = object_of({"files": named(nullable(TEXT))}, ("files",))


class FileView(BaseModel):
    """File of a run."""

    model_config = ConfigDict(frozen=True)

    name: str
    size: int = Field(description="bytes")
    hash: str = Field(description="SHA-256 by the record; empty if it has none")
    sealed: bool = Field(description="under the seal of the run; reports are written from it and may be written again")

    @property
    def suffix(self) -> str:
        """Suffix of its name, in small letters."""
        return Path(self.name).suffix.lower()

    @property
    def is_active(self) -> bool:
        """True if a browser could run something in it; it is served as an attachment."""
        return self.suffix in ACTIVE

    @property
    def media_type(self) -> str:
        """Media type."""
        return TYPES.get(self.suffix, "application/octet-stream")


def files_of(run: RunSummary) -> list[FileView]:
    """Return the files of a run that are there, those under its seal first."""
    return [
        FileView(name=name, size=size, hash=digest, sealed=sealed)
        for name, digest, sealed in _listed(run)
        if (size := _size(run.path / name)) is not None
    ]


def opened(run: RunSummary, name: str) -> tuple[FileView, BinaryIO]:
    """Open a file that the record of a run lists; InputError for any other name, and for anything but a file."""
    found = next((each for each in files_of(run) if each.name == name), None)
    if found is None:
        raise InputError(f"run '{run.id}' lists no file '{name}'")
    try:
        descriptor = os.open(run.path / name, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError as problem:
        raise InputError(f"{run.id}: '{name}' cannot be read ({problem.strerror})") from problem
    file = os.fdopen(descriptor, "rb")
    state = os.fstat(file.fileno())
    if not stat.S_ISREG(state.st_mode):
        file.close()
        raise InputError(f"{run.id}: '{name}' is no file")
    return found.model_copy(update={"size": state.st_size}), file


def _listed(run: RunSummary) -> Iterator[tuple[str, str, bool]]:
    """Yield name, hash and whether the seal covers it; only plain names of the run directory itself."""
    seen: set[str] = set()
    for name, digest, sealed in (*_sealed(run), *_reports(run)):
        if name not in seen and name not in ("", ".", "..") and not set(name) & set("/\\\0"):
            seen.add(name)
            yield name, digest, sealed


def _sealed(run: RunSummary) -> list[tuple[str, str, bool]]:
    try:
        files = read_kept(run.path / SEAL, SEAL_FORM)["files"]
    except StoreError:
        hashes = run.manifest.get("hashes", {})
        return [(MANIFEST, "", False), *((str(name), str(digest), False) for name, digest in hashes.items())]
    return [(name, digest, True) for name, digest in files.items()]


def _reports(run: RunSummary) -> list[tuple[str, str, bool]]:
    try:
        files = read_kept(run.path / REVISIONS, _REPORTS)["files"]
    except StoreError:
        return []
    return [(name, digest or "", False) for name, digest in files.items()]


def _size(path: Path) -> int | None:
    """Return the size of a file; None for anything else, such as a link."""
    try:
        state = path.lstat()
    except (OSError, ValueError):
        return None
    return state.st_size if stat.S_ISREG(state.st_mode) else None
