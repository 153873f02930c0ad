"""People: log in and out, users, tokens and the audit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from fastapi import APIRouter, HTTPException, Query, Request, Response, status
from pydantic import BaseModel, Field

from bench.station.queue.items import Short
from bench.web import entrance
from bench.web.access import OPEN, Admin, Person, Reader, Scope
from bench.web.services import AnySite

After = Annotated[int, Query(ge=0, lt=2**53)]
Limit = Annotated[int, Query(ge=1, le=1000)]
router = APIRouter(prefix="/api/v1", tags=["people"])


class Me(BaseModel):
    """Sender of the request."""

    name: str
    scopes: list[str]

    @classmethod
    def of(cls, person: Person) -> Me:
        """Return the view of a person."""
        return cls(name=person.name, scopes=sorted(person.scopes))


class Credentials(BaseModel):
    """Name and password."""

    name: Short
    password: str = Field(max_length=1000)


class Code(BaseModel):
    """Code that `bench serve` printed."""

    code: str = Field(max_length=20)


class NewUser(BaseModel):
    """User with a role: viewer, operator, engineer or admin."""

    role: str = Field(max_length=64)
    password: str = Field(max_length=1000)


class User(BaseModel):
    """User of the station."""

    name: str
    role: str


class NewToken(BaseModel):
    """Token for a program; it may do no more than its owner."""

    label: Short
    scopes: set[Scope]
    days: int = Field(90, ge=1, le=3650)


class Secret(BaseModel):
    """Secret of a new token; it is shown once."""

    token: str


class Verified(BaseModel):
    """Result of a check of the audit."""

    first_wrong: int | None = Field(description="number of the first wrong or missing entry; null for none")


@router.get("/me")
async def me(person: Reader) -> Me:
    """Return who sends this request."""
    return Me.of(person)


@router.post("/login", dependencies=[OPEN])
async def log_in(station: AnySite, credentials: Credentials, request: Request, response: Response) -> Me:
    """Begin a session with name and password; ends the one that the browser had."""
    return Me.of(await entrance.log_in(station, request, response, credentials.name, credentials.password))


@router.post("/login/code", dependencies=[OPEN])
async def log_in_by_code(station: AnySite, code: Code, request: Request, response: Response) -> Me:
    """Begin the first session with the code in the terminal of `bench serve`; from this computer only."""
    return Me.of(entrance.log_in_by_code(station, request, response, code.code))


@router.post("/logout", status_code=status.HTTP_204_NO_CONTENT)
async def log_out(
    station: AnySite, person: Reader, request: Request, response: Response, *, everywhere: bool = False
) -> None:
    """End the session, or all sessions of this person."""
    entrance.log_out(station, request, response, person, everywhere=everywhere)


@router.get("/users")
async def users(station: AnySite, _: Admin) -> list[User]:
    """Return all users."""
    return [User(name=name, role=role) for name, role in station.identity.users()]


@router.put("/users/{name}", status_code=status.HTTP_204_NO_CONTENT)
async def set_user(station: AnySite, person: Admin, name: str, user: NewUser) -> None:
    """Create a user, or change role and password; ends the sessions, and tokens that may do more than the role."""
    before = station.identity.role(name)
    with station.audit.noted(person, "set user", name, before=before, after=user.role):
        station.identity.set_user(name, user.role, user.password)


@router.delete("/users/{name}", status_code=status.HTTP_204_NO_CONTENT)
async def remove_user(station: AnySite, person: Admin, name: str) -> None:
    """Remove a user with all sessions and tokens."""
    with station.audit.noted(person, "remove user", name, before=station.identity.role(name)):
        station.identity.remove_user(name)


@router.get("/tokens")
async def tokens(station: AnySite, _: Admin) -> list[Mapping[str, Any]]:
    """Return all tokens without their secrets."""
    return list(station.identity.tokens())


@router.post("/tokens", status_code=status.HTTP_201_CREATED)
async def new_token(station: AnySite, person: Reader, wanted: NewToken) -> Secret:
    """Make a token for a program."""
    if not wanted.scopes <= person.scopes:
        raise HTTPException(403, "a token may do no more than its owner")
    if person.how == "token" and person.is_user:
        raise HTTPException(403, "log in to make a token; one that has leaked must not make others")
    with station.audit.noted(person, "new token", wanted.label, after=sorted(wanted.scopes)):
        secret = station.identity.new_token(person, wanted.label, wanted.scopes, wanted.days)
    return Secret(token=secret)


@router.delete("/tokens/{id_}", status_code=status.HTTP_204_NO_CONTENT)
async def revoke(station: AnySite, person: Admin, id_: str) -> None:
    """Revoke a token."""
    with station.audit.noted(person, "revoke token", id_):
        station.identity.revoke(id_)


@router.get("/audit")
async def audit(station: AnySite, _: Admin, after: After = 0, limit: Limit = 500) -> list[Mapping[str, Any]]:
    """Return entries of the audit, oldest first."""
    return list(station.audit.entries(after, limit))


@router.get("/audit/verify")
async def verify(station: AnySite, _: Admin) -> Verified:
    """Check that no entry of the audit was changed, moved or removed."""
    return Verified(first_wrong=station.audit.first_wrong())
