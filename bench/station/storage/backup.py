"""Backup of a station in one archive, and its restoration into an empty folder.

A backup has the state of the queue at one instant, also of a station at work. A restored station begins nothing until a
person lets each bench go on: items of the backup may have run since.
"""

from __future__ import annotations

import io
import json
import lzma
import os
import sqlite3
import tarfile
import zlib
from collections.abc import Callable, Mapping
from contextlib import closing, suppress
from importlib.metadata import version
from pathlib import Path
from typing import Literal, NamedTuple

from bench.clock import wall_utc
from bench.config.bench import load_bench
from bench.config.laboratory import load_laboratory
from bench.config.load import shipped
from bench.errors import InputError, StoreError
from bench.files import DRAFT, atomic_folder, written_new
from bench.station.queue.items import OCCUPYING, WAITING
from bench.station.queue.scheduler import ITEMS
from bench.station.settings import read_station
from bench.station.storage.database import FILE_NAME
from bench.station.storage.snapshots import FOLDER as SNAPSHOTS
from bench.station.storage.snapshots import snapshot
from bench.store.runs import list_runs

SCHEMA = "itb-backup/1"
ABOUT = "backup.json"  # last file of an archive: without it the archive is not complete
STATION, SETTINGS, RUNS = "station", "settings", "runs"  # folders of an archive
ENDINGS: Mapping[str, Literal["w:xz", "w:gz"]] = {".tar.xz": "w:xz", ".tar.gz": "w:gz"}
NOT_KEPT = frozenset({FILE_NAME, f"{FILE_NAME}-wal", f"{FILE_NAME}-shm", "station.json", "token", SNAPSHOTS, ITEMS})
_UNREADABLE = (tarfile.TarError, lzma.LZMAError, zlib.error, EOFError, OSError, ValueError)
Say = Callable[[str], object]


class Restored(NamedTuple):
    """Restored station: benches that wait for a person, and where its settings and runs are, if they were kept."""

    benches: list[str]
    settings: Path | None
    runs: Path | None


def back_up(folder: Path, out: Path, say: Say, *, settings: Path | None = None, runs: Path | None = None) -> None:
    """Write a backup of the station in a folder to a new file: its records, its settings, and runs that have ended.

    `say` receives what is left out. Raises InputError for a wrong folder, name or settings, and StoreError.
    """
    if not (folder / FILE_NAME).is_file():
        raise InputError(f"{folder}: is not the folder of a station; it has no {FILE_NAME}")
    mode = _mode(out)
    if out.absolute().is_relative_to(folder.absolute()):
        raise InputError(f"{out}: write the backup outside of the folder of the station")
    files = _files_of(settings, folder) if settings is not None else []
    database = snapshot(folder)
    try:
        with written_new(out) as draft:
            draft.touch(0o600)  # it holds the hashes of passwords
            with tarfile.open(draft, mode, dereference=True) as archive:
                _add_station(archive, folder, database)
                if settings is not None:
                    _add_settings(archive, settings.absolute().parent, files, say)
                if runs is not None:
                    _add_runs(archive, runs, say)
                _add_about(archive, settings.name if settings is not None else "")
    except FileExistsError:
        raise InputError(f"{out}: is there already; choose another name") from None
    except OSError as problem:
        raise StoreError(f"{out}: cannot be written ({problem})") from problem
    finally:
        database.unlink(missing_ok=True)


def restore(archive: Path, folder: Path) -> Restored:
    """Restore a backup into a new or empty folder.

    Raises InputError for another archive or a folder with something in it, and StoreError.
    """
    _expect_free(folder)
    try:
        if folder.is_dir():
            folder.rmdir()
        with atomic_folder(folder) as draft:
            (draft / STATION).mkdir(0o700)
            _extract(archive, draft)
            about = _about(archive, draft)
            benches = _stop_benches(draft / STATION / FILE_NAME, about["made_at"])
        runs = folder / RUNS
        settings = folder / SETTINGS / about["settings"] if about["settings"] else None
        return Restored(benches, settings, runs if runs.is_dir() else None)
    except OSError as problem:
        raise StoreError(f"{folder}: cannot be restored ({problem})") from problem


def _expect_free(folder: Path) -> None:
    if not folder.exists():
        return
    if not folder.is_dir() or any(folder.iterdir()):
        has_station = any((each / FILE_NAME).exists() for each in (folder, folder / STATION))
        why = "has the records of a station, which may be running" if has_station else "is not empty"
        raise InputError(f"{folder}: {why}; name a new or empty folder")


def _add_station(archive: tarfile.TarFile, folder: Path, database: Path) -> None:
    """Add the records of a station: the attempts that its database knows, and all other files."""
    archive.add(database, f"{STATION}/{FILE_NAME}")
    for path in sorted(folder.iterdir()):
        if path.name not in NOT_KEPT:
            _add(archive, path, f"{STATION}/{path.name}")
    with closing(sqlite3.connect(database)) as tables:
        for item, data in tables.execute("SELECT id, data FROM item ORDER BY number"):
            for number in range(1, int(json.loads(data)["attempts"]) + 1):
                _add(archive, folder / ITEMS / item / str(number), f"{STATION}/{ITEMS}/{item}/{number}")


def _add(archive: tarfile.TarFile, path: Path, name: str) -> None:
    """Add a file or a whole folder; what disappears meanwhile, such as a draft, is left out."""
    if path.name.endswith(DRAFT) or path.is_socket():
        return
    with suppress(FileNotFoundError):
        archive.add(path, name, recursive=False)
        if path.is_dir() and not path.is_symlink():
            for each in sorted(path.iterdir()):
                _add(archive, each, f"{name}/{each.name}")


def _add_settings(archive: tarfile.TarFile, beside: Path, files: list[Path], say: Say) -> None:
    """Add the files that belong to settings, by their paths beside them; shipped ones are everywhere."""
    for path in files:
        if any(path.is_relative_to(folder) for folder in shipped("config")):
            continue
        if path.is_relative_to(beside):
            archive.add(path, f"{SETTINGS}/{path.relative_to(beside)}")
        else:
            say(f"{path}: left out, because it is not in {beside}; keep a copy of it")


def _files_of(file: Path, folder: Path) -> list[Path]:
    """Return settings, bench files with the files that they name, and sequences. Raises InputError."""
    settings, found = read_station(file, folder), {file.absolute()}
    for bench in settings.benches.values():
        named = set[str]()
        load_bench(bench, named=named)
        found |= {bench, *(Path(os.path.normpath(bench.parent / name)) for name in named)}
    if settings.laboratory is not None:
        found |= {settings.laboratory, *_mark(settings.laboratory)}
    if settings.sequences is not None and settings.sequences.is_dir():
        found |= {path.absolute() for path in settings.sequences.rglob("*") if path.is_file()}
    return sorted(found)


def _mark(laboratory: Path) -> list[Path]:
    """The mark of the accreditation body, if there is one. The key of signatures is never part of a backup."""
    accreditation = load_laboratory(laboratory).accreditation
    return [Path(os.path.normpath(accreditation.mark))] if accreditation is not None and accreditation.mark else []


def _add_runs(archive: tarfile.TarFile, runs: Path, say: Say) -> None:
    for run in list_runs(runs):
        if run.state == "running":
            say(f"{run.id}: left out, because it is under way")
        else:
            _add(archive, run.path, f"{RUNS}/{run.id}")


def _add_about(archive: tarfile.TarFile, settings: str) -> None:
    about = {"schema": SCHEMA, "made_at": wall_utc().isoformat(), "settings": settings}
    data = json.dumps({**about, "program": version("inertial-test-bench")}).encode()
    entry = tarfile.TarInfo(ABOUT)
    entry.size, entry.mode = len(data), 0o600
    archive.addfile(entry, io.BytesIO(data))


def _extract(archive: Path, folder: Path) -> None:
    try:
        with tarfile.open(archive, "r:*") as found:
            # Python 3.11 has filters since 3.11.4, so that the names are also checked here.
            found.extraction_filter = getattr(tarfile, "data_filter", lambda entry, _: entry)
            for entry in found:
                if not (entry.isfile() or entry.isdir()) or not _stays_inside(entry.name):
                    raise InputError(f"{archive}: is no backup of a station; it contains {entry.name!r}")
                found.extract(entry, folder)
    except FileNotFoundError:
        raise InputError(f"{archive}: there is no such file") from None
    except _UNREADABLE as problem:
        raise InputError(f"{archive}: cannot be read as a backup ({problem})") from problem


def _stays_inside(name: str) -> bool:
    return not name.startswith("/") and ".." not in name.split("/")


def _about(archive: Path, folder: Path) -> dict[str, str]:
    try:
        about = json.loads((folder / ABOUT).read_bytes())
        if about["schema"] != SCHEMA:
            raise InputError(f"{archive}: has the form {about['schema']}, this program reads {SCHEMA}")
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(f"{archive}: is no backup of a station, or not a complete one") from None
    return {key: str(about.get(key, "")) for key in ("made_at", "settings")}


def _stop_benches(database: Path, made_at: str) -> list[str]:
    """Let each bench with items that have not ended wait for a person; return the benches."""
    reason = f"restored from the backup of {made_at[:16]}Z; see which items have run since, then let the bench go on"
    states = (*WAITING, *OCCUPYING)
    query = f"SELECT DISTINCT bench FROM item WHERE state IN ({','.join('?' * len(states))}) ORDER BY bench"  # noqa: S608  only question marks
    try:
        with closing(sqlite3.connect(database)) as tables, tables:
            (found,) = tables.execute("PRAGMA integrity_check").fetchone()
            if found != "ok":
                raise StoreError(f"the database of the backup is damaged ({found})")
            benches = [bench for (bench,) in tables.execute(query, states)]
            tables.executemany("REPLACE INTO stopped VALUES (?, ?, ?)", [(each, reason, made_at) for each in benches])
    except sqlite3.Error as problem:
        raise StoreError(f"the database of the backup is damaged ({problem})") from problem
    return benches


def _mode(path: Path) -> Literal["w:xz", "w:gz"]:
    for ending, mode in ENDINGS.items():
        if path.name.endswith(ending):
            return mode
    raise InputError(f"{path}: the name of a backup ends in {' or '.join(ENDINGS)}")
