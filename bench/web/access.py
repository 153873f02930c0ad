"""Access: who sends a request, and what that person or program may do. A route without a scope does not exist."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from enum import StrEnum
from typing import Annotated, Any, NamedTuple

from fastapi import Depends, FastAPI, HTTPException, Request
from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute
from starlette.routing import BaseRoute


class Scope(StrEnum):
    """What a person may do."""

    OPEN = "open"  # everybody: the page to log in, and its files
    READ = "read"  # see the station and its runs
    STOP = "stop"  # pause, stop and abort a run
    RUN = "run"  # submit, order and cancel items; resume, skip, repeat and answer
    APPROVE = "approve"  # sign a run off
    ENGINEER = "engineer"  # release sequences and bench files, control instruments by hand, let a stopped bench go on
    CLEAR = "safe:clear"  # acknowledge a latch
    ADMIN = "admin"  # users, tokens and the audit


ROLES = {
    "viewer": frozenset({Scope.READ}),
    "operator": frozenset({Scope.READ, Scope.STOP, Scope.RUN}),
    "engineer": frozenset({Scope.READ, Scope.STOP, Scope.RUN, Scope.APPROVE, Scope.ENGINEER, Scope.CLEAR}),
    "admin": frozenset({Scope.READ, Scope.ADMIN}),
}
EVERYTHING = frozenset(Scope)


class Person(NamedTuple):
    """Sender of a request: name, scopes, and how it was identified: by a session or a token, with its identifier.

    `is_user` is False for who works at the computer of the station: by its first token or the code in its terminal.
    """

    name: str
    scopes: frozenset[Scope]
    how: str
    id: str = ""
    is_user: bool = True
    address: str = ""


class _Needs:
    """Dependency that admits only senders with a scope."""

    def __init__(self, scope: Scope) -> None:
        self.scope = scope

    async def __call__(self, request: Request) -> Person:
        person: Person | None = request.state.person
        if person is None:
            raise HTTPException(401, "log in first, or send a token")
        if self.scope not in person.scopes:
            raise HTTPException(403, f"{person.name} may not do this; it needs the scope '{self.scope}'")
        return person


def needs(scope: Scope) -> Any:
    """Return the dependency of a route that needs a scope; its value is the sender."""
    return Depends(_Needs(scope))


def open_to_all() -> None:
    """Dependency of a route that everybody may use."""


Reader = Annotated[Person, needs(Scope.READ)]
Stopper = Annotated[Person, needs(Scope.STOP)]
Operator = Annotated[Person, needs(Scope.RUN)]
Engineer = Annotated[Person, needs(Scope.ENGINEER)]
Clearer = Annotated[Person, needs(Scope.CLEAR)]
Approver = Annotated[Person, needs(Scope.APPROVE)]
Admin = Annotated[Person, needs(Scope.ADMIN)]
OPEN = Depends(open_to_all)


def scope_of(route: APIRoute) -> Scope | None:
    """Return the scope that a route needs; None if it declares none."""
    found = [call for call in _calls(route.dependant) if isinstance(call, _Needs) or call is open_to_all]
    if not found:
        return None
    return next((call.scope for call in found if isinstance(call, _Needs)), Scope.OPEN)


def routes_of(routes: Iterable[BaseRoute]) -> Iterator[BaseRoute]:
    """Yield the routes of an application, those of its included routers in their place."""
    for route in routes:
        included = getattr(route, "original_router", None)
        if included is None:
            yield route
        else:
            yield from routes_of(included.routes)


def expect_scopes(app: FastAPI) -> None:
    """Raise RuntimeError if a route of the application declares no scope, or if there is none."""
    routes = list(routes_of(app.routes))
    if lacking := [getattr(route, "path", repr(route)) for route in routes if _lacks_scope(route)]:
        raise RuntimeError(f"routes without a scope: {', '.join(lacking)}")
    if not routes:
        raise RuntimeError("there are no routes")


def _lacks_scope(route: BaseRoute) -> bool:
    return not isinstance(route, APIRoute) or scope_of(route) is None


def _calls(dependant: Dependant) -> Iterator[Callable[..., Any] | None]:
    for each in dependant.dependencies:
        yield each.call
        yield from _calls(each)
