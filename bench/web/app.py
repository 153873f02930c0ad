"""The application: routes, guards and the words of its errors."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import version
from math import ceil
from typing import Any

from fastapi import APIRouter, FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from starlette.types import ASGIApp

from bench.client.address import LOOPBACK
from bench.errors import BenchError, InputError, InUseError, StaleError
from bench.station.leases import LeasedError
from bench.station.log import Log
from bench.web.access import expect_scopes
from bench.web.api import (
    alerts,
    description,
    health,
    instruments,
    leases,
    manual,
    people,
    preparing,
    queue,
    releases,
    results,
    runs,
    sequences,
    series,
    signoff,
    station,
)
from bench.web.guards import Guards
from bench.web.metrics import Metrics
from bench.web.observed import Observed
from bench.web.pages import problems
from bench.web.pages.routers import ROUTERS
from bench.web.patience import TooSoonError
from bench.web.services import Services, Site

_STATUS: tuple[tuple[type[BenchError], int], ...] = (
    (StaleError, 409), (LeasedError, 409), (InUseError, 409), (InputError, 422),
)  # fmt: skip


def make_app(services: Services, hosts: Iterable[str] = (), *, secure: bool = False, log: Log | None = None) -> ASGIApp:
    """Return the application of a station, for requests to loopback addresses and `hosts`.

    `secure` is True if it is reached by TLS, and requests are written to `log`. Raises RuntimeError if a route lacks a
    scope.
    """
    routes = [each.router for each in (
        station, queue, preparing, sequences, results, runs, series, signoff, releases, leases, people, alerts, health,
        instruments, manual, description,
    )]  # fmt: skip
    app = application("Inertial test bench: station", services, [*routes, *ROUTERS])
    app.state.metrics = Metrics(services.daemon)
    return guarded(app, services, hosts, secure=secure, metrics=app.state.metrics, log=log)


def application(title: str, site: Site, routers: Iterable[APIRouter]) -> FastAPI:
    """Return an application with the words of its errors. Raises RuntimeError if a route lacks a scope."""
    app = FastAPI(
        title=title, version=version("inertial-test-bench"), docs_url=None, redoc_url=None, openapi_url=None
    )  # fmt: skip
    app.state.services = site
    for router in routers:
        app.include_router(router)
    problems.add_to(app)
    app.add_exception_handler(BenchError, _in_our_words)
    app.add_exception_handler(RequestValidationError, _not_valid)
    expect_scopes(app)
    return app


def guarded(
    app: ASGIApp, site: Site, hosts: Iterable[str], *, secure: bool, metrics: Metrics | None = None,
    log: Log | None = None,
) -> ASGIApp:  # fmt: skip
    """Return an application behind its guards, for requests to loopback addresses and `hosts`."""
    return Observed(Guards(app, site.identity, frozenset({*LOOPBACK, *hosts}), secure=secure), metrics, log)


async def _in_our_words(request: Request, problem: Exception) -> Response:
    code = next((code for kind, code in _STATUS if isinstance(problem, kind)), 503)
    if problems.wants_page(request):
        return problems.problem_page(request, 429 if isinstance(problem, TooSoonError) else code, str(problem))
    headers = {"retry-after": f"{ceil(problem.wait_s)}"} if isinstance(problem, TooSoonError) else None
    return JSONResponse({"detail": str(problem)}, 429 if headers else code, headers)


async def _not_valid(request: Request, problem: Exception) -> Response:
    assert isinstance(problem, RequestValidationError)  # noqa: S101  it is registered for no other
    found: list[Any] = [
        f"{'.'.join(map(str, each['loc'][1:])) or 'request'}: {each['msg']}" for each in problem.errors()
    ]
    if problems.wants_page(request):
        return problems.problem_page(request, 422, "; ".join(found))
    return JSONResponse({"detail": "; ".join(found)}, 422)
