"""Re-reduction of an archived run by the present program: a new version, which leaves the earlier ones as they are."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

from bench.archive.fetch import fetch
from bench.archive.publish import claimed, digest_of, short, show, written
from bench.archive.query import Archive
from bench.archive.rows import Publication, Reduced
from bench.archive.tables import Tables
from bench.errors import InputError
from bench.reduce.reduced_again import RESULTS, ReReduction, reduced_again
from bench.reduce.stored_run import StoredRun, open_run
from bench.store.runs import json_text
from bench.store.seal import file_hash

REDUCED = f"reduced/{RESULTS}"  # name among the files of a version
_VERSIONS = "SELECT version, files, reduced_by FROM all_runs WHERE uuid = ? ORDER BY version DESC"


class Again(NamedTuple):
    """Differences of a re-reduction from a version, and the number of the version that it became, or None."""

    found: ReReduction
    published: int | None


def before(archive: Archive, uuid: str, program: str) -> int:
    """Return the latest version of a run that is not a re-reduction by this program. Raises InputError without one."""
    for number, _, reduced_by in archive.query(_VERSIONS, [uuid]).rows:
        if reduced_by != program:
            return int(number)
    raise InputError(f"{archive.destination.url}: there is no run {uuid}")


def reduce_again(
    archive: Archive, uuid: str, version: int, scratch: Path, *, program: str, publish: bool = False
) -> Again:
    """Restore a version of a run below `scratch`, verified, and reduce it; compare with the results of that version.

    With `publish` and differences, the results become a new version. A repeated call publishes nothing twice. Raises
    InputError if there is no such version, and StoreError.
    """
    folder = fetch(archive, uuid, scratch, version)
    known = _known(archive, uuid, version, folder, scratch / "before.json")
    with open_run(folder) as stored:
        found = reduced_again(stored, known)
        if not publish or not (found.changes or found.verdict != found.verdict_before):
            return Again(found, None)
        number = _published(archive, stored, uuid, version, scratch / "now.json", program)
    return Again(found, number)


def _place(archive: Archive, uuid: str, version: int) -> tuple[str, dict[str, Any]]:
    """Return the folder of a run in the archive, and the objects of a version by the names of the files."""
    sql = "SELECT folder, files FROM all_runs WHERE uuid = ? AND version = ?"
    ((folder, files),) = archive.query(sql, [uuid, version]).rows
    return str(folder), json.loads(files)


def _known(archive: Archive, uuid: str, version: int, run: Path, path: Path) -> Path:
    """Return the file with the results of a version: those of the run, or of a re-reduction, written to `path`."""
    _, files = _place(archive, uuid, version)
    if REDUCED not in files:
        return run / RESULTS
    path.write_bytes(b"".join(archive.destination.chunks(files[REDUCED]["object"])))
    return path


def _published(archive: Archive, run: StoredRun, uuid: str, version: int, file: Path, program: str) -> int:
    """Publish the results of the present program with the files of a version; return the number of the new version."""
    destination, results = archive.destination, run.evaluate().to_json()
    destination.prove()
    file.write_text(json_text(results), "utf-8")
    folder, files = _place(archive, uuid, version)
    digest = file_hash(file)
    files[REDUCED] = written(file, f"{folder}/reduced/{short(digest)}/{RESULTS}", digest, destination)
    number, claim = claimed(destination, folder, digest_of({name: each["sha256"] for name, each in files.items()}))
    show(
        run.folder, run.manifest, Publication(uuid, number, folder, files, claim), Tables(destination),
        reduced=Reduced(file, results["verdict"], program),
    )  # fmt: skip
    return number
