"""Start: five steps on one page, each a line when it is done. All that was entered is in the address of the page."""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Mapping
from typing import Any, NamedTuple
from urllib.parse import urlencode

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response

from bench.errors import BenchError, InputError
from bench.figures.times_and_sizes import duration, megabytes
from bench.sequence.steps.manual import SEQUENCE as MANUAL
from bench.station.prepare.before_a_run import BeforeRun, before_run, rehearsal
from bench.station.prepare.sequences import SequenceView
from bench.station.queue.items import Submission
from bench.web.access import Operator
from bench.web.api import queue
from bench.web.api.preparing import BenchInfo, bench_info, rehearsal_id, submission_of
from bench.web.pages.render import form_of, page, with_prefix
from bench.web.services import Services, Station

router = APIRouter(include_in_schema=False)
STEPS = ("sequence", "unit", "parameters", "checks", "go")
UNIT, SET = "unit.", "set."
SPEEDS = ("max", "600", "60", "20", "1")
FIELDS = ("sequence", "bench", "preset", "speed", "order", "procedure", "units_done", "parameters_done", "past_due")
LONGEST, MOST_FIELDS = 2000, 200


class Draft(NamedTuple):
    """What was entered so far; `units` by place and `settings` by parameter."""

    given: Mapping[str, str]
    units: Mapping[str, str]
    settings: Mapping[str, str]

    def field(self, name: str) -> str:
        """Return a field; "" if it was not entered."""
        return self.given.get(name, "")

    def fields(self, *, without: str = "") -> list[tuple[str, str]]:
        """Return all that was entered, but the fields of one step."""
        of_step = {
            "sequence": ("sequence", "bench"), "unit": ("units_done", "order"),
            "parameters": ("preset", "speed", "parameters_done", "procedure", "past_due"),
        }.get(without, ())  # fmt: skip
        found = [(name, value) for name, value in self.given.items() if name not in of_step and value]
        if without != "unit":
            found += [(UNIT + place, serial) for place, serial in self.units.items()]
        if without != "parameters":
            found += [(SET + name, value) for name, value in self.settings.items()]
        return found

    def address(self, step: str = "") -> str:
        """Return the address of the page with all that was entered, and a step open."""
        return f"/start?{urlencode([*self.fields(), *([('step', step)] if step else [])])}"


def draft_of(fields: Mapping[str, str]) -> Draft:
    """Return the draft of the fields of an address or a form. Raises InputError if they are too many or too long."""
    if len(fields) > MOST_FIELDS or any(len(value) > LONGEST for value in fields.values()):
        raise InputError("this form is not one of this station: it is too large")
    given = {name: fields[name].strip() for name in FIELDS if fields.get(name, "").strip()}
    units, settings = with_prefix(fields, UNIT), with_prefix(fields, SET)
    return Draft(given, {place: serial for place, serial in units.items() if serial}, settings)


def changed_settings(draft: Draft, sequence: SequenceView) -> dict[str, str]:
    """Return the settings that differ from those of the sequence with the preset; an empty one is left as it is."""
    usual = sequence.shown_with(draft.field("preset") or None)
    return {name: value for name, value in draft.settings.items() if value and value != usual.get(name)}


def submission(draft: Draft, sequence: SequenceView, bench: BenchInfo, **more: Any) -> Submission:
    """Return the submission of a draft. Raises InputError."""
    return submission_of(
        sequence=sequence.name, bench=bench.name, preset=draft.field("preset") or None,
        settings=changed_settings(draft, sequence), units=dict(draft.units), order=draft.field("order"),
        procedure=draft.field("procedure"), past_due=draft.field("past_due") or "refuse",
        speed=(draft.field("speed") or "max") if bench.simulated else None, **more,
    )  # fmt: skip


class Chosen(NamedTuple):
    """Sequence and bench of a draft, and the first step that is not done."""

    sequence: SequenceView | None
    bench: BenchInfo | None
    step: str


def chosen(station: Services, draft: Draft) -> Chosen:
    """Return what a draft has chosen. Raises InputError for names that the station does not have."""
    sequence = station.daemon.sequences.named(draft.field("sequence")) if draft.field("sequence") else None
    bench = bench_info(station, draft.field("bench")) if draft.field("bench") else None
    if sequence is None or bench is None or sequence.problem or bench.problem:
        return Chosen(sequence, bench, "sequence")
    if not draft.units and not (bench.simulated and draft.field("units_done")):
        return Chosen(sequence, bench, "unit")
    return Chosen(sequence, bench, "checks" if draft.field("parameters_done") else "parameters")


@router.get("/start")
async def start_page(request: Request, station: Station, _: Operator) -> HTMLResponse:
    """Return the page to start a run."""
    draft = draft_of(request.query_params)
    return await _page(request, station, draft, request.query_params.get("step", ""))


async def _page(
    request: Request, station: Services, draft: Draft, step: str = "", *, problem: str = "", status: int = 200
) -> HTMLResponse:
    found = chosen(station, draft)
    reached = STEPS.index(found.step)
    is_open = step if step in STEPS and STEPS.index(step) <= reached else found.step
    checks, wanted = BeforeRun(), None
    if found.step == "checks" and found.sequence is not None and found.bench is not None:
        try:
            wanted = submission(draft, found.sequence, found.bench)
        except InputError as wrong:
            checks = BeforeRun(problems=list(wrong.problems))
    if wanted is not None and is_open == "checks":
        checks = await _checks(station, wanted)
    job = station.daemon.jobs.find(rehearsal_id(wanted)) if wanted is not None else None
    return page(
        request, "start.html.j2", place="/start", status=status, draft=draft, found=found, open=is_open, steps=STEPS,
        reached=reached, sequences=await asyncio.to_thread(_offered, station), speeds=SPEEDS, checks=checks,
        job=job, benches=[bench_info(station, name) for name in station.daemon.settings.benches], problem=problem,
        key=secrets.token_hex(16), duration=duration, megabytes=megabytes,
        usual=found.sequence.shown_with(draft.field("preset") or None) if found.sequence is not None else {},
        picture=_picture(draft, found) if found.step == "checks" else "",
    )  # fmt: skip


def _offered(station: Services) -> list[SequenceView]:
    """Return the sequences of the station; manual control begins on its own page."""
    return [each for each in station.daemon.sequences.all() if each.name != MANUAL]


async def _checks(station: Services, wanted: Submission) -> BeforeRun:
    try:
        return await station.daemon.workers.call(before_run, station.daemon.request(wanted))
    except BenchError as problem:
        return BeforeRun(problems=[str(problem)])


def _picture(draft: Draft, found: Chosen) -> str:
    """Return the address of the picture of the plan."""
    if found.sequence is None or found.bench is None:
        return ""
    fields = [("sequence", found.sequence.name), ("bench", found.bench.name), ("preset", draft.field("preset"))]
    fields += [("setting", f"{name}={value}") for name, value in changed_settings(draft, found.sequence).items()]
    return f"/api/v1/plan.svg?{urlencode([*fields, *(('place', place) for place in draft.units)])}"


@router.post("/start")
async def start(request: Request, station: Station, person: Operator) -> Response:
    """Queue the run, or show again what is wrong. "Run unattended" is refused unless its preflight passes."""
    form = await form_of(request)
    draft = draft_of(form)
    found = chosen(station, draft)
    if found.step != "checks" or found.sequence is None or found.bench is None:
        return await _page(request, station, draft, status=422)
    try:
        wanted = submission(draft, found.sequence, found.bench, unattended=bool(form.get("unattended")))
        if wanted.unattended:
            checks = await _checks(station, wanted.model_copy(update={"unattended": False}))
            if not checks.unattended_allowed:
                raise InputError("the preflight does not let this run be unattended")
        item = await queue.submit(station, person, wanted, form.get("key", "")[:100], held=bool(form.get("held")))
    except InputError as wrong:
        return await _page(request, station, draft, problem=str(wrong), status=422)
    return RedirectResponse(f"/queue/{item.id}", 303)


@router.post("/start/rehearsal")
async def rehearse(request: Request, station: Station, person: Operator) -> Response:
    """Rehearse the run on simulated copies of its instruments; the page shows how it goes."""
    form = await form_of(request)
    draft = draft_of(form)
    found = chosen(station, draft)
    if found.step != "checks" or found.sequence is None or found.bench is None:
        return await _page(request, station, draft, status=422)
    wanted = submission(draft, found.sequence, found.bench)
    station.audit.note(person, "rehearse", wanted.sequence, bench=wanted.bench)
    station.daemon.jobs.ask(
        rehearsal_id(wanted), "rehearsal", wanted.sequence, person.name, rehearsal, station.daemon.request(wanted)
    )
    return RedirectResponse(draft.address(), 303)
