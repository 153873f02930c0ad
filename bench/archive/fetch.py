"""Restoration of an archived run as a run directory."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path, PurePosixPath

from bench.archive.query import Archive
from bench.archive.units import run_of
from bench.errors import InputError, StoreError
from bench.files import atomic_folder
from bench.store.verify import examine

NOT_OF_RUN = ("raw/", "reduced/")  # what the archive has beside the files of a run


def fetch(archive: Archive, run: str, into: Path, version: int | None = None) -> Path:
    """Write the files of a run below a folder and verify them; return the run directory.

    Each file is compared with the digest it was archived with, and the whole with its seal. Raises InputError if the
    run is not in the archive or the directory exists, and StoreError if something has changed since it was archived.
    """
    uuid = run_of(archive, run)
    which = "AND version = ?" if version is not None else ""
    values = [uuid] if version is None else [uuid, version]
    sql = f"SELECT run, files FROM {'all_runs' if which else 'runs'} WHERE uuid = ? {which}"  # noqa: S608  constants
    rows = archive.query(sql, values).rows
    if not rows:
        raise InputError(f"{archive.destination.url}: {run} has no version {version}")
    name, files = str(rows[0][0]), json.loads(str(rows[0][1]))
    folder = into / name
    if folder.exists():
        raise InputError(f"{folder}: exists already; give another folder")
    with atomic_folder(folder) as draft:
        for file, entry in files.items():
            if not file.startswith(NOT_OF_RUN):
                _write(archive, draft, file, entry["object"], entry["sha256"])
        record = examine(draft)
    if record.damage:
        raise StoreError(f"{folder}: {record.damage[0]}")
    return folder


def _write(archive: Archive, folder: Path, name: str, place: str, digest: str) -> None:
    path = folder / name
    if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
        raise StoreError(f"{archive.destination.url}: '{name}' is no name of a file of a run")
    path.parent.mkdir(parents=True, exist_ok=True)
    found = hashlib.sha256()
    with path.open("wb") as file:
        for chunk in archive.destination.chunks(place):
            found.update(chunk)
            file.write(chunk)
    if found.hexdigest() != digest:
        raise StoreError(f"{archive.destination.url}/{place}: has changed since it was archived (SHA-256 differs)")
