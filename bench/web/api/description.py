"""Description of the API, as OpenAPI."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, FastAPI, Request
from fastapi.routing import APIRoute

from bench.web.access import Reader, Scope, routes_of, scope_of
from bench.web.cookies import COOKIE

router = APIRouter(prefix="/api/v1", tags=["description"])
_SCHEMES = {
    "token": {"type": "http", "scheme": "bearer", "description": "token of a program"},
    "session": {"type": "apiKey", "in": "cookie", "name": COOKIE, "description": "session of a browser"},
}
_REFUSALS = {
    "401": "the sender is unknown", "403": "the sender may not do this", "409": "not in the present state",
    "429": "too many requests", "503": "the station cannot do this at the moment",
}  # fmt: skip


@router.get("/openapi.json")
async def openapi(request: Request, _: Reader) -> dict[str, Any]:
    """Return the description of the API."""
    return described(request.app)


def described(app: FastAPI) -> dict[str, Any]:
    """Return the OpenAPI description of an application, with the scope that each operation needs."""
    found = app.openapi()
    found.setdefault("components", {})["securitySchemes"] = _SCHEMES
    for route in routes_of(app.routes):
        if isinstance(route, APIRoute) and route.path in found["paths"]:
            for method, operation in found["paths"][route.path].items():
                if method.upper() in (route.methods or ()):
                    _complete(operation, scope_of(route))
    return found


def _complete(operation: dict[str, Any], scope: Scope | None) -> None:
    operation["x-scope"] = scope
    operation["security"] = [] if scope is Scope.OPEN else [{name: []} for name in _SCHEMES]
    for status, why in _REFUSALS.items():
        operation["responses"].setdefault(status, {"description": why})
