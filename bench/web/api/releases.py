"""Released versions of sequences and bench files."""

from __future__ import annotations

from fastapi import APIRouter, status
from pydantic import BaseModel, Field

from bench.errors import InputError
from bench.station.prepare.releases import Release
from bench.station.queue.items import Line, Submission
from bench.web.access import Engineer, Reader
from bench.web.services import Services, Station

router = APIRouter(prefix="/api/v1/releases", tags=["releases"])


class NewRelease(BaseModel):
    """Release of the sequence and the bench file of a submission, which must pass its check."""

    submission: Submission
    comment: Line = Field(min_length=1)


class Difference(BaseModel):
    """Difference of files from their released versions, as `diff -u` writes it; empty if there is none."""

    lines: list[str]


@router.get("")
async def releases(station: Station, _: Reader) -> list[Release]:
    """Return all releases, newest first."""
    return station.daemon.releases.all()


@router.post("", status_code=status.HTTP_201_CREATED)
async def release(station: Station, person: Engineer, wanted: NewRelease) -> list[Release]:
    """Release the files that a submission uses."""
    submission, inputs = wanted.submission, await _inputs(station, wanted.submission)
    names = submission.sequence, submission.bench
    releases = station.daemon.releases
    with station.audit.noted(person, "release files", " ".join(names), reason=wanted.comment) as facts:
        facts["difference"] = releases.difference(*names, inputs)[:200]
        return releases.release(*names, inputs, person.name, wanted.comment)


@router.post("/difference")
async def difference(station: Station, _: Reader, submission: Submission) -> Difference:
    """Return how the files of a submission differ from their released versions."""
    inputs = await _inputs(station, submission)
    return Difference(lines=station.daemon.releases.difference(submission.sequence, submission.bench, inputs))


async def _inputs(station: Services, submission: Submission) -> dict[str, str]:
    found = await station.daemon.checked(submission)
    if found.problems:
        raise InputError(*found.problems)
    return dict(found.inputs)
