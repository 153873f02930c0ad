"""Commands of the Station page to a run, for browsers with and without JavaScript."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Literal

from fastapi import APIRouter, Form, HTTPException, Request
from fastapi.responses import FileResponse, HTMLResponse, RedirectResponse, Response

from bench.errors import BenchError
from bench.figures.languages import language
from bench.runner.control import STOPS
from bench.web.access import Engineer, Operator, Person, Reader, Stopper
from bench.web.api import queue
from bench.web.commanding import command_run, make_safe
from bench.web.pages.render import language_of, page, rendered
from bench.web.services import Services, Station

router = APIRouter(include_in_schema=False)
Text = Annotated[str, Form(max_length=500)]
PICTURES = {
    ".png": "image/png",
    ".jpg": "image/jpeg",
    ".jpeg": "image/jpeg",
    ".webp": "image/webp",
    ".svg": "image/svg+xml",
}
NUMBER = re.compile(r"[+-]?\d+(\.\d+)?")
PICTURE_BYTES = 10_000_000


@router.post("/runs/{run}/do/{command}")
async def stop(
    request: Request,
    station: Station,
    person: Stopper,
    run: str,
    command: Literal["pause", "stop", "stop_after_step", "abort"],
) -> Response:
    """Pause, stop or abort a run."""
    return await _done(request, station, person, run, command)


@router.post("/runs/{run}/go/{command}")
async def go(
    request: Request, station: Station, person: Operator, run: str, command: Literal["resume", "skip", "repeat"]
) -> Response:
    """Resume a run, skip or repeat its step."""
    return await _done(request, station, person, run, command)


@router.post("/runs/{run}/answer")
async def answer(
    request: Request, station: Station, person: Operator, run: str, answer: Text, step: Text, unit: Text = ""
) -> Response:
    """Answer a question of a run; a number alone is in the unit that the page shows beside its input."""
    in_unit = f"{answer.strip()} {unit}" if unit and NUMBER.fullmatch(answer.strip()) else answer
    return await _done(request, station, person, run, "answer", answer=in_unit, step=step)


@router.post("/benches/{bench}/go-on")
async def go_on(station: Station, person: Engineer, bench: str) -> Response:
    """Begin items at a bench again."""
    await queue.go_on(station, person, bench)
    return RedirectResponse(f"/benches/{bench}", 303)


@router.get("/runs/{run}/abort")
async def abort_page(request: Request, station: Station, _: Stopper, run: str) -> HTMLResponse:
    """Return the page that asks for confirmation of an abort, for browsers without JavaScript."""
    station.daemon.catalogue.run(run)
    return page(request, "abort.html.j2", run=run)


@router.get("/runs/{run}/picture")
async def picture(station: Station, _: Reader, run: str, step: str) -> FileResponse:
    """Return the picture of an open question; its path is what somebody wrote, so kind and size are checked."""
    found = station.daemon.live.runs.get(run)
    questions = found.status.get("questions", ()) if found is not None else ()
    path = next((Path(each["picture"]) for each in questions if each["step"] == step and each.get("picture")), None)
    if path is None or path.suffix.lower() not in PICTURES or not path.is_file() or path.stat().st_size > PICTURE_BYTES:
        raise HTTPException(404, "there is no such picture")
    headers = {"content-security-policy": "sandbox; default-src 'none'; style-src 'unsafe-inline'"}
    return FileResponse(path, media_type=PICTURES[path.suffix.lower()], headers=headers)


async def _done(
    request: Request, station: Services, person: Person, run: str, command: str, **arguments: str
) -> Response:
    """Send a command; a script gets the answer of the run, a form goes back to the page of the station."""
    try:
        if command in STOPS:
            answer = await make_safe(station, person, run, command, "")
        else:
            answer = await command_run(station, person, run, command, "", **arguments)
    except BenchError as problem:
        if "hx-request" not in request.headers:
            raise
        return _answer(request, str(problem).removeprefix(f"{run}: "), is_problem=True)
    if "hx-request" in request.headers:
        return _answer(request, answer, is_problem=False)
    return RedirectResponse("/", 303)


def _answer(request: Request, text: str, *, is_problem: bool) -> HTMLResponse:
    with language(language_of(request)):
        return HTMLResponse(rendered("part_answer.html.j2", text=text, is_problem=is_problem))
