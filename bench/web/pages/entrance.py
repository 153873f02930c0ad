"""Entrance: log in and out, and the choice of language and theme."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Form, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response

from bench.errors import InputError
from bench.figures.languages import LANGUAGES
from bench.web import entrance
from bench.web.access import OPEN
from bench.web.guards import is_this_computer
from bench.web.pages.render import LANGUAGE, THEME, THEMES, page, person_of
from bench.web.patience import TooSoonError
from bench.web.services import AnySite, Site

router = APIRouter(include_in_schema=False, dependencies=[OPEN])
A_YEAR_S = 365 * 24 * 3600
Text = Annotated[str, Form(max_length=1000)]


@router.get("/login")
async def log_in_page(request: Request, station: AnySite, then: str = "/") -> Response:
    """Return the page to log in."""
    if person_of(request) is not None:
        return _to(then)
    return _entrance(request, station, then)


@router.post("/login")
async def log_in(
    request: Request, station: AnySite, name: Text = "", password: Text = "", code: Text = "", then: Text = "/"
) -> Response:
    """Begin a session with name and password, or on this computer with the code of the first start."""
    answer = _to(then)
    try:
        if code:
            entrance.log_in_by_code(station, request, answer, code)
        else:
            await entrance.log_in(station, request, answer, name, password)
    except TooSoonError as problem:
        return _entrance(request, station, then, problem=str(problem), status=429)
    except InputError as problem:
        return _entrance(request, station, then, problem=str(problem), status=401)
    return answer


@router.post("/logout")
async def log_out(request: Request, station: AnySite) -> Response:
    """End the session."""
    answer = _to("/login")
    if (person := person_of(request)) is not None:
        entrance.log_out(station, request, answer, person, everywhere=False)
    return answer


@router.post("/appearance")
async def appearance(request: Request, language: Text = "", theme: Text = "", then: Text = "/") -> Response:
    """Choose language or theme of this browser; an empty theme follows the system."""
    answer = _to(then)
    form = await request.form()
    if language in LANGUAGES:
        answer.set_cookie(LANGUAGE, language, max_age=A_YEAR_S, samesite="strict", path="/")
    if "theme" in form:
        chosen = theme if theme in THEMES else ""
        answer.set_cookie(THEME, chosen, max_age=A_YEAR_S, samesite="strict", path="/")
    return answer


def _entrance(request: Request, station: Site, then: str, *, problem: str = "", status: int = 200) -> HTMLResponse:
    return page(
        request, "login.html.j2", status=status, then=_own(then), problem=problem,
        has_users=station.identity.has_users(), is_here=is_this_computer(request.scope),
    )  # fmt: skip


def _own(path: str) -> str:
    """Return a path of this station; "/" for everything else."""
    is_own = path.startswith("/") and not path.startswith(("//", "/\\")) and path.isprintable()
    return path if is_own else "/"


def _to(path: str) -> RedirectResponse:
    return RedirectResponse(_own(path), 303)
