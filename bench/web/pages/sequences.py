"""Sequences and bench files: the list, one of them with versions and releases, the difference of two versions."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response

from bench.app.inputs import digest_of
from bench.errors import BenchError, InputError, StaleError, StoreError
from bench.figures.times_and_sizes import duration
from bench.station.prepare.differences import difference_of
from bench.station.prepare.drafts import DraftCheck, Examined, FindingView, bench_texts
from bench.station.prepare.releases import Kind, Release
from bench.station.prepare.sequences import SequenceView, purpose_of
from bench.station.prepare.uses import chosen, suits, uses_of
from bench.station.prepare.versions import Version
from bench.store.runs import BENCH_COPY, SEQUENCE_COPY
from bench.web.access import Engineer, Reader
from bench.web.api import sequences as api
from bench.web.pages.render import form_of, page
from bench.web.pages.results_shown import clock, mark, state_in_words
from bench.web.pages.source import difference_lines, source_lines
from bench.web.services import Services, Station

router = APIRouter(include_in_schema=False)
Words: dict[str, Any] = {
    "clock": clock, "mark": mark, "state_in_words": state_in_words, "duration": duration, "source": source_lines,
    "shown": difference_lines,
}  # fmt: skip


class Standing(NamedTuple):
    """How a file stands to its newest release, and all releases, newest first; `lines` is the difference."""

    releases: list[Release]
    lines: list[str]
    digest: str  # of the files; empty if they cannot be released

    @property
    def newest(self) -> Release | None:
        """The newest release."""
        return self.releases[0] if self.releases else None

    @property
    def state(self) -> str:
        """One of `never`, `changed` and `released`."""
        return "never" if not self.releases else "changed" if self.lines else "released"


def standing(station: Services, kind: Kind, name: str, texts: Mapping[str, str], *, complete: bool) -> Standing:
    """Return how texts stand to the newest release; `complete` is False if a file of them could not be read."""
    releases = station.daemon.releases
    found = releases.of(kind, name)
    lines = list(difference_of(name, releases.texts_of(found[0].number), texts, around=3)) if found else []
    return Standing(found, lines, digest_of(texts) if complete else "")


@router.get("/sequences")
async def sequences_page(request: Request, station: Station, _: Reader) -> HTMLResponse:
    """Return the list of sequences and of bench files."""
    daemon = station.daemon
    views = sorted(await asyncio.to_thread(daemon.sequences.all), key=lambda view: not view.own)
    uses = await uses_of(daemon, views)
    rows = [(view, uses[view.name], await _state(station, view), purpose_of(view.head)) for view in views]
    files = {name: daemon.releases.newest("bench", name) for name in daemon.settings.benches}
    return page(
        request, "sequences.html.j2", place="/sequences", rows=rows, bench_files=files,
        titles=daemon.settings.titles, **Words,
    )  # fmt: skip


async def _state(station: Services, view: SequenceView) -> str:
    """Return how a sequence stands to its release, by its text and the texts that it called then."""
    newest = station.daemon.releases.newest("sequence", view.name)
    if newest is None:
        return "never"
    now = await asyncio.to_thread(_texts_now, station, view.name, list(newest.texts))
    return "released" if now == newest.texts else "changed"


def _texts_now(station: Services, name: str, copies: list[str]) -> dict[str, str]:
    """Return the present texts of the files of a release; those that cannot be read are left out."""
    found = {}
    for copy in copies:
        called = copy.rpartition("/")[2].removesuffix(".yaml")
        try:
            found[copy] = station.daemon.texts.text(name if copy == SEQUENCE_COPY else called).text
        except InputError:
            continue
    return found


@router.get("/sequences/{name}")
async def sequence_page(
    request: Request, station: Station, _: Reader, name: str, bench: str = "", preset: str = ""
) -> HTMLResponse:
    """Return the page of a sequence, checked on a bench that is chosen."""
    return await _sequence_page(request, station, name, bench, preset)


async def _sequence_page(
    request: Request, station: Services, name: str, bench: str, preset: str = "", *, problem: str = "",
    comment: str = "", status: int = 200,
) -> HTMLResponse:  # fmt: skip
    daemon = station.daemon
    text = await asyncio.to_thread(daemon.texts.text, name)
    view = await asyncio.to_thread(daemon.sequences.named, name)
    suitable = await asyncio.to_thread(suits, daemon.settings, view)
    bench = bench or chosen(suitable)
    found = await _examined(station, name, bench)
    versions, no_versions = await _versions(station, name)
    texts = found.texts or {SEQUENCE_COPY: text.text}
    use = (await uses_of(daemon, await asyncio.to_thread(daemon.sequences.all)))[name]
    return page(
        request, "sequence.html.j2", place="/sequences", status=status, text=text, view=view, bench=bench,
        preset=preset if preset in {each.name for each in view.presets} else "", suitable=suitable, check=found.check,
        versions=versions, no_versions=no_versions, use=use, problem=problem, comment=comment,
        standing=standing(station, "sequence", name, texts, complete=bool(found.texts)),
        titles=daemon.settings.titles, **Words,
    )  # fmt: skip


async def _examined(station: Services, name: str, bench: str) -> Examined:
    try:
        return await api.examined(station, name, bench)
    except InputError as problem:  # its process has taken too long; names that are wrong have been refused before
        station.daemon.settings.bench_file(bench)
        return Examined(DraftCheck(found=[_finding(each) for each in problem.problems]), {})


def _finding(problem: str) -> FindingView:
    return FindingView(severity="error", rule="input", file="", line=1, column=1, text=problem)


async def _versions(station: Services, name: str) -> tuple[list[Version], str]:
    """Return the versions of a sequence, and why there are none."""
    try:
        return await asyncio.to_thread(station.daemon.texts.versions, name), ""
    except StoreError as problem:
        return [], str(problem)


@router.get("/sequences/{name}/difference")
async def difference_page(
    request: Request, station: Station, person: Reader, name: str, old: str = api.RELEASED, new: str = api.NOW
) -> HTMLResponse:
    """Return the difference of two versions of a sequence."""
    found = await api.difference(station, person, name, old[:64], new[:64])
    versions, _ = await _versions(station, name)
    return page(
        request, "difference.html.j2", place="/sequences", name=name, old=old, new=new, lines=found.lines,
        versions={each.id: each for each in versions},
        releases={f"release-{each.number}": each for each in station.daemon.releases.of("sequence", name)}, **Words,
    )  # fmt: skip


@router.post("/sequences/{name}/release")
async def release_sequence(request: Request, station: Station, person: Engineer, name: str) -> Response:
    """Release a sequence; if it is refused, show its page with the reason."""
    form = await form_of(request)
    bench, comment = form.get("bench", "")[:64], form.get("comment", "")[:200]
    try:
        wanted = api.NewSequenceRelease.model_validate({**form, "bench": bench, "comment": comment})
        await api.release_sequence(station, person, name, wanted)
    except (ValueError, InputError, StaleError) as wrong:
        why = str(wrong) if isinstance(wrong, BenchError) else "say in a few words why it is released"
        return await _sequence_page(request, station, name, bench, problem=why, comment=comment, status=422)
    return RedirectResponse(f"/sequences/{name}?bench={bench}#release", 303)


@router.get("/bench-files/{bench}")
async def bench_page(request: Request, station: Station, _: Reader, bench: str) -> HTMLResponse:
    """Return the page of a bench file."""
    return await _bench_page(request, station, bench)


async def _bench_page(
    request: Request, station: Services, bench: str, *, problem: str = "", comment: str = "", status: int = 200
) -> HTMLResponse:
    file = station.daemon.settings.bench_file(bench)
    texts, wrong = await _bench_texts(station, file)
    return page(
        request, "bench_file.html.j2", place="/sequences", status=status, bench=bench, file=str(file), texts=texts,
        wrong=wrong, problem=problem, comment=comment, title=station.daemon.settings.titles[bench],
        standing=standing(station, "bench", bench, texts, complete=not wrong), **Words,
    )  # fmt: skip


async def _bench_texts(station: Services, file: Path) -> tuple[Mapping[str, str], tuple[str, ...]]:
    """Return the files of a bench by the names of their copies, and what is wrong with them."""
    try:
        return await station.daemon.drafts.call(bench_texts, file), ()
    except InputError as problem:
        try:
            text = await asyncio.to_thread(file.read_text, "utf-8", "replace")
        except OSError:
            text = ""
        return {BENCH_COPY: text}, problem.problems


@router.post("/bench-files/{bench}/release")
async def release_bench(request: Request, station: Station, person: Engineer, bench: str) -> Response:
    """Release a bench file; if it is refused, show its page with the reason."""
    form = await form_of(request)
    comment = form.get("comment", "")[:200]
    try:
        wanted = api.NewBenchRelease.model_validate({**form, "comment": comment})
        await api.release_bench(station, person, bench, wanted)
    except (ValueError, InputError, StaleError) as wrong:
        why = str(wrong) if isinstance(wrong, BenchError) else "say in a few words why it is released"
        return await _bench_page(request, station, bench, problem=why, comment=comment, status=422)
    return RedirectResponse(f"/bench-files/{bench}#release", 303)
