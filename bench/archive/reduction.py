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
from bench.reduce.reduced_again import RESULTS, ReReduction, reduced_again
from bench.reduce.stored_run import StoredRun, open_run
from bench.store.runs import json_text
from bench.store.seal import file_hash

REDUCED = f"reduced/{RESULTS}"  # name among the files of a version
_LATEST_OF_OTHERS = """
SELECT uuid, max(version), any_value(run) FROM all_runs WHERE reduced_by IS DISTINCT FROM ?
GROUP BY uuid ORDER BY min(started), uuid
"""


class Again(NamedTuple):
    """Differences of a re-reduction from a version, and the number of the version that it became, or None."""

    found: ReReduction
    published: int | None


class Candidate(NamedTuple):
    """Latest version of a run that is not a re-reduction by the present program."""

    uuid: str
    version: int
    run: str


def candidates(archive: Archive, program: str) -> list[Candidate]:
    """Return the version of each run that this program reduces, in the order in which the runs began."""
    return [Candidate(*row) for row in archive.query(_LATEST_OF_OTHERS, [program]).rows]


def reduce_again(
    archive: Archive, uuid: str, version: int, scratch: Path, *, program: str, publish: bool = False
) -> Again:
    """Restore a version of a run below `scratch`, verified, and reduce it; compare with the results of that version.

    With `publish` and differences, the results become a new version. A repeated call publishes nothing twice. Raises
    InputError if there is no such version, and StoreError.
    """
    folder = fetch(archive, uuid, scratch, version)
    place, files = _place(archive, uuid, version)
    known = folder / RESULTS
    if REDUCED in files:
        known = scratch / "before.json"
        known.write_bytes(b"".join(archive.destination.chunks(files[REDUCED]["object"])))
    with open_run(folder) as stored:
        found = reduced_again(stored, known)
        if not publish or not (found.changes or found.verdict != found.verdict_before):
            return Again(found, None)
        reduced = Reduced(scratch / "now.json", found.verdict, program)
        return Again(found, _published(archive, stored, uuid, place, files, reduced))


def _place(archive: Archive, uuid: str, version: int) -> tuple[str, dict[str, Any]]:
    """Return the folder of a run in the archive, and the objects of a version by the names of the files."""
    sql = "SELECT folder, files FROM all_runs WHERE uuid = ? AND version = ?"
    ((folder, files),) = archive.query(sql, [uuid, version]).rows
    return str(folder), json.loads(files)


def _published(
    archive: Archive, run: StoredRun, uuid: str, folder: str, files: dict[str, Any], reduced: Reduced
) -> int:
    """Publish the results of the present program with the files of a version; return the number of the new version."""
    destination = archive.destination
    destination.prove()
    reduced.file.write_text(json_text(run.evaluate().to_json()), "utf-8")
    digest = file_hash(reduced.file)
    place = f"{folder}/reduced/{short(digest)}/{RESULTS}"
    files = {**files, REDUCED: written(reduced.file, place, digest, destination)}
    number, claim = claimed(destination, folder, digest_of({name: each["sha256"] for name, each in files.items()}))
    show(
        run.folder, run.manifest, Publication(uuid, number, folder, files, claim), Tables(destination), reduced=reduced
    )
    return number
