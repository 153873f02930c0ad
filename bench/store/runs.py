"""Run directories: creation, names, search, locks and summaries."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
from collections.abc import Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

from bench.errors import InputError, StoreError
from bench.files import content_hash, is_locked, make_folder, sync_folder, write_atomically
from bench.store.kept_json import read_kept
from bench.store.manifest_form import MANIFEST_FORM, SEAL_FORM

MANIFEST = "manifest.json"
SEQUENCE_COPY, BENCH_COPY = "sequence.yaml", "bench.yaml"
LOCK = "run.lock"
RUNNER = "runner.json"
SEAL = "seal.json"
RESERVE = "reserve.bin"
RESERVE_BYTES = 4 * 1024 * 1024
_UNSAFE = re.compile(r"[^A-Za-z0-9.-]+")


class RunDirectory:
    """Directory of one run while it is written.

    Lifetime: `create` to `release`, with its locks held throughout. A directory whose state is *running* and whose
    locks are free was interrupted. Space is reserved on the disk, so that the final records can be written when it is
    full.
    """

    def __init__(self, path: Path, locks: tuple[int, ...] = ()) -> None:
        self.path = path
        self._locks = locks

    @classmethod
    def create(cls, runs: Path, started: datetime, sequence: str, units: str) -> RunDirectory:
        """Create the directory `<UTC>_<sequence>_<units>[_n]`. Raises StoreError."""
        name = "_".join((started.strftime("%Y%m%dT%H%M%SZ"), _plain(sequence), _plain(units)))
        try:
            make_folder(runs)
            path = _create_exclusively(runs, name)
            locks = _take_locks(path, fcntl.LOCK_EX)  # readers hold it for a moment only
            _set_aside_space(path)
            sync_folder(path)
            sync_folder(runs)
        except OSError as problem:
            raise StoreError(f"{runs}: a run directory cannot be created ({problem})") from problem
        return cls(path, locks)

    @classmethod
    def reopen(cls, path: Path) -> RunDirectory:
        """Open the directory of an interrupted run to continue it.

        Raises InputError if it is in use, and StoreError.
        """
        try:
            try:
                locks = _take_locks(path, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise InputError(f"{path.name}: this run is under way in another process") from None
            _set_aside_space(path)
        except OSError as problem:
            raise StoreError(f"{path}: cannot be opened to go on in ({problem})") from problem
        return cls(path, locks)

    def write_json(self, name: str, value: Any) -> None:
        """Write a JSON file of the run, atomically and durably. Raises StoreError."""
        write_atomically(self.path / name, json_text(value).encode())

    def write_text(self, name: str, text: str) -> None:
        """Write a text file of the run, atomically and durably; `name` may include a subfolder. Raises StoreError."""
        path = self.path / name
        try:
            make_folder(path.parent)
        except OSError as problem:
            raise StoreError(f"{path.parent}: cannot be created ({problem})") from problem
        write_atomically(path, text.encode())

    def free_reserve(self) -> None:
        """Free the reserved space for the final records."""
        (self.path / RESERVE).unlink(missing_ok=True)

    def release(self) -> None:
        """Release the locks and the reserved space; releasing twice is harmless."""
        with contextlib.suppress(OSError):
            self.free_reserve()
        for lock in self._locks:
            os.close(lock)
        self._locks = ()


def _take_locks(path: Path, how: int) -> tuple[int, ...]:
    """Take the locks of a run: of the lock file, which can be deleted, and of the directory itself.

    Raises BlockingIOError if `how` is non-blocking and one is held, and OSError.
    """
    with contextlib.ExitStack() as undo:
        file = os.open(path / LOCK, os.O_CREAT | os.O_RDWR, 0o644)
        undo.callback(os.close, file)
        fcntl.flock(file, how)
        folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
        undo.callback(os.close, folder)
        try:
            fcntl.flock(folder, how)
        except BlockingIOError:
            raise
        except OSError:  # some network file systems cannot lock directories
            pass
        undo.pop_all()
    return file, folder


def _set_aside_space(path: Path) -> None:
    reserve = os.open(path / RESERVE, os.O_CREAT | os.O_WRONLY, 0o644)
    try:
        os.posix_fallocate(reserve, 0, RESERVE_BYTES)
    finally:
        os.close(reserve)


def _create_exclusively(runs: Path, name: str) -> Path:
    for attempt in range(1, 1000):
        path = runs / (name if attempt == 1 else f"{name}_{attempt}")
        with contextlib.suppress(FileExistsError):
            path.mkdir()
            return path
    raise StoreError(f"{runs}: too many runs are called {name}")


def released_copy(place: str) -> str:
    """Name of the copy of the calibration that was given to a run for the unit in a place."""
    return f"released_{place}.json"


def _plain(text: str) -> str:
    return _UNSAFE.sub("-", text).strip("-.")[:60] or "x"


def json_text(value: Any) -> str:
    """Encode a value as JSON: indented, UTF-8, without NaN."""
    return json.dumps(value, ensure_ascii=False, indent=1, allow_nan=False) + "\n"


class RunSummary(NamedTuple):
    """Summary of a run directory; `state` is running, interrupted, damaged, or the outcome of the run."""

    path: Path
    state: str
    manifest: Mapping[str, Any]

    @property
    def id(self) -> str:
        """Name of the directory."""
        return self.path.name

    @property
    def has_outcome(self) -> bool:
        """True if the run has ended and its record is not damaged."""
        return self.state not in ("running", "interrupted", "damaged")

    @property
    def units(self) -> tuple[str, ...]:
        """Serial numbers of the units under test."""
        return tuple(unit["uut"] for unit in self.manifest.get("units", []))

    def to_json(self) -> dict[str, Any]:
        """Return the summary as plain JSON types."""
        return {"run": self.id, "path": str(self.path), "state": self.state, "manifest": dict(self.manifest)}


def list_runs(runs: Path) -> Iterator[RunSummary]:
    """Yield the runs below a directory, oldest first; other content is ignored."""
    if runs.is_dir():
        for path in sorted(runs.iterdir()):
            if (path / MANIFEST).is_file() or (path / LOCK).is_file():
                yield summary(path)


def summary(path: Path) -> RunSummary:
    """Return the summary of one run directory, from its manifest, its seal and the presence of all sealed files.

    If they disagree the state is *damaged*. The content of the other files is not checked.
    """
    try:
        manifest = read_kept(path / MANIFEST, MANIFEST_FORM)
        state = str(manifest["state"])
        if state != "running" and not _matches_seal(path, manifest):
            raise StoreError(f"{path}: has changed since it was sealed")
    except StoreError:
        return RunSummary(path, "running" if _is_locked(path) else "damaged", {})
    if state == "running" and not _is_locked(path):
        state = "interrupted"
    return RunSummary(path, state, manifest)


def _matches_seal(path: Path, manifest: Mapping[str, Any]) -> bool:
    """Return True if all sealed files are present and the manifest matches the seal, or if no seal is expected."""
    if not (path / SEAL).exists():
        return not manifest.get("sealed", False)
    files = read_kept(path / SEAL, SEAL_FORM)["files"]
    if not all((path / name).is_file() for name in files):
        return False
    of_manifest = files.get(MANIFEST)
    return bool(of_manifest == content_hash((path / MANIFEST).read_bytes()))


def _is_locked(path: Path) -> bool:
    return _is_held(path) or _is_held(path / LOCK)


def _is_held(path: Path) -> bool:
    """Return True if another process holds the lock, or if it cannot be known of the lock file."""
    try:
        return is_locked(path)
    except OSError:  # some network file systems cannot lock directories
        return path.name == LOCK


def find_run(name: str, runs: Path) -> Path:
    """Return the run of a path, an id, a unique beginning of an id, or `last`. Raises InputError."""
    given = Path(name)
    if (given / MANIFEST).is_file() or (given / LOCK).is_file():
        return given
    known = [run.path for run in list_runs(runs)]
    if name == "last":
        if not known:
            raise InputError(f"{runs}: there is no run yet")
        return known[-1]
    matches = [path for path in known if path.name == name] or [path for path in known if path.name.startswith(name)]
    if len(matches) == 1:
        return matches[0]
    if matches:
        raise InputError(f"'{name}' is ambiguous: {', '.join(path.name for path in matches[:5])}")
    raise InputError(f"{runs}: there is no run '{name}'; 'bench runs' lists them")
