"""Seal of a finished run: head of its chain, and hash of every file that the run wrote.

Reports are derived from sealed data, may be written again and are not covered. `seal.json` is written before the last
manifest, whose hash it holds: after a power cut between the two the run counts as interrupted.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from bench.errors import StoreError
from bench.files import DRAFT, content_hash, write_both
from bench.store.chain import Link
from bench.store.database import FILE_NAME
from bench.store.kept_json import read_kept
from bench.store.ledger import note
from bench.store.manifest_form import SEAL_FORM, SEAL_SCHEMA
from bench.store.runs import LOCK, MANIFEST, RESERVE, RUNNER, SEAL, RunDirectory, json_text

DERIVED = ("report.", "report_revisions.json", "approval.json")  # name prefixes of files that may be written again
_PASSING = (LOCK, RESERVE, RUNNER, "run.db-wal", "run.db-shm", SEAL)


class Seal(NamedTuple):
    """Content of a seal: commits and rows of the run, head of its chain, digest of its data, hashes of its files."""

    commits: int
    rows: int
    head: str
    digest: str
    files: Mapping[str, str]


def close_record(directory: RunDirectory, manifest: Mapping[str, Any], begun: bytes, end: Link, digest: str) -> None:
    """Seal a run with its final manifest, write the manifest, and note the seal in the ledger.

    The seal covers the database and the files with hashes in the manifest, with those hashes: files that somebody
    changed or added during the run must not pass for files of the run. `begun` is the head of link 0. A sealed run may
    be sealed again with another manifest. Raises StoreError, and OSError if only the entry in the ledger failed.
    """
    folder = directory.path
    try:
        files = {**manifest["hashes"], FILE_NAME: file_hash(folder / FILE_NAME)}
    except OSError as problem:
        raise StoreError(f"{folder}: cannot be sealed ({problem})") from problem
    files[MANIFEST] = content_hash(json_text(manifest).encode())
    content = {
        "schema": SEAL_SCHEMA,
        "run": folder.name,
        "commits": end.number,
        "rows": end.total,
        "head": end.head.hex(),
        "digest": digest,
        "files": files,
    }
    write_both(folder / SEAL, json_text(content).encode(), folder / MANIFEST, json_text(manifest).encode())
    note(folder.name, begun, end, hashlib.sha256(json_text(content).encode()).hexdigest())


def read_seal(folder: Path) -> Seal:
    """Read the seal of a run. Raises StoreError."""
    content = read_kept(folder / SEAL, SEAL_FORM)
    return Seal(content["commits"], content["rows"], content["head"], content["digest"], content["files"])


def sealable(folder: Path) -> Iterator[str]:
    """Yield the names of all files of a run directory that the seal covers, in order."""
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        passing = name in _PASSING or name.startswith(DERIVED) or name.endswith(DRAFT)
        if not passing and path.is_file():
            yield name


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file with the prefix `sha256:`. Raises OSError."""
    with path.open("rb") as file:
        return f"sha256:{hashlib.file_digest(file, 'sha256').hexdigest()}"
