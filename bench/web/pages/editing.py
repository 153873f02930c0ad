"""Editor of a sequence: a form that checks and saves; with JavaScript also completion, and a check as one types."""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Sequence
from typing import Any, NamedTuple
from urllib.parse import quote

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, JSONResponse, RedirectResponse, Response
from pydantic import ValidationError

from bench.errors import InputError, StoreError
from bench.figures.languages import language
from bench.figures.times_and_sizes import duration
from bench.station.prepare import differences, texts
from bench.station.prepare.drafts import DraftCheck
from bench.station.prepare.texts import ChangedError, SequenceText
from bench.station.prepare.uses import chosen, suits
from bench.web.access import Engineer, Person
from bench.web.api import sequences as api
from bench.web.guards import CSP
from bench.web.pages.render import form_of, language_of, page, rendered
from bench.web.pages.source import difference_lines
from bench.web.services import Services, Station

router = APIRouter(include_in_schema=False)


class Editing(NamedTuple):
    """What the form of the editor holds: `name` is that of the new sequence if it `is_new`, `of` the one it shows."""

    of: str
    name: str
    is_new: bool
    text: str
    base: str
    bench: str
    message: str = ""

    @classmethod
    def of_form(cls, of: str, form: dict[str, str], *, is_new: bool) -> Editing:
        """Return what a form holds, as long as it may be."""
        name = form.get("name", "").strip()[:64] if is_new else of
        text = form.get("text", "").replace("\r\n", "\n")
        return cls(
            of, name, is_new, text, form.get("base", "")[:64], form.get("bench", "")[:64], form.get("message", "")[:200]
        )

    def draft(self) -> api.Draft:
        """Return the text as a draft. Raises InputError."""
        try:
            return api.Draft(text=self.text, bench=self.bench, beside=self.of if self.is_new else None)
        except ValidationError as wrong:
            raise _in_words(wrong) from None

    def change(self) -> api.NewText:
        """Return the text as a change. Raises InputError."""
        try:
            return api.NewText(text=self.text, base=self.base, message=self.message)
        except ValidationError as wrong:
            raise _in_words(wrong) from None


def _in_words(wrong: ValidationError) -> InputError:
    words = {"message": "say in a few words what has changed, and why"}
    return InputError(*(words.get(str(each["loc"][0]), f"{each['loc'][0]}: {each['msg']}") for each in wrong.errors()))


@router.get("/sequences/{name}/edit")
async def edit(request: Request, station: Station, _: Engineer, name: str, bench: str = "") -> HTMLResponse:
    """Return the editor of a sequence of the laboratory."""
    text = await asyncio.to_thread(station.daemon.texts.text, name)
    if not text.own:
        raise InputError(f"'{name}' is shipped with the program, and so it is not changed here; edit a copy")
    return await _editor(request, station, await _begun(station, text, bench, is_new=False))


@router.get("/sequences/{name}/copy")
async def copy(request: Request, station: Station, _: Engineer, name: str, bench: str = "") -> HTMLResponse:
    """Return the editor of a new sequence, with the text of another one."""
    text = await asyncio.to_thread(station.daemon.texts.text, name)
    return await _editor(request, station, await _begun(station, text, bench, is_new=True))


async def _begun(station: Services, text: SequenceText, bench: str, *, is_new: bool) -> Editing:
    """Return a form that nobody has changed; without a bench for the first one that suits the sequence."""
    if not bench:
        view = await asyncio.to_thread(station.daemon.sequences.named, text.name)
        suitable = await asyncio.to_thread(suits, station.daemon.settings, view)
        bench = chosen(suitable)
    name, base = ("", "") if is_new else (text.name, text.digest)
    return Editing(text.name, name, is_new, text.text, base, bench)


@router.post("/sequences/{name}/edit")
async def save(request: Request, station: Station, person: Engineer, name: str) -> Response:
    """Check or save a sequence; what is refused is shown again with the reason, and nothing of it is lost."""
    form = await form_of(request)
    return await _act(request, station, person, Editing.of_form(name, form, is_new=False), form.get("do", ""))


@router.post("/sequences/{name}/copy")
async def save_copy(request: Request, station: Station, person: Engineer, name: str) -> Response:
    """Check or save a new sequence."""
    form = await form_of(request)
    return await _act(request, station, person, Editing.of_form(name, form, is_new=True), form.get("do", ""))


async def _act(request: Request, station: Services, person: Person, given: Editing, do: str) -> Response:
    if do != "save":
        check, problems = await _checked(station, given, language_of(request))
        return await _editor(request, station, given, check=check, problems=problems)
    try:
        await api.save(station, person, given.name, given.change())
    except ChangedError as changed:
        lines = differences.difference(changed.now.text, texts.as_file(given.text), "saved now", "yours")
        again = given._replace(base=changed.now.digest)
        return await _editor(request, station, again, problems=[str(changed)], difference=lines, status=409)
    except InputError as wrong:
        return await _editor(request, station, given, problems=wrong.problems, status=422)
    except StoreError as wrong:
        return await _editor(request, station, given, problems=[str(wrong)], status=503)
    return RedirectResponse(f"/sequences/{quote(given.name)}?bench={quote(given.bench)}", 303)


async def _checked(station: Services, given: Editing, lang: str) -> tuple[DraftCheck | None, Sequence[str]]:
    """Return the check of a text, or why there is none."""
    try:
        return await api.checked_draft(station, given.name or given.of, given.draft(), lang), ()
    except InputError as wrong:
        return None, wrong.problems


@router.post("/sequences/{name}/check")
async def check(request: Request, station: Station, _: Engineer, name: str) -> JSONResponse:
    """Return the findings of a check at their places, and the part of the page that shows them."""
    form = await form_of(request)
    given = Editing.of_form(name, form, is_new="name" in form)
    found, problems = await _checked(station, given, language_of(request))
    with language(language_of(request)):
        html = rendered("part_checked.html.j2", **_shown(found, problems), duration=duration)
    places = [each.model_dump() for each in (found.found if found is not None else []) if not each.file]
    return JSONResponse({"found": places, "html": html})


def _shown(found: DraftCheck | None, problems: Sequence[str]) -> dict[str, Any]:
    picture = f"data:image/svg+xml,{quote(found.picture)}" if found is not None and found.picture else ""
    return {"check": found, "problems": problems, "picture": picture}


async def _editor(
    request: Request, station: Services, given: Editing, *, check: DraftCheck | None = None,
    problems: Sequence[str] = (), difference: Sequence[str] = (), status: int = 200,
) -> HTMLResponse:  # fmt: skip
    """Return the page of the editor; its styles have the nonce that the policy of this page alone admits."""
    nonce = secrets.token_urlsafe(16)
    answer = page(
        request, "edit.html.j2", place="/sequences", status=status, given=given, nonce=nonce, shown=difference_lines,
        titles=station.daemon.settings.titles, difference=difference, duration=duration, **_shown(check, problems),
    )  # fmt: skip
    answer.headers["content-security-policy"] = CSP.replace("style-src 'self'", f"style-src 'self' 'nonce-{nonce}'")
    return answer
