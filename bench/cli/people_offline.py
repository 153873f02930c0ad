"""Users and tokens in the database of a station that does not run; changes are in its audit."""

from __future__ import annotations

from typing import Any

from bench.errors import InputError
from bench.station.storage.audit import Audit
from bench.station.storage.database import Database
from bench.web.access import EVERYTHING, Person, Scope
from bench.web.identity import Identity


class PeopleOffline:
    """Users and tokens, with the methods of `bench.client.Station`, changed by the owner of the folder."""

    def __init__(self, database: Database, by: str) -> None:
        self._identity, self._audit = Identity(database), Audit(database)
        self._person = Person(by, EVERYTHING, "owner of the folder")

    def users(self) -> list[dict[str, Any]]:
        """Return all users with their roles."""
        return [{"name": name, "role": role} for name, role in self._identity.users()]

    def set_user(self, name: str, role: str, password: str) -> None:
        """Create a user, or change role and password."""
        self._identity.set_user(name, role, password)
        self._audit.note(self._person, "set user", name, role=role)

    def remove_user(self, name: str) -> None:
        """Remove a user with all sessions and tokens."""
        self._audit.note(self._person, "remove user", name)
        self._identity.remove_user(name)

    def tokens(self) -> list[dict[str, Any]]:
        """Return all tokens without their secrets."""
        return self._identity.tokens()

    def new_token(self, label: str, scopes: list[str], days: int = 90) -> str:
        """Return the secret of a new token."""
        try:
            wanted = [Scope(each) for each in scopes]
        except ValueError as problem:
            raise InputError(f"{problem}; there are {', '.join(Scope)}") from None
        self._audit.note(self._person, "new token", label, scopes=sorted(wanted))
        return self._identity.new_token(self._person, label, wanted, days)

    def revoke(self, token: str) -> None:
        """Revoke a token by its id."""
        self._audit.note(self._person, "revoke token", token)
        self._identity.revoke(token)
