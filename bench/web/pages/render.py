"""Rendering of a page: template, language, theme, and the frame that all pages have."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import lru_cache
from typing import Any
from zoneinfo import ZoneInfo

from fastapi import Request
from fastapi.responses import HTMLResponse
from jinja2 import Environment

from bench.clock import wall_utc
from bench.figures.languages import ENGLISH, LANGUAGES, language
from bench.figures.sayings import plain, said
from bench.figures.templates import Compiled, environment_of
from bench.web.access import Person, Scope
from bench.web.open_alerts import Line, opened
from bench.web.pages.files import static
from bench.web.services import site_of

LANGUAGE, THEME = "bench_language", "bench_theme"
THEMES = ("light", "dark")
TEMPLATES_OF, COMPILED = "bench.web", Compiled()


def page(request: Request, template: str, *, status: int = 200, place: str = "", **values: Any) -> HTMLResponse:
    """Return a page in the language of its reader; `place` is the path of its entry in the navigation."""
    with language(language_of(request)):
        return HTMLResponse(rendered(template, **_frame(request), place=place, **values), status)


def rendered(template: str, **values: Any) -> str:
    """Return a template, or a part of a page, in the current language."""
    return environment().get_template(template).render(**values)


def language_of(request: Request) -> str:
    """Return the language that the reader has chosen, else the first one of the browser that there is."""
    if (chosen := request.cookies.get(LANGUAGE)) in LANGUAGES:
        return str(chosen)
    accepted = [each.strip()[:2].lower() for each in request.headers.get("accept-language", "").split(",")]
    return next((each for each in accepted if each in LANGUAGES), ENGLISH)


def person_of(request: Request) -> Person | None:
    """Return who sends a request; None if unknown, also where a guard has refused it."""
    found: Person | None = getattr(request.state, "person", None)
    return found


async def form_of(request: Request) -> dict[str, str]:
    """Return the fields of a form that are text."""
    return {name: value for name, value in (await request.form()).items() if isinstance(value, str)}


def with_prefix(fields: Mapping[str, str], prefix: str) -> dict[str, str]:
    """Return the fields whose names begin with a prefix, by the rest of their names."""
    return {name.removeprefix(prefix): value.strip() for name, value in fields.items() if name.startswith(prefix)}


def digest(*texts: str) -> str:
    """Return a digest of texts for the id of an element: the script of the pages finds it by selectors."""
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()[:16]


def may(person: Person | None, scope: str) -> bool:
    """Return True if a person may do what needs a scope."""
    return person is not None and Scope(scope) in person.scopes


def _frame(request: Request) -> dict[str, Any]:
    site = site_of(request)
    theme, zone, is_known = request.cookies.get(THEME, ""), site.zone, person_of(request) is not None
    return {
        "request": request,
        "language": language_of(request),
        "theme": theme if theme in THEMES else "",
        "person": person_of(request),
        "station_title": site.title,
        "banner": site.banner,
        "troubles": site.problems() if is_known else [],
        "open_alerts": opened(site.alerts) if is_known else Line(),
        "watches_alerts": any(each.path == "/alerts" for each in site.places),
        "places": site.places,
        "zone": zone,
        "now": wall_utc().astimezone(ZoneInfo(zone)),
    }


@lru_cache(maxsize=1)
def environment() -> Environment:
    """Environment of all templates. `tr` and `said` translate, `static` is the address of a file."""
    return environment_of(
        TEMPLATES_OF, COMPILED, static=static, may=may, said=said, plain=plain, zone_of=ZoneInfo, digest=digest
    )
