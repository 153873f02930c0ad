"""What precedes a run: sequences, places of benches, picture of the plan, checks, rehearsal."""

from __future__ import annotations

import hashlib
from typing import Annotated, Literal, TypeVar

from fastapi import APIRouter, Query, Response, status
from pydantic import BaseModel, Field, ValidationError

from bench.errors import InputError
from bench.station.jobs import Job
from bench.station.prepare.before_a_run import BeforeRun, before_run, plan_picture, rehearsal
from bench.station.prepare.sequences import SequenceView
from bench.station.queue.items import Submission
from bench.web.access import Operator, Reader
from bench.web.services import Services, Station

router = APIRouter(prefix="/api/v1", tags=["before a run"])
PICTURE_CSP = "default-src 'none'; style-src 'unsafe-inline'; sandbox"
Lang = Literal["en", "zh"]
M = TypeVar("M", bound=BaseModel)


class PlaceView(BaseModel):
    """Place for a unit at a bench."""

    name: str
    title: str = Field(description="nominal type of the unit")


class BenchInfo(BaseModel):
    """Bench with its places."""

    name: str
    title: str
    simulated: bool = Field(description="all instruments are simulated; a run may have another speed than 1")
    places: list[PlaceView]
    devices: dict[str, str] = Field(description="driver of each instrument")
    problem: str = Field("", description="why its file cannot be read; the rest is empty then")


@router.get("/sequences")
def sequences(station: Station, _: Reader) -> list[SequenceView]:
    """Return the sequences of the station."""
    return station.daemon.sequences.all()


@router.get("/sequences/{name}")
def sequence(station: Station, _: Reader, name: str) -> SequenceView:
    """Return a sequence with its parameters, their units and bounds."""
    return station.daemon.sequences.named(name)


@router.get("/benches")
def benches(station: Station, _: Reader) -> list[BenchInfo]:
    """Return the benches of the station with their places."""
    return [bench_info(station, name) for name in station.daemon.settings.benches]


def bench_info(station: Services, name: str) -> BenchInfo:
    """Return a bench with its places. Raises InputError if the station does not have it."""
    settings = station.daemon.settings
    settings.bench_file(name)
    title = settings.titles[name]
    try:
        bench = settings.bench(name).bench
    except InputError as problem:
        return BenchInfo(name=name, title=title, simulated=False, places=[], devices={}, problem=str(problem))
    places = [PlaceView(name=place, title=entry.type) for place, entry in bench.places.items()]
    devices = {role: entry.driver for role, entry in bench.devices.items()}
    return BenchInfo(name=name, title=title, simulated=bench.is_simulated, places=places, devices=devices)


@router.get("/plan.svg")
async def picture(
    station: Station, _: Reader, sequence: str, bench: str, preset: str = "",
    setting: Annotated[list[str] | None, Query(max_length=50, description="NAME=VALUE; repeatable")] = None,
    place: Annotated[list[str] | None, Query(max_length=50, description="places with a unit")] = None,
    lang: Lang = "en",
) -> Response:  # fmt: skip
    """Return the picture of a plan as SVG."""
    settings = dict(each.partition("=")[::2] for each in setting or ())
    submission = submission_of(
        sequence=sequence, bench=bench, preset=preset or None, settings=settings,
        units={each: f"unit-{number}" for number, each in enumerate(place or ())},
    )  # fmt: skip
    drawn = await station.daemon.workers.call(plan_picture, station.daemon.request(submission), lang)
    return Response(drawn, media_type="image/svg+xml", headers={"content-security-policy": PICTURE_CSP})


@router.post("/before-run")
async def before(station: Station, _: Operator, submission: Submission) -> BeforeRun:
    """Check a submission and perform its preflight: whether it may be unattended. Nothing is energised."""
    return await station.daemon.workers.call(before_run, station.daemon.request(submission))


@router.post("/rehearsals", status_code=status.HTTP_202_ACCEPTED)
async def rehearse(station: Station, person: Operator, submission: Submission) -> Job:
    """Rehearse a submission on simulated copies of all instruments; return the job."""
    request = station.daemon.request(submission)
    station.audit.note(person, "rehearse", submission.sequence, bench=submission.bench)
    return station.daemon.jobs.ask(
        rehearsal_id(submission), "rehearsal", submission.sequence, person.name, rehearsal, request
    )


def rehearsal_id(submission: Submission) -> str:
    """Return the id of the rehearsal of a submission: that of its sequence, bench and parameters."""
    wanted = submission.model_dump_json(include={"sequence", "bench", "preset", "settings"})
    return f"rehearsal-{hashlib.sha256(wanted.encode()).hexdigest()[:32]}"


@router.get("/jobs/{id_}")
def job(station: Station, _: Reader, id_: str) -> Job:
    """Return a job: a rehearsal, a report, or a reduction."""
    return station.daemon.jobs.job(id_)


def submission_of(**fields: object) -> Submission:
    """Return a submission of these fields. Raises InputError with all that is wrong."""
    return read_fields(Submission, fields)


def read_fields(model: type[M], fields: object) -> M:
    """Return a model of the fields of a form. Raises InputError with all that is wrong."""
    try:
        return model.model_validate(fields)
    except ValidationError as problem:
        found = (f"{'.'.join(map(str, each['loc']))}: {each['msg']}" for each in problem.errors(include_url=False))
        raise InputError(*found) from None
