"""Runs after their end: findings, files, provenance, comparison, report, reduction, resumption; and units."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from typing import Annotated, Any, BinaryIO, Literal

from fastapi import APIRouter, Query, status
from fastapi.responses import StreamingResponse

from bench.errors import InputError
from bench.station.jobs import Job
from bench.station.queue.resuming import ResumptionView, resumption_of
from bench.station.runs.after_a_run import reduction, report
from bench.station.runs.findings import RunFindings, findings_of
from bench.station.runs.record_files import FileView, files_of, opened
from bench.station.units.comparison import Comparison, compare
from bench.station.units.history import UnitHistory
from bench.store.runs import RunSummary
from bench.web.access import Operator, Reader
from bench.web.services import Services, Station

router = APIRouter(prefix="/api/v1", tags=["results"])
SANDBOX = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; form-action 'none'; base-uri 'none'"
SHOWN_REPORT = f"{SANDBOX}; frame-ancestors 'self'"
CHUNK_BYTES = 2**16
SECRET = frozenset({"request", "process", "host"})  # paths and names of the computer


@router.get("/comparison")
async def comparison(station: Station, _: Reader, first: str, second: str) -> Comparison:
    """Compare the results of two runs: difference and E_n of each."""
    runs = [station.daemon.catalogue.run(name) for name in (first, second)]
    return await asyncio.to_thread(compare, *runs)


@router.get("/units")
async def units(station: Station, _: Reader, text: Annotated[str, Query(max_length=64)] = "") -> dict[str, list[str]]:
    """Return serial numbers with their runs, the unit of the newest run first."""
    return await asyncio.to_thread(units_of, station, text)


def units_of(station: Services, text: str = "") -> dict[str, list[str]]:
    """Return the runs of each serial number that contains a text."""
    found: dict[str, list[str]] = {}
    for run in station.daemon.catalogue.all():
        for serial in run.units:
            if text.lower() in serial.lower():
                found.setdefault(serial, []).append(run.id)
    return found


@router.get("/unit")
async def unit(
    station: Station, _: Reader, serial: Annotated[str, Query(min_length=1, max_length=64)], quantity: str = ""
) -> UnitHistory:
    """Return the history of a unit: each result over its calibrations, E_n, drift, control chart."""
    found = await asyncio.to_thread(station.daemon.histories.of, serial)
    if not found.runs:
        raise InputError(f"there is no run of unit '{serial}'")
    chosen = [each for each in found.series if quantity in ("", each.quantity)]
    return found.model_copy(update={"series": chosen})


@router.get("/runs/{run}/findings")
async def findings(station: Station, _: Reader, run: str) -> RunFindings:
    """Return verdict, its reasons and all findings of a run."""
    return await asyncio.to_thread(lambda: findings_of(station.daemon.catalogue.run(run)))


@router.get("/runs/{run}/provenance")
async def provenance(station: Station, _: Reader, run: str) -> dict[str, Any]:
    """Return the manifest of a run: instruments with certificates, parameters, hashes, software."""
    return await asyncio.to_thread(lambda: provenance_of(station.daemon.catalogue.run(run)))


def provenance_of(run: RunSummary) -> dict[str, Any]:
    """Return the manifest of a run without what belongs to the computer."""
    return {key: value for key, value in run.manifest.items() if key not in SECRET}


@router.get("/runs/{run}/files")
async def files(station: Station, _: Reader, run: str) -> list[FileView]:
    """Return the files that the record of a run lists."""
    return await asyncio.to_thread(lambda: files_of(station.daemon.catalogue.run(run)))


@router.get("/runs/{run}/files/{name}")
async def file(station: Station, _: Reader, run: str, name: str, *, show: bool = False) -> StreamingResponse:
    """Return a file of a run. `show` shows a report within a sandbox, without scripts; others are attachments."""
    found, content = await asyncio.to_thread(lambda: opened(station.daemon.catalogue.run(run), name))
    shown = show and name.startswith("report.") and found.suffix == ".html"
    headers = {
        "content-length": str(found.size),
        "content-disposition": f'{"inline" if shown else "attachment"}; filename="{_plain(name)}"',
        "content-security-policy": SHOWN_REPORT if shown else SANDBOX,
        **({"x-frame-options": "SAMEORIGIN"} if shown else {}),
    }
    return StreamingResponse(_chunks(content, found.size), media_type=found.media_type, headers=headers)


def _plain(name: str) -> str:
    return "".join(letter if letter.isascii() and (letter.isalnum() or letter in "._-") else "_" for letter in name)


def _chunks(content: BinaryIO, size: int) -> Iterator[bytes]:
    """Yield `size` bytes, however the file changes meanwhile."""
    with content:
        while size > 0 and (chunk := content.read(min(CHUNK_BYTES, size))):
            size -= len(chunk)
            yield chunk


@router.post("/runs/{run}/report", status_code=status.HTTP_202_ACCEPTED)
async def write_report(
    station: Station, person: Operator, run: str, form: Literal["html", "pdf", "csv", "json"] = "pdf",
    lang: Literal["en", "zh"] = "en",
) -> Job:  # fmt: skip
    """Write the report of a run in a form and a language; return the job, whose result names the file."""
    found = _ended(station, run)
    _expect_not_approved(station, run)
    station.audit.note(person, "write report", run, form=form, lang=lang)
    id_ = report_id(run, form, lang)
    return station.daemon.jobs.ask(id_, "report", run, person.name, report, found.path, form, lang)


def _expect_not_approved(station: Services, run: str) -> None:
    """Raise InputError if a run is approved, or about to be: another report beside its own could be mistaken for it."""
    sign_off = station.daemon.sign_off
    approved = sign_off.approval(run)
    if approved is not None:
        raise InputError(
            f"{run}: is approved as {approved.report}; no other report is written beside the approved one. An engineer "
            "can issue it again"
        )
    if sign_off.is_writing(run):
        raise InputError(f"{run}: its approval is being written; look again in a minute")


def report_id(run: str, form: str, lang: str) -> str:
    """Return the id of the job that writes a report."""
    return f"report-{form}-{lang}-{run}"


@router.post("/runs/{run}/reduction", status_code=status.HTTP_202_ACCEPTED)
async def reduce_again(station: Station, person: Operator, run: str) -> Job:
    """Reduce a run again from its raw counts, and compare with its results; nothing is overwritten."""
    found = _ended(station, run)
    station.audit.note(person, "reduce again", run)
    return station.daemon.jobs.ask(reduction_id(run), "reduction", run, person.name, reduction, found.path)


def reduction_id(run: str) -> str:
    """Return the id of the job that reduces a run."""
    return f"reduction-{run}"


def _ended(station: Services, run: str) -> RunSummary:
    found = station.daemon.catalogue.run(run)
    if found.state == "running":
        raise InputError(f"run '{run}' is in progress; wait for its end")
    return found


@router.get("/runs/{run}/resumption")
async def resumption(station: Station, _: Reader, run: str) -> ResumptionView:
    """Return what a resumption of an interrupted run would do, or why it is not possible."""
    return await resumption_view(station, run)


async def resumption_view(station: Services, run: str) -> ResumptionView:
    """Return what a resumption would do; the run is examined in a worker process."""
    found = station.daemon.catalogue.run(run)
    last = await asyncio.to_thread(station.daemon.resuming.last, found)
    under_way = await asyncio.to_thread(station.daemon.resuming.is_under_way, found)
    possible, lines = await station.daemon.workers.call(resumption_of, found.path)
    messages = last.messages if last is not None else ""
    return ResumptionView(possible=possible and not under_way, lines=lines, messages=messages, under_way=under_way)


@router.post("/runs/{run}/resumption", status_code=status.HTTP_202_ACCEPTED)
async def resume(station: Station, person: Operator, run: str) -> ResumptionView:
    """Resume an interrupted run; the process of the run goes on when the station ends."""
    found = station.daemon.catalogue.run(run)
    possible, lines = await station.daemon.workers.call(resumption_of, found.path)
    if not possible:
        raise InputError(*lines)
    station.audit.note(person, "resume interrupted", run)
    await station.daemon.resuming.resume(found)
    return ResumptionView(possible=False, lines=lines, under_way=True)
