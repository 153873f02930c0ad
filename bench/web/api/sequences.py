"""Texts of sequences: versions, differences, changes, and what an editor needs."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Query, status
from pydantic import BaseModel, Field

from bench.app.inputs import digest_of
from bench.config.document import SIZE_LIMIT_BYTES
from bench.errors import StaleError
from bench.station.prepare import differences, texts
from bench.station.prepare.completion import Completion, complete
from bench.station.prepare.drafts import DraftCheck, Examined, bench_texts, check_draft, check_file, expect_readable
from bench.station.prepare.releases import Kind, Release
from bench.station.prepare.texts import SequenceText
from bench.station.prepare.versions import Version
from bench.station.queue.items import Line, Word
from bench.store.runs import SEQUENCE_COPY
from bench.web.access import Engineer, Person, Reader
from bench.web.api.releases import Difference
from bench.web.services import Services, Station

router = APIRouter(prefix="/api/v1", tags=["sequences"])
TEXT_MOST = 2 * SIZE_LIMIT_BYTES  # letters; the file has its own limit
NOW, RELEASED = "now", "released"
Text = Annotated[str, Field(max_length=TEXT_MOST)]
WhichText = Annotated[str, Query(max_length=64, description="id of a version, `now`, `released` or `release-N`")]


class NewText(BaseModel):
    """Change of a sequence, or a new one."""

    text: Text
    base: str = Field(
        "", max_length=64, description="digest of the text that it was made from; empty for a new sequence"
    )
    message: Line = Field(min_length=1, description="what has changed, and why")


class Draft(BaseModel):
    """Text that somebody edits, and the bench that it is for."""

    text: Text
    bench: Word
    beside: Word | None = Field(None, description="sequence in whose folder it will be; default: the laboratory's")


class Cursor(Draft):
    """Draft with a cursor."""

    at: int = Field(ge=0, le=TEXT_MOST, description="number of letters before it")


class NewSequenceRelease(BaseModel):
    """Release of a sequence that passes its check on a bench."""

    bench: Word
    digest: str = Field(max_length=64, description="digest of the text that the releasing person has seen")
    comment: Line = Field(min_length=1)


class NewBenchRelease(BaseModel):
    """Release of a bench file with the files that it names."""

    digest: str = Field(max_length=64, description="digest of the files that the releasing person has seen")
    comment: Line = Field(min_length=1)


class BenchTexts(BaseModel):
    """Bench file and the files that it names, by the names of their copies in a run."""

    name: str
    file: str = Field(description="path of the bench file")
    texts: Mapping[str, str]
    digest: str


@router.get("/sequences/{name}/text")
async def text(station: Station, _: Reader, name: str) -> SequenceText:
    """Return the text of a sequence."""
    return await asyncio.to_thread(station.daemon.texts.text, name)


@router.get("/sequences/{name}/versions")
async def versions(station: Station, _: Reader, name: str) -> list[Version]:
    """Return the versions of a sequence of the laboratory, newest first."""
    return await asyncio.to_thread(station.daemon.texts.versions, name)


@router.get("/sequences/{name}/difference")
async def difference(
    station: Station, _: Reader, name: str, old: WhichText = RELEASED, new: WhichText = NOW
) -> Difference:
    """Return the difference of two versions of a sequence, as `diff -u` writes it."""
    before, after = [await _version(station, name, which) for which in (old, new)]
    return Difference(lines=differences.difference(before, after, f"{name}, {old}", f"{name}, {new}"))


async def _version(station: Services, name: str, which: str) -> str:
    if which == NOW:
        return (await asyncio.to_thread(station.daemon.texts.text, name)).text
    releases = station.daemon.releases
    if which == RELEASED:
        newest = releases.newest("sequence", name)
        return newest.texts.get(SEQUENCE_COPY, "") if newest is not None else ""
    number = which.removeprefix("release-")
    if number != which and number in {str(each.number) for each in releases.of("sequence", name)}:
        return releases.texts_of(int(number)).get(SEQUENCE_COPY, "")
    return await asyncio.to_thread(station.daemon.texts.version, name, which)


@router.put("/sequences/{name}")
async def save(station: Station, person: Engineer, name: str, wanted: NewText) -> SequenceText:
    """Save a text as a new version of a sequence of the laboratory.

    It is refused if the sequence has been changed since `base`, and if it cannot be read as a sequence.
    """
    texts.file_name(name)
    written = texts.as_file(wanted.text)
    await station.daemon.drafts.call(expect_readable, name, written)
    saved = await asyncio.to_thread(station.daemon.texts.save, name, written, wanted.base, person.name, wanted.message)
    station.audit.note_afterwards(
        person, "save sequence", name, reason=wanted.message, before=wanted.base, after=saved.digest
    )
    return saved


@router.post("/sequences/{name}/check")
async def check(station: Station, _: Engineer, name: str, draft: Draft) -> DraftCheck:
    """Check a text as a sequence on a bench, as `bench check` does; nothing is saved."""
    return await checked_draft(station, name, draft)


async def checked_draft(station: Services, name: str, draft: Draft, lang: str = "") -> DraftCheck:
    """Check a draft; `lang` is the language of its picture, "" for none. Raises InputError."""
    texts.file_name(name)
    beside = station.daemon.texts.folder
    if draft.beside is not None:
        beside = station.daemon.settings.sequence_file(draft.beside).parent
    bench = station.daemon.settings.bench_file(draft.bench)
    return await station.daemon.drafts.call(check_draft, name, texts.as_file(draft.text), beside, bench, lang)


@router.post("/completion")
async def completion(station: Station, _: Engineer, cursor: Cursor) -> Completion:
    """Return the keys, values and names that may stand at a cursor."""
    bench = station.daemon.settings.bench_file(cursor.bench)
    texts.as_file(cursor.text)
    return await station.daemon.drafts.call(complete, cursor.text, cursor.at, bench)


@router.get("/benches/{bench}/files")
async def bench_files(station: Station, _: Reader, bench: str) -> BenchTexts:
    """Return a bench file and the files that it names."""
    file = station.daemon.settings.bench_file(bench)
    found = await station.daemon.drafts.call(bench_texts, file)
    return BenchTexts(name=bench, file=str(file), texts=found, digest=digest_of(found))


@router.post("/releases/sequence/{name}", status_code=status.HTTP_201_CREATED)
async def release_sequence(station: Station, person: Engineer, name: str, wanted: NewSequenceRelease) -> Release:
    """Release a sequence and those that it calls, after a check on a bench without errors."""
    found = await examined(station, name, wanted.bench)
    if found.check.errors:
        first = found.check.errors[0]
        raise StaleError(f"{first.file or name}:{first.line}: {first.text}; it is released when its check passes")
    _expect_seen(name, found.texts, wanted.digest)
    return _release(station, person, "sequence", name, found.texts, wanted.comment)


@router.post("/releases/bench/{name}", status_code=status.HTTP_201_CREATED)
async def release_bench(station: Station, person: Engineer, name: str, wanted: NewBenchRelease) -> Release:
    """Release a bench file and the files that it names."""
    found = await bench_files(station, person, name)
    _expect_seen(name, found.texts, wanted.digest)
    return _release(station, person, "bench", name, found.texts, wanted.comment)


async def examined(station: Services, name: str, bench: str) -> Examined:
    """Return the check of the file of a sequence on a bench. Raises InputError for names that are not there."""
    path: Path = station.daemon.settings.sequence_file(name)
    return await station.daemon.drafts.call(check_file, path, station.daemon.settings.bench_file(bench))


def _expect_seen(name: str, found: Mapping[str, str], digest: str) -> None:
    if digest_of(found) != digest:
        raise StaleError(f"'{name}' has been changed since this page was shown; look at the difference again")


def _release(
    station: Services, person: Person, kind: Kind, name: str, found: Mapping[str, str], comment: str
) -> Release:
    releases = station.daemon.releases
    newest = releases.newest(kind, name)
    with station.audit.noted(person, f"release {kind}", name, reason=comment) as facts:
        lines = list(differences.difference_of(f"{kind} {name}", newest.texts if newest is not None else {}, found))
        facts["difference"], facts["digest"] = lines[:200], digest_of(found)
        return releases.release_one(kind, name, found, person.name, comment)
