"""People: log in and out, users, tokens and the audit."""

from __future__ import annotations

import getpass
from collections.abc import Mapping
from typing import Annotated, Any

from fastapi import APIRouter, HTTPException, Query, Request, Response, status
from pydantic import BaseModel, Field

from bench.station.items import Short
from bench.web.access import OPEN, Admin, Reader, Scope
from bench.web.guards import COOKIE, is_this_computer
from bench.web.identity import Login
from bench.web.services import Station

After = Annotated[int, Query(ge=0)]
Limit = Annotated[int, Query(ge=1, le=1000)]
router = APIRouter(prefix="/api/v1", tags=["people"])


class Me(BaseModel):
    """Sender of the request."""

    name: str
    scopes: list[str]


class Credentials(BaseModel):
    """Name and password."""

    name: Short
    password: str = Field(max_length=1000)


class Code(BaseModel):
    """Code that `bench serve` printed."""

    code: str = Field(max_length=20)


class NewUser(BaseModel):
    """User with a role: viewer, operator, engineer or admin."""

    role: str
    password: str = Field(max_length=1000)


class User(BaseModel):
    """User of the station."""

    name: str
    role: str


class NewToken(BaseModel):
    """Token for a program; it may do no more than its owner."""

    label: Short
    scopes: list[Scope]
    days: int = Field(90, ge=1, le=3650)


class Secret(BaseModel):
    """Secret of a new token; it is shown once."""

    token: str


@router.get("/me")
async def me(person: Reader) -> Me:
    """Return who sends this request."""
    return Me(name=person.name, scopes=sorted(person.scopes))


@router.post("/login", dependencies=[OPEN])
async def log_in(station: Station, credentials: Credentials, request: Request, response: Response) -> Me:
    """Begin a session with name and password."""
    return _begun(station.identity.log_in(credentials.name, credentials.password), request, response)


@router.post("/login/code", dependencies=[OPEN])
async def log_in_by_code(station: Station, code: Code, request: Request, response: Response) -> Me:
    """Begin the first session with the code in the terminal of `bench serve`; from this computer only."""
    if not is_this_computer(request.scope):
        raise HTTPException(403, "the code is accepted on the computer of the station only")
    return _begun(station.identity.exchange(code.code, getpass.getuser()), request, response)


@router.post("/logout", status_code=status.HTTP_204_NO_CONTENT)
async def log_out(station: Station, _: Reader, request: Request, response: Response) -> None:
    """End the session."""
    station.identity.log_out(request.cookies.get(COOKIE, ""))
    response.delete_cookie(COOKIE)


@router.get("/users")
async def users(station: Station, _: Admin) -> list[User]:
    """Return all users."""
    return [User(name=name, role=role) for name, role in station.identity.users()]


@router.put("/users/{name}", status_code=status.HTTP_204_NO_CONTENT)
async def set_user(station: Station, person: Admin, name: str, user: NewUser) -> None:
    """Create a user, or change role and password; ends all sessions of this user."""
    station.identity.set_user(name, user.role, user.password)
    station.audit.note(person, "set user", name, role=user.role)


@router.delete("/users/{name}", status_code=status.HTTP_204_NO_CONTENT)
async def remove_user(station: Station, person: Admin, name: str) -> None:
    """Remove a user with all sessions and tokens."""
    station.audit.note(person, "remove user", name)
    station.identity.remove_user(name)


@router.get("/tokens")
async def tokens(station: Station, _: Admin) -> list[Mapping[str, Any]]:
    """Return all tokens without their secrets."""
    return list(station.identity.tokens())


@router.post("/tokens", status_code=status.HTTP_201_CREATED)
async def new_token(station: Station, person: Reader, wanted: NewToken) -> Secret:
    """Make a token for a program."""
    if not set(wanted.scopes) <= person.scopes:
        raise HTTPException(403, "a token may do no more than its owner")
    station.audit.note(person, "new token", wanted.label, scopes=sorted(wanted.scopes))
    return Secret(token=station.identity.new_token(person.name, wanted.label, wanted.scopes, wanted.days))


@router.delete("/tokens/{id_}", status_code=status.HTTP_204_NO_CONTENT)
async def revoke(station: Station, person: Admin, id_: str) -> None:
    """Revoke a token."""
    station.audit.note(person, "revoke token", id_)
    station.identity.revoke(id_)


@router.get("/audit")
async def audit(station: Station, _: Admin, after: After = 0, limit: Limit = 500) -> list[Mapping[str, Any]]:
    """Return entries of the audit, oldest first."""
    return list(station.audit.entries(after, limit))


def _begun(login: Login, request: Request, response: Response) -> Me:
    secure = request.url.scheme == "https"
    response.set_cookie(COOKIE, login.secret, httponly=True, samesite="strict", secure=secure, path="/")
    return Me(name=login.person.name, scopes=sorted(login.person.scopes))
