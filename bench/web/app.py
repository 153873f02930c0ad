"""The application: routes, guards and the words of its errors."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import version
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.types import ASGIApp

from bench.errors import BenchError, InputError, InUseError
from bench.station.log import Log
from bench.station.queue import StaleError
from bench.web.access import expect_scopes
from bench.web.api import alerts, health, people, queue, runs, station
from bench.web.guards import Guards
from bench.web.identity import TooSoonError
from bench.web.metrics import Metrics
from bench.web.observed import Observed
from bench.web.services import Services

LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})
_STATUS: tuple[tuple[type[BenchError], int], ...] = ((StaleError, 409), (InUseError, 409), (InputError, 422))


def make_app(services: Services, hosts: Iterable[str] = (), *, secure: bool = False, log: Log | None = None) -> ASGIApp:
    """Return the application of a station, for requests to loopback addresses and `hosts`.

    `secure` is True if it is reached by TLS, and requests are written to `log`. Raises RuntimeError if a route lacks a
    scope.
    """
    app = FastAPI(
        title="Inertial test bench: station", version=version("inertial-test-bench"), docs_url=None, redoc_url=None,
        openapi_url=None,
    )  # fmt: skip
    app.state.services = services
    app.state.metrics = Metrics(services.daemon)
    for each in (station, queue, runs, people, alerts, health):
        app.include_router(each.router)
    app.add_exception_handler(BenchError, _in_our_words)
    app.add_exception_handler(RequestValidationError, _not_valid)
    expect_scopes(app)
    guarded = Guards(app, services.identity, LOOPBACK | frozenset(hosts), secure=secure)
    return Observed(guarded, app.state.metrics, log)


async def _in_our_words(_: Request, problem: Exception) -> JSONResponse:
    code = next((code for kind, code in _STATUS if isinstance(problem, kind)), 503)
    headers = {"retry-after": f"{problem.wait_s:.0f}"} if isinstance(problem, TooSoonError) else None
    return JSONResponse({"detail": str(problem)}, 429 if headers else code, headers)


async def _not_valid(_: Request, problem: Exception) -> JSONResponse:
    assert isinstance(problem, RequestValidationError)  # noqa: S101  it is registered for no other
    found: list[Any] = [
        f"{'.'.join(map(str, each['loc'][1:])) or 'request'}: {each['msg']}" for each in problem.errors()
    ]
    return JSONResponse({"detail": "; ".join(found)}, 422)
