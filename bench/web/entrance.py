"""Begin and end of sessions, by the API and by pages, with their entries in the audit."""

from __future__ import annotations

import getpass

from fastapi import HTTPException, Request, Response

from bench.client.address import LOOPBACK
from bench.web.access import Person
from bench.web.cookies import forget_session, keep_session, secret_of
from bench.web.guards import address_of, is_this_computer
from bench.web.identity import Login
from bench.web.services import Site


async def log_in(station: Site, request: Request, response: Response, name: str, password: str) -> Person:
    """Begin a session; the browser keeps it instead of the one that it had. Raises InputError, and TooSoonError."""
    login = await station.identity.log_in(name, password, address_of(request.scope))
    return _begun(station, login, request, response)


def log_in_by_code(station: Site, request: Request, response: Response, code: str) -> Person:
    """Begin the first session with the code of the terminal. Raises HTTPException, InputError, and TooSoonError."""
    if not is_this_computer(request.scope) or request.url.hostname not in LOOPBACK:
        raise HTTPException(403, "the code is accepted on the computer of the station only")
    login = station.identity.exchange(code, getpass.getuser(), address_of(request.scope))
    return _begun(station, login, request, response)


def log_out(station: Site, request: Request, response: Response, person: Person, *, everywhere: bool) -> None:
    """End the session, or all sessions of a person."""
    with station.audit.noted(person, "log out", person.name, everywhere=everywhere or None):
        station.identity.log_out(secret_of(request))
        if everywhere:
            station.identity.log_out_everywhere(person)
    forget_session(request, response)


def _begun(station: Site, login: Login, request: Request, response: Response) -> Person:
    person = login.person._replace(address=address_of(request.scope))
    before = secret_of(request)
    with station.audit.noted(person, "log in", person.name):
        if before:
            station.identity.log_out(before)
    keep_session(request, response, login.secret)
    return person
