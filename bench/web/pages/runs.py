"""Runs: the list with its filters, one run, and two runs side by side."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from functools import partial
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Form, Query, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response
from pydantic import ValidationError

from bench.clock import wall_utc
from bench.errors import InputError
from bench.figures.numbers import scale_shown
from bench.figures.words import answer_text, quantity_in_words
from bench.station.queue.resuming import ResumptionView
from bench.station.runs.course import course_of
from bench.station.runs.findings import FindingView, findings_of
from bench.station.runs.record_files import files_of
from bench.station.units.comparison import compare
from bench.station.view import RunFilter, RunInfo, found_runs, run_info, run_view
from bench.store.manifest_form import SHOWN_STATES, VERDICTS
from bench.web.access import Approver, Operator, Reader
from bench.web.api import results, signoff
from bench.web.pages import charts
from bench.web.pages.entries_shown import facts_in_words, kind_in_words
from bench.web.pages.render import form_of, language_of, page, person_of
from bench.web.pages.results_shown import (
    ShownFinding,
    bound,
    clock,
    conditions,
    difference,
    mark,
    scaled,
    state_in_words,
)
from bench.web.pages.signing import decision_of, signing_of
from bench.web.patience import TooSoonError
from bench.web.services import Services, Station

router = APIRouter(include_in_schema=False)
AT_ONCE = 50
REPORTED_WITHIN = timedelta(minutes=2)
Words: dict[str, Any] = {
    "clock": clock, "mark": mark, "state_in_words": state_in_words, "scaled": scaled, "difference": difference,
    "bound": bound, "conditions": conditions, "quantity_in_words": quantity_in_words, "scale_shown": scale_shown,
    "shown": ShownFinding, "facts_in_words": facts_in_words, "kind_in_words": kind_in_words, "bullet": charts.bullet,
    "answer_text": answer_text,
}  # fmt: skip


@router.get("/runs")
async def runs_page(request: Request, station: Station, _: Reader) -> HTMLResponse:
    """Return the list of runs; empty fields of its form do not filter."""
    given = {key: value for key, value in request.query_params.items() if value and key in RunFilter.model_fields}
    problem = ""
    try:
        wanted = RunFilter.model_validate(given)
    except ValidationError as wrong:
        problem = "; ".join(f"{each['loc'][0]}: {each['msg']}" for each in wrong.errors())
        wanted = RunFilter.model_validate({})
    found = await asyncio.to_thread(lambda: found_runs(station.daemon.catalogue.all(), wanted, AT_ONCE + 1))
    return page(
        request, "runs.html.j2", place="/runs", runs=found[:AT_ONCE], more=len(found) > AT_ONCE, given=given,
        problem=problem, states=SHOWN_STATES, verdicts=VERDICTS, titles=list(station.daemon.settings.titles.values()),
        **Words,
    )  # fmt: skip


@router.get("/runs/{run}")
async def run_page(request: Request, station: Station, _: Reader, run: str) -> HTMLResponse:
    """Return the page of a run: verdict and its reasons first, then findings, sign-off, course, files, provenance."""
    return await _run_page(request, station, run)


async def _run_page(
    request: Request, station: Services, run: str, given: Mapping[str, str] | None = None, problem: str = "",
    status: int = 200,
) -> HTMLResponse:  # fmt: skip
    """Return the page of a run; `given` and `problem` are the form of a sign-off that was refused, and why."""
    found = station.daemon.catalogue.run(run)
    live = station.daemon.live.runs.get(run)
    content = await asyncio.to_thread(findings_of, found)
    groups = _groups(content.findings)
    course, files = await asyncio.to_thread(course_of, found), await asyncio.to_thread(files_of, found)
    info, reports = run_info(found), [each for each in files if _is_page(each.name)]
    jobs = {
        "reduction": station.daemon.jobs.find(results.reduction_id(run)),
        **{form: station.daemon.jobs.find(results.report_id(run, form, lang)) for form, lang in _forms(request)},
    }
    signing = await signing_of(station, person_of(request), found, files, given, problem, language_of(request))
    return page(
        request, "run.html.j2", status=status, place="/runs", signing=signing, info=info,
        live=run_view(live) if live else None, content=content, groups=groups,
        wrong=[each for each in groups if each.is_wrong],
        course=course, strip=charts.strip(course), files=files,
        manifest=results.provenance_of(found), jobs=jobs, reports=reports,
        changes=not problem and _changes(info, reported=bool(reports)),
        resumption=await _resumption(station, run) if found.state == "interrupted" else None,
        **{**Words, "shown": partial(ShownFinding, dwells=_dwells(content.findings))},
    )  # fmt: skip


def _changes(info: RunInfo, *, reported: bool) -> bool:
    """Return True while a run is in progress or, for a short time after its end, has no report yet."""
    if info.state == "running":
        return True
    try:
        ended = datetime.fromisoformat(str(info.ended))
    except ValueError:
        return False
    return not reported and wall_utc() - ended < REPORTED_WITHIN


def _dwells(found: Sequence[FindingView]) -> dict[str, int]:
    """Return the number of each dwell by its path, the part of an id after the @."""
    return {each.id.partition("@")[2]: each.at["dwell"] for each in found if isinstance(each.at.get("dwell"), int)}


def _is_page(name: str) -> bool:
    return name.startswith("report.") and name.endswith(".html")


def _forms(request: Request) -> list[tuple[str, str]]:
    return [("pdf", language_of(request)), ("html", language_of(request))]


async def _resumption(station: Services, run: str) -> ResumptionView:
    try:
        return await results.resumption_view(station, run)
    except InputError as problem:
        return ResumptionView(possible=False, lines=list(problem.problems))


class _Group:
    """Results of one quantity of one unit, the closest to a limit first."""

    def __init__(self, found: Sequence[FindingView]) -> None:
        order = {"FAIL": 0, "INVALID": 1}
        ordered = sorted(found, key=lambda each: (order.get(each.verdict or "", 2), each.margin))
        self.worst, self.all = ordered[0], list(found)

    @property
    def is_wrong(self) -> bool:
        """True if a result is beyond a limit or invalid."""
        return self.worst.verdict in ("FAIL", "INVALID")

    @property
    def failed(self) -> int:
        """Number of results beyond a limit."""
        return sum(each.verdict == "FAIL" for each in self.all)

    @property
    def is_judged(self) -> bool:
        """True if the quantity has limits."""
        return self.worst.is_judged


def _groups(found: Sequence[FindingView]) -> list[_Group]:
    """Return results by unit and quantity; those with limits first."""
    by: dict[tuple[str, str], list[FindingView]] = {}
    for each in found:
        by.setdefault((each.uut, each.quantity), []).append(each)
    return sorted(map(_Group, by.values()), key=lambda group: not group.is_judged)


@router.post("/runs/{run}/sign-off")
async def sign_off(request: Request, station: Station, person: Approver, run: str) -> Response:
    """Approve or reject a run; if it is refused, show the page again with the reason and what was entered."""
    form = await form_of(request)
    try:
        await signoff.decide(station, person, run, decision_of(form))
    except InputError as wrong:
        status = 429 if isinstance(wrong, TooSoonError) else 422
        return await _run_page(request, station, run, form, str(wrong), status)
    return RedirectResponse(f"/runs/{run}#sign-off", 303)


@router.post("/runs/{run}/{action}")
async def act(
    station: Station, person: Operator, run: str, action: Literal["pdf", "html", "reduce", "resume"],
    lang: Annotated[Literal["en", "zh"], Form()] = "en",
) -> Response:  # fmt: skip
    """Write the report, reduce a run again, or resume an interrupted one."""
    if action == "resume":
        await results.resume(station, person, run)
    elif action == "reduce":
        await results.reduce_again(station, person, run)
    else:
        await results.write_report(station, person, run, action, lang)
    return RedirectResponse(f"/runs/{run}#done", 303)


@router.get("/compare")
async def compare_page(
    request: Request, station: Station, _: Reader, run: Annotated[list[str], Query(max_length=2)]
) -> HTMLResponse:
    """Return two runs side by side, the older one first."""
    if len(run) != 2:
        raise InputError("choose two runs to compare")
    first, second = (station.daemon.catalogue.run(name) for name in sorted(run))
    found = await asyncio.to_thread(compare, first, second)
    return page(
        request, "compare.html.j2", place="/runs", found=found, first=run_info(first), second=run_info(second), **Words
    )
