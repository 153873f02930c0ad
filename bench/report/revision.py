"""Revision of a run's report, and the files written from it.

Reports are written from the sealed record, and may be written again; they are not under its seal. The list of revisions
has the latest hash of every file, and one of itself. While a report is being replaced it has two hashes there, so that
it does not seem altered if the program is killed or the power fails meanwhile.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from bench.clock import wall_utc
from bench.errors import StoreError
from bench.files import content_hash, write_atomically
from bench.reduce.evaluate import Results
from bench.report.afterwards import Afterwards
from bench.store.kept_json import TEXT, WHOLE, list_of, named, object_of, one_of, read_kept
from bench.store.manifest_form import instant
from bench.store.runs import MANIFEST, SEAL, json_text
from bench.store.seal import file_hash
from bench.store.verify import Record, examine
from drivers.schema.bounded import UnfitFileError, expect_bounded

REVISIONS = "report_revisions.json"
FORMS = ("html", "pdf", "json", "csv", "xml")
SCHEMA = "itb-reports/1"
NOTHING_AFTER = Afterwards()
_ISSUED = rf"report\.[A-Za-z0-9-]+-\d{{4}}-\d{{5,}}-[A-Z0-9]+\.({'|'.join(FORMS)})"


@dataclass(frozen=True)
class Revision:
    """Number and date of issue of the present content of a report."""

    number: int
    issued: datetime


def revision_of(
    folder: Path, manifest: Mapping[str, Any], results: Results | None, not_evaluated: str,
    after: Afterwards = NOTHING_AFTER, approval: Mapping[str, Any] | None = None,
) -> Revision:  # fmt: skip
    """Revision of a report with this content, stored in the run directory with the hashes of earlier ones.

    The state of the chambers `after` the run is part of the content. Another form or language is no new revision;
    changed texts of another version of this program are. Raises StoreError if the list of revisions cannot be read or
    written.
    """
    content = {
        "manifest": manifest,
        "results": results.to_json() if results is not None else None,
        "not_evaluated": not_evaluated,
        "program": version("inertial-test-bench"),
    }
    if after != NOTHING_AFTER:
        content["after"] = after._asdict()
    if approval is not None:
        content["approval"] = approval
    content_hash = _hash_of(content)
    known = _known(folder / REVISIONS)
    if not known.revisions or known.revisions[-1]["content"] != content_hash:
        issued = wall_utc().isoformat(timespec="seconds")
        added = {"revision": len(known.revisions) + 1, "issued": issued, "content": content_hash}
        known = replace(known, revisions=(*known.revisions, added))
        _keep(folder, known)
    return Revision(len(known.revisions), datetime.fromisoformat(known.revisions[-1]["issued"]))


def issued_name(report: str, form: str) -> str:
    """Return the name of the file of an issued report: it has the number, so that no other report replaces it."""
    return f"report.{report}.{form}"


def is_issued(name: str) -> bool:
    """True for the name of an issued report."""
    return re.fullmatch(_ISSUED, name) is not None


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Keep others from writing reports of a run meanwhile; wait until they have ended. Raises StoreError.

    The lock, flock(2), is that of the seal, since the lock of the folder is of runs under way.
    """
    try:
        lock = os.open(folder / (SEAL if (folder / SEAL).exists() else MANIFEST), os.O_RDONLY | os.O_CLOEXEC)
    except OSError as problem:
        raise StoreError(f"{folder}: its reports cannot be locked ({problem})") from problem
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
    finally:
        os.close(lock)


@contextmanager
def replacing(folder: Path, name: str, content: bytes) -> Iterator[None]:
    """Store the hash of a report that is written within the context; the earlier one counts until then.

    Raises StoreError.
    """
    written = content_hash(content)
    known = _known(folder / REVISIONS)
    if known.files.get(name) != written:
        _keep(folder, replace(known, writing={name: written}))
    yield
    known = _known(folder / REVISIONS)
    if known.writing or known.files.get(name) != written:
        _keep(folder, replace(known, files={**known.files, name: written}, writing={}))


def changed_reports(folder: Path) -> Iterator[str]:
    """Reports of a run that have been altered, and the list of them if it is damaged."""
    path = folder / REVISIONS
    try:
        known = _known(path)
    except StoreError as problem:
        yield str(problem)
        return
    for name, expected in known.files.items():
        if difference := _problem_of(folder / name, (expected, known.writing.get(name))):
            yield f"{folder / name}: {difference} {_advice(folder, name)}"
    if not (folder / SEAL).exists():  # earlier versions kept no list of reports
        return
    for report in sorted(folder.glob("report.*")):
        if report.suffix.removeprefix(".") not in FORMS or report.name in known.files:
            continue
        if (written := known.writing.get(report.name)) is None or _problem_of(report, (written,)):
            yield f"{report}: is not in {REVISIONS}; {_advice(folder, report.name)}"


def _advice(folder: Path, name: str) -> str:
    if is_issued(name):
        return "restore this approved report from a copy, or issue it again on the page of the run"
    return f"'bench report {folder.name}' writes it again"


def _problem_of(report: Path, expected: Sequence[str | None]) -> str:
    """Difference of a report from its last written state; empty if there is none."""
    try:
        expect_bounded(report, sys.maxsize)
        return "" if file_hash(report) in expected else "has changed since it was written;"
    except UnfitFileError as problem:
        remove = "remove it, then" if os.path.lexists(report) else "but"
        return f"{problem}; {remove}"
    except OSError as problem:
        return f"cannot be read ({problem}); with the right to write it,"


@dataclass(frozen=True)
class _Reports:
    """Revisions, oldest first, and the hash of each file by name; `writing` has that of one being written."""

    revisions: Sequence[Mapping[str, Any]] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    writing: Mapping[str, str] = field(default_factory=dict)


_REVISIONS = list_of(
    object_of({"revision": WHOLE, "issued": instant, "content": TEXT}, ("revision", "issued", "content"))
)
_REPORTS = object_of(
    {"schema": one_of(SCHEMA), "revisions": _REVISIONS, "files": named(TEXT), "writing": named(TEXT), "hash": TEXT},
    ("schema", "revisions", "files", "hash"),
)


def _known(path: Path) -> _Reports:
    """List of revisions of a run; for versions without hashes of files, without them."""
    if not path.is_file():
        return _Reports()
    try:
        found = read_kept(path, lambda value: (_REVISIONS if isinstance(value, list) else _REPORTS)(value))
        if isinstance(found, list):
            return _Reports(found)
        if found.pop("hash") != _hash_of(found):
            raise StoreError("it has changed since it was written")
    except StoreError as problem:
        raise StoreError(
            f"{path}: is damaged ({problem}), so that the revision of the report is unknown; restore it from "
            "a copy, or move it away to start with revision 1"
        ) from problem
    return _Reports(found["revisions"], found["files"], found.get("writing", {}))


def _keep(folder: Path, reports: _Reports) -> None:
    content: dict[str, Any] = {"schema": SCHEMA, "revisions": list(reports.revisions), "files": dict(reports.files)}
    if reports.writing:
        content["writing"] = dict(reports.writing)
    write_atomically(folder / REVISIONS, json_text({**content, "hash": _hash_of(content)}).encode())


def _hash_of(content: object) -> str:
    text = json.dumps(content, ensure_ascii=False, sort_keys=True)
    return content_hash(text.encode())


def examined(folder: Path) -> Record:
    """Full examination of a run directory; reads every row and every file."""
    return examine(folder).with_damage(*changed_reports(folder))


def verify(folder: Path) -> list[str]:
    """Problems of a run's files; empty if there are none."""
    return list(examined(folder).damage)
