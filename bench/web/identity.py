"""Users, tokens and sessions of a station. Only hashes of secrets are kept."""

from __future__ import annotations

import asyncio
import hashlib
import secrets
from collections.abc import Iterable
from contextlib import suppress
from datetime import datetime, timedelta
from functools import cache
from typing import Any, NamedTuple

from argon2 import PasswordHasher
from argon2.exceptions import Argon2Error, InvalidHashError

from bench.clock import Stopwatch, wall_utc
from bench.errors import InputError, StoreError
from bench.station.storage.database import Database
from bench.web.access import EVERYTHING, ROLES, Person, Scope
from bench.web.patience import Patience, TooSoonError

SESSION = timedelta(hours=12)
CODE_S = 600.0
LEAST_LETTERS = 10
TOKENS_OF_ONE, LOGINS_AT_ONCE = 100, 4
USES_KEPT_EVERY_S = 60.0
_LETTERS = "ABCDEFGHJKLMNPQRSTUVWXYZ23456789"  # none that looks like another
_TABLES = """
CREATE TABLE IF NOT EXISTS user(name TEXT PRIMARY KEY, role TEXT NOT NULL, password TEXT NOT NULL, made TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS session(hash TEXT PRIMARY KEY, name TEXT NOT NULL, is_user INTEGER NOT NULL,
  scopes TEXT NOT NULL, ends TEXT NOT NULL, used TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS token(hash TEXT PRIMARY KEY, id TEXT NOT NULL, name TEXT NOT NULL, is_user INTEGER NOT NULL,
  label TEXT NOT NULL, scopes TEXT NOT NULL, ends TEXT NOT NULL, used TEXT NOT NULL);
"""


class Login(NamedTuple):
    """New session: the secret for the cookie, and the person."""

    secret: str
    person: Person


class Identity:
    """Users, tokens, sessions, and the code of the first start. Raises StoreError where the disk fails.

    A session ends after SESSION, and sooner if it is not used for `idle`.
    """

    def __init__(self, database: Database, idle: timedelta | None = None, patience: Patience | None = None) -> None:
        self._database, self._hasher, self._idle = database, PasswordHasher(), idle
        self._patience = patience or Patience()
        self._at_work, self._logins = asyncio.Semaphore(1), 0
        self._uses: dict[str, datetime] = {}  # by hash; those of tokens and sessions that are not yet kept
        self._kept = Stopwatch()
        self._code, self._code_age = "", Stopwatch()
        with database.transaction() as tables:
            for statement in _TABLES.split(";"):
                tables.execute(statement)

    def has_users(self) -> bool:
        """Return True if somebody can log in with a password."""
        return bool(self._database.rows("SELECT 1 FROM user LIMIT 1"))

    def new_code(self) -> str:
        """Return a code for the terminal, valid once and for 10 minutes, from this computer only."""
        self._code = "".join(secrets.choice(_LETTERS) for _ in range(8))
        self._code_age = Stopwatch()
        return f"{self._code[:4]}-{self._code[4:]}"

    def exchange(self, code: str, name: str, address: str = "") -> Login:
        """Exchange the code for a session with all scopes. Raises InputError, and TooSoonError."""
        self._patience.expect("", address)
        given = code.upper().replace("-", "").strip()
        valid = self._code and self._code_age.elapsed_s() <= CODE_S
        if not valid or not secrets.compare_digest(given.encode(), self._code.encode()):
            self._patience.failed("", address)
            raise InputError("the code is not valid; 'bench serve' prints a new one when it starts")
        self._code = ""
        return self._begin(name, EVERYTHING, is_user=False)

    def set_user(self, name: str, role: str, password: str) -> None:
        """Create a user, or change role and password; ends the sessions of this user. Raises InputError.

        Tokens that may do more than the new role are revoked.
        """
        if role not in ROLES:
            raise InputError(f"there is no role '{role[:64]}'; there are {', '.join(ROLES)}")
        if not name.strip() or not name.isprintable() or len(name) > 64:
            raise InputError("a name has 1 to 64 printable characters")
        if len(password) < LEAST_LETTERS:
            raise InputError(f"a password has at least {LEAST_LETTERS} characters")
        row = (name, role, self._hasher.hash(password), wall_utc().isoformat())
        with self._database.transaction() as tables:
            tables.execute("REPLACE INTO user VALUES (?, ?, ?, ?)", row)
            tables.execute("DELETE FROM session WHERE name = ? AND is_user", (name,))
            tokens = tables.execute("SELECT id, scopes FROM token WHERE name = ? AND is_user", (name,)).fetchall()
            for token in tokens:
                if not _scopes(token["scopes"]) <= ROLES[role]:
                    tables.execute("DELETE FROM token WHERE id = ?", (token["id"],))

    def remove_user(self, name: str) -> None:
        """Remove a user with all sessions and tokens. Raises InputError if there is none."""
        if self.role(name) is None:
            raise InputError(f"there is no user '{name[:64]}'")
        with self._database.transaction() as tables:
            tables.execute("DELETE FROM user WHERE name = ?", (name,))
            tables.execute("DELETE FROM session WHERE name = ? AND is_user", (name,))
            tables.execute("DELETE FROM token WHERE name = ? AND is_user", (name,))

    def role(self, name: str) -> str | None:
        """Return the role of a user; None if there is no such user."""
        rows = self._database.rows("SELECT role FROM user WHERE name = ?", name)
        return str(rows[0]["role"]) if rows else None

    def users(self) -> list[tuple[str, str]]:
        """Return names and roles."""
        return [(row["name"], row["role"]) for row in self._database.rows("SELECT name, role FROM user ORDER BY name")]

    async def check_password(self, name: str, password: str, address: str = "") -> frozenset[Scope]:
        """Return the scopes of a user. Raises InputError, and TooSoonError after failures.

        One password is checked at a time, apart from the event loop: it takes a tenth of a second of a processor.
        """
        self._patience.expect(name, address)
        if self._logins >= LOGINS_AT_ONCE:
            raise TooSoonError(1.0)
        rows = self._database.rows("SELECT password FROM user WHERE name = ?", name)
        self._logins += 1
        try:
            async with self._at_work:
                kept = rows[0]["password"] if rows else ""
                is_right = await asyncio.to_thread(self._is_right, kept, password)
        finally:
            self._logins -= 1
        role = self.role(name)
        if not is_right or role is None:
            self._patience.failed(name, address)
            raise InputError("name or password is wrong")
        self._patience.succeeded(name, address)
        return ROLES[role]

    def _is_right(self, kept: str, password: str) -> bool:
        other = _of_nobody()  # made with the first login, whatever its name, so that the time says nothing of a name
        try:
            return self._hasher.verify(kept or other, password)
        except (Argon2Error, InvalidHashError):
            return False

    async def log_in(self, name: str, password: str, address: str = "") -> Login:
        """Begin a session. Raises as `check_password` does."""
        return self._begin(name, await self.check_password(name, password, address))

    def log_out(self, secret: str) -> None:
        """End a session."""
        with self._database.transaction() as tables:
            tables.execute("DELETE FROM session WHERE hash = ?", (_hash(secret),))

    def log_out_everywhere(self, person: Person) -> None:
        """End all sessions of a person."""
        with self._database.transaction() as tables:
            tables.execute("DELETE FROM session WHERE name = ? AND is_user = ?", (person.name, person.is_user))

    def of_session(self, secret: str, *, uses: bool = True) -> Person | None:
        """Return the person of a cookie, or None; `uses` is False if the person does nothing now."""
        rows = self._database.rows("SELECT * FROM session WHERE hash = ?", _hash(secret))
        if not rows:
            return None
        used = self._uses.get(rows[0]["hash"]) or datetime.fromisoformat(rows[0]["used"])
        if self._idle is not None and wall_utc() - used > self._idle:
            return None
        return self._person(rows[0], "session", rows[0]["hash"][:8], uses=uses)

    def new_token(self, person: Person, label: str, scopes: Iterable[Scope], days: int) -> str:
        """Return the secret of a new token of a person; it cannot be read again. Raises InputError."""
        mine = self._database.rows("SELECT COUNT(*) FROM token WHERE name = ?", person.name)[0][0]
        if mine >= TOKENS_OF_ONE:
            raise InputError(f"{person.name} has {TOKENS_OF_ONE} tokens; revoke some first")
        secret = f"bench_{secrets.token_urlsafe(32)}"
        ends = wall_utc() + timedelta(days=days)
        id_ = secrets.token_hex(4)
        row = (_hash(secret), id_, person.name, person.is_user, label, _text(scopes), ends.isoformat(), "")
        with self._database.transaction() as tables:
            tables.execute("INSERT INTO token VALUES (?, ?, ?, ?, ?, ?, ?, ?)", row)
        return secret

    def of_token(self, secret: str, *, uses: bool = True) -> Person | None:
        """Return the person or program of a token, or None; `uses` is False if it does nothing now."""
        rows = self._database.rows("SELECT * FROM token WHERE hash = ?", _hash(secret))
        return self._person(rows[0], "token", rows[0]["id"], uses=uses) if rows else None

    def keep_uses(self) -> None:
        """Record when tokens and sessions were used last, at most once a minute."""
        if self._uses and self._kept.elapsed_s() >= USES_KEPT_EVERY_S:
            self._kept = Stopwatch()
            uses = [(used.isoformat(timespec="seconds"), hash_) for hash_, used in self._uses.items()]
            with suppress(StoreError), self._database.transaction() as tables:
                tables.executemany("UPDATE token SET used = ? WHERE hash = ?", uses)
                tables.executemany("UPDATE session SET used = ? WHERE hash = ?", uses)
                self._uses.clear()

    def tokens(self) -> list[dict[str, Any]]:
        """Return all tokens without their secrets."""
        return [dict(row) for row in self._database.rows("SELECT id, name, label, scopes, ends, used FROM token")]

    def revoke(self, id_: str) -> None:
        """Remove a token. Raises InputError if there is none."""
        with self._database.transaction() as tables:
            if not tables.execute("DELETE FROM token WHERE id = ?", (id_,)).rowcount:
                raise InputError(f"there is no token '{id_[:64]}'")

    def _begin(self, name: str, scopes: frozenset[Scope], *, is_user: bool = True) -> Login:
        secret, now = secrets.token_urlsafe(32), wall_utc()
        row = (_hash(secret), name, is_user, _text(scopes), (now + SESSION).isoformat(), now.isoformat())
        with self._database.transaction() as tables:
            tables.execute("DELETE FROM session WHERE ends < ?", (now.isoformat(),))
            tables.execute("INSERT INTO session VALUES (?, ?, ?, ?, ?, ?)", row)
        return Login(secret, Person(name, scopes, "session", row[0][:8], is_user))

    def _person(self, row: Any, how: str, id_: str, *, uses: bool) -> Person | None:
        """Return the owner of a token or session, with the scopes that both have now."""
        now, name, is_user = wall_utc(), row["name"], bool(row["is_user"])
        if datetime.fromisoformat(row["ends"]) < now:
            return None
        if uses:
            self._uses[row["hash"]] = now
        role = self.role(name) if is_user else None
        owned = EVERYTHING if not is_user else ROLES.get(role or "", frozenset())
        return Person(name, _scopes(row["scopes"]) & owned, how, id_, is_user)


@cache
def _of_nobody() -> str:
    return PasswordHasher().hash(secrets.token_hex(16))


def _hash(secret: str) -> str:
    return hashlib.sha256(secret.encode()).hexdigest()


def _text(scopes: Iterable[Scope]) -> str:
    return " ".join(sorted(scopes))


def _scopes(text: str) -> frozenset[Scope]:
    return frozenset(map(Scope, text.split()))
