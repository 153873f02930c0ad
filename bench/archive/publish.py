"""Publication of a sealed run: its files, its data as Parquet, and its rows in the tables.

The order makes a publication visible as a whole: first the objects, each read back, then the number of the version by a
conditional write, then the rows of the results, and last the row in the table `runs`, without which no query shows any
of the others. All names follow from the content, so that a push that was killed is repeated without leaving anything
twice.
"""

from __future__ import annotations

import hashlib
import json
import platform
import tempfile
from collections.abc import Callable, Iterator, Mapping
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from bench.archive.destination import Destination
from bench.archive.rows import Claim, Publication, Reduced, rows_of
from bench.archive.tables import Tables
from bench.clock import wall_utc
from bench.errors import InputError, StoreError
from bench.files import content_hash
from bench.reduce.stored_run import open_run
from bench.report.export.parquet import export_parquet
from bench.report.revision import writing
from bench.store.database import FILE_NAME
from bench.store.kept_json import read_kept
from bench.store.manifest_form import WHOLE_FORM
from bench.store.runs import MANIFEST, SEAL
from bench.store.seal import DERIVED, file_hash, sealable
from bench.store.verify import examine

RAW = "raw"
MOST_VERSIONS = 9999


class Pushed(NamedTuple):
    """Result of a push: the version, and whether it is new, had been there, or was completed."""

    run: str
    folder: str
    number: int
    was_there: bool
    objects: int
    bytes: int


def identity_of(run: Path, manifest: Mapping[str, Any]) -> str:
    """Return the identity of a run wherever its folder is: its UUID, for older runs the digest of its seal."""
    found = manifest.get("uuid")
    return str(found) if found else hashlib.sha256((run / SEAL).read_bytes()).hexdigest()[:32]


def push(run: Path, destination: Destination, *, watch: Callable[[str], None] = lambda _: None) -> Pushed:
    """Publish a run; `watch` is called with the name of each object once it is there.

    Raises InputError if the run is not sealed or is damaged, and StoreError.
    """
    _expect_sealed(run)
    destination.prove()
    destination.begin()
    with writing(run):
        return _pushed(run, destination, watch)


def _expect_sealed(run: Path) -> None:
    record = examine(run)
    if record.damage:
        raise InputError(
            f"{run}: the record is damaged and is not archived: {record.damage[0]}; see 'bench runs verify'"
        )
    if record.kind != "sealed":
        raise InputError(f"{run}: {record.in_words}; only the record of an ended run, with its seal, is archived")


def _pushed(run: Path, destination: Destination, watch: Callable[[str], None]) -> Pushed:
    tables, manifest = Tables(destination), read_kept(run / MANIFEST, WHOLE_FORM)
    uuid, year = identity_of(run, manifest), datetime.fromisoformat(manifest["started"]).year
    name_there = f"{manifest['run']}_{uuid[:8]}"
    folder = f"runs/{name_there}"
    files = dict(_files(run))
    digest = digest_of(files)
    claims = _claims(destination, folder)
    number = next((number for number, claim in claims.items() if claim.digest == digest), None)
    if number is not None and tables.holds("runs", uuid, number, year):
        return Pushed(run.name, folder, number, True, 0, 0)
    objects = dict(_written_files(run, folder, files, destination, watch))
    objects |= _written_data(run, folder, files[FILE_NAME], destination, watch)
    number, claim = claimed(destination, folder, digest)
    show(run, manifest, Publication(uuid, number, folder, objects, claim), tables, watch=watch)
    return Pushed(run.name, folder, number, False, len(objects), sum(each["bytes"] for each in objects.values()))


def show(
    run: Path, manifest: Mapping[str, Any], publication: Publication, tables: Tables,
    *, reduced: Reduced | None = None, watch: Callable[[str], None] = lambda _: None,
) -> None:  # fmt: skip
    """Write the rows of a publication whose objects are there; rows of an earlier attempt stay. Raises StoreError."""
    year = datetime.fromisoformat(manifest["started"]).year
    for name, rows in rows_of(run, manifest, publication, reduced).items():
        if not tables.holds(name, publication.uuid, publication.number, year):
            tables.append(name, rows, f"{Path(publication.folder).name}-v{publication.number:04}")
        watch(f"tables/{name}")


def _files(run: Path) -> Iterator[tuple[str, str]]:
    """Yield the files of a run with their SHA-256: those under its seal, the seal, and its reports."""
    names = {*sealable(run), SEAL, *(path.name for path in run.iterdir() if path.name.startswith(DERIVED))}
    for name in sorted(names):
        if (run / name).is_file():
            yield name, file_hash(run / name)


def digest_of(files: Mapping[str, str]) -> str:
    """Return the digest of a version by those of its files."""
    return content_hash(json.dumps(files, sort_keys=True).encode())


def _claims(destination: Destination, folder: str) -> dict[int, Claim]:
    """Return the versions of a run by their numbers."""
    found = {}
    for name in destination.names(f"{folder}/versions"):
        content = destination.read(name)
        if content is not None:
            found[int(Path(name).stem)] = Claim(**json.loads(content))
    return found


def claimed(destination: Destination, folder: str, digest: str) -> tuple[int, Claim]:
    """Return the number and the claim of a version; of two pushes of the same content both get the same.

    Raises StoreError.
    """
    own = Claim(digest, wall_utc().isoformat(timespec="seconds"), version("inertial-test-bench"), platform.node())
    while True:
        claims = _claims(destination, folder)
        for number, claim in claims.items():
            if claim.digest == digest:
                return number, claim
        free = max(claims, default=0) + 1
        if free > MOST_VERSIONS:
            raise StoreError(f"{destination.url}/{folder}: has {MOST_VERSIONS} versions")
        destination.create(f"{folder}/versions/{free:04}.json", json.dumps(own._asdict()).encode())


def _written_files(
    run: Path, folder: str, files: Mapping[str, str], destination: Destination, watch: Callable[[str], None]
) -> Iterator[tuple[str, dict[str, Any]]]:
    for name, digest in files.items():
        place = f"{folder}/files/{short(digest)}/{name}"
        yield name, written(run / name, place, digest, destination)
        watch(place)


def _written_data(
    run: Path, folder: str, database: str, destination: Destination, watch: Callable[[str], None]
) -> dict[str, dict[str, Any]]:
    """Write the data of a run as Parquet, in a folder by the digest of its database."""
    found = {}
    with tempfile.TemporaryDirectory() as scratch, open_run(run) as stored:
        for path in export_parquet(stored, Path(scratch)):
            place = f"{folder}/{RAW}/{short(database)}/{path.name}"
            found[f"{RAW}/{path.name}"] = written(path, place, file_hash(path), destination)
            watch(place)
    return found


def written(path: Path, place: str, digest: str, destination: Destination) -> dict[str, Any]:
    """Write a file unless the same is there, and read it back. Raises StoreError if it differs then."""
    if destination.digest(place) != digest:
        destination.write(place, path)
        if (found := destination.digest(place)) != digest:
            raise StoreError(f"{destination.url}/{place}: reads back as {found} where {digest} was written")
    return {"object": place, "sha256": digest.removeprefix("sha256:"), "bytes": path.stat().st_size}


def short(digest: str) -> str:
    """Return the part of a SHA-256 that is in the name of a folder."""
    return digest.removeprefix("sha256:")[:16]
