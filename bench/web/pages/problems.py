"""Errors: a page in words for a browser, JSON for a program."""

from __future__ import annotations

from urllib.parse import quote

from fastapi import FastAPI, Request
from fastapi.exception_handlers import http_exception_handler
from fastapi.responses import RedirectResponse, Response
from starlette.exceptions import HTTPException

from bench.web.pages.render import page, person_of

TITLES = {
    401: "Log in first",
    403: "You may not do this",
    404: "There is no such page",
    409: "It is not possible at the moment",
    422: "The request is not valid",
    429: "Too many attempts",
    503: "The station cannot do this at the moment",
}


def wants_page(request: Request) -> bool:
    """Return True if a person in front of a browser waits for the answer."""
    return "text/html" in request.headers.get("accept", "") and not request.url.path.startswith("/api/")


def problem_page(request: Request, status: int, detail: str) -> Response:
    """Return the page of a problem."""
    title = TITLES.get(status, "Something went wrong")
    return page(request, "problem.html.j2", status=status, title=title, detail=detail)


def add_to(app: FastAPI) -> None:
    """Let an application answer a browser with pages where it refuses a request."""

    async def refused(request: Request, problem: Exception) -> Response:
        assert isinstance(problem, HTTPException)  # noqa: S101  it is registered for no other
        if not wants_page(request):
            return await http_exception_handler(request, problem)
        if problem.status_code == 401 and person_of(request) is None and request.method == "GET":
            return RedirectResponse(f"/login?then={quote(request.url.path)}", 303)
        detail = "" if problem.status_code == 404 and problem.detail == "Not Found" else str(problem.detail)
        return problem_page(request, problem.status_code, detail)

    app.add_exception_handler(HTTPException, refused)
