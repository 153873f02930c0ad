"""Users, tokens and sessions of a station. Only hashes of secrets are kept."""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Iterable
from datetime import datetime, timedelta
from typing import Any, NamedTuple

from argon2 import PasswordHasher
from argon2.exceptions import Argon2Error, InvalidHashError

from bench.clock import Stopwatch, wall_utc
from bench.errors import InputError
from bench.station.database import Database
from bench.web.access import EVERYTHING, ROLES, Person, Scope

SESSION = timedelta(hours=12)
CODE_S = 600.0
LEAST_LETTERS = 10
DELAY_MOST_S = 30.0
_LETTERS = "ABCDEFGHJKLMNPQRSTUVWXYZ23456789"  # none that looks like another
_TABLES = """
CREATE TABLE IF NOT EXISTS user(name TEXT PRIMARY KEY, role TEXT NOT NULL, password TEXT NOT NULL, made TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS session(hash TEXT PRIMARY KEY, name TEXT NOT NULL, scopes TEXT NOT NULL, ends TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS token(hash TEXT PRIMARY KEY, id TEXT NOT NULL, name TEXT NOT NULL, label TEXT NOT NULL,
  scopes TEXT NOT NULL, ends TEXT NOT NULL, used TEXT NOT NULL);
"""


class TooSoonError(InputError):
    """Attempt to log in sooner after failed ones than allowed; `wait_s` is the time to wait."""

    def __init__(self, wait_s: float) -> None:
        self.wait_s = wait_s
        super().__init__(f"too many attempts; try again in {wait_s:.0f} s")


class Login(NamedTuple):
    """New session: the secret for the cookie, and the person."""

    secret: str
    person: Person


class Identity:
    """Users, tokens, sessions, and the code of the first start. Raises StoreError where the disk fails."""

    def __init__(self, database: Database) -> None:
        self._database, self._hasher = database, PasswordHasher()
        self._failed: dict[str, tuple[int, Stopwatch]] = {}
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

    def exchange(self, code: str, name: str) -> Login:
        """Exchange the code for a session with all scopes. Raises InputError, and TooSoonError."""
        self._expect_patience("code")
        given = code.upper().replace("-", "").strip()
        valid = self._code and self._code_age.elapsed_s() <= CODE_S
        if not valid or not secrets.compare_digest(given.encode(), self._code.encode()):
            self._count_failure("code")
            raise InputError("the code is not valid; 'bench serve' prints a new one when it starts")
        self._code = ""
        return self._begin(name, EVERYTHING)

    def set_user(self, name: str, role: str, password: str) -> None:
        """Create a user, or change role and password. Raises InputError."""
        if role not in ROLES:
            raise InputError(f"there is no role '{role}'; there are {', '.join(ROLES)}")
        if not name.strip() or not name.isprintable() or len(name) > 64:
            raise InputError("a name has 1 to 64 printable characters")
        if len(password) < LEAST_LETTERS:
            raise InputError(f"a password has at least {LEAST_LETTERS} characters")
        row = (name, role, self._hasher.hash(password), wall_utc().isoformat())
        with self._database.transaction() as tables:
            tables.execute("REPLACE INTO user VALUES (?, ?, ?, ?)", row)
            tables.execute("DELETE FROM session WHERE name = ?", (name,))

    def remove_user(self, name: str) -> None:
        """Remove a user with all sessions and tokens."""
        with self._database.transaction() as tables:
            for table in ("user", "session", "token"):
                tables.execute(f"DELETE FROM {table} WHERE name = ?", (name,))  # noqa: S608  our own names

    def users(self) -> list[tuple[str, str]]:
        """Return names and roles."""
        return [(row["name"], row["role"]) for row in self._database.rows("SELECT name, role FROM user ORDER BY name")]

    def check_password(self, name: str, password: str) -> frozenset[Scope]:
        """Return the scopes of a user. Raises InputError, and TooSoonError after failures."""
        self._expect_patience(name)
        rows = self._database.rows("SELECT role, password FROM user WHERE name = ?", name)
        try:
            # The time is the same for a name that does not exist.
            self._hasher.verify(rows[0]["password"] if rows else _OF_NOBODY, password)
        except (Argon2Error, InvalidHashError):
            rows = []
        if not rows:
            self._count_failure(name)
            raise InputError("name or password is wrong")
        self._failed.pop(name, None)
        return ROLES[rows[0]["role"]]

    def log_in(self, name: str, password: str) -> Login:
        """Begin a session. Raises as `check_password` does."""
        return self._begin(name, self.check_password(name, password))

    def log_out(self, secret: str) -> None:
        """End a session."""
        with self._database.transaction() as tables:
            tables.execute("DELETE FROM session WHERE hash = ?", (_hash(secret),))

    def of_session(self, secret: str) -> Person | None:
        """Return the person of a cookie, or None."""
        rows = self._database.rows("SELECT * FROM session WHERE hash = ?", _hash(secret))
        return self._person(rows[0], "session") if rows else None

    def new_token(self, name: str, label: str, scopes: Iterable[Scope], days: int) -> str:
        """Return the secret of a new token; it cannot be read again."""
        secret = f"bench_{secrets.token_urlsafe(32)}"
        ends = wall_utc() + timedelta(days=days)
        row = (_hash(secret), secrets.token_hex(4), name, label, _text(scopes), ends.isoformat(), "")
        with self._database.transaction() as tables:
            tables.execute("INSERT INTO token VALUES (?, ?, ?, ?, ?, ?, ?)", row)
        return secret

    def of_token(self, secret: str) -> Person | None:
        """Return the person or program of a token, or None."""
        rows = self._database.rows("SELECT * FROM token WHERE hash = ?", _hash(secret))
        return self._person(rows[0], "token", rows[0]["id"]) if rows else None

    def tokens(self) -> list[dict[str, Any]]:
        """Return all tokens without their secrets."""
        return [dict(row) for row in self._database.rows("SELECT id, name, label, scopes, ends, used FROM token")]

    def revoke(self, id_: str) -> None:
        """Remove a token."""
        with self._database.transaction() as tables:
            tables.execute("DELETE FROM token WHERE id = ?", (id_,))

    def _begin(self, name: str, scopes: frozenset[Scope]) -> Login:
        secret, ends = secrets.token_urlsafe(32), wall_utc() + SESSION
        with self._database.transaction() as tables:
            tables.execute("DELETE FROM session WHERE ends < ?", (wall_utc().isoformat(),))
            row = (_hash(secret), name, _text(scopes), ends.isoformat())
            tables.execute("INSERT INTO session VALUES (?, ?, ?, ?)", row)
        return Login(secret, Person(name, scopes, "session"))

    def _person(self, row: Any, how: str, id_: str = "") -> Person | None:
        if datetime.fromisoformat(row["ends"]) < wall_utc():
            return None
        return Person(row["name"], frozenset(map(Scope, row["scopes"].split())), how, id_)

    def _expect_patience(self, name: str) -> None:
        """Raise TooSoonError while the delay after failed attempts lasts; it grows to 30 s and never further."""
        count, last = self._failed.get(name, (0, Stopwatch()))
        wait_s = min(DELAY_MOST_S, 2.0 ** (count - 3)) - last.elapsed_s() if count >= 3 else 0.0
        if wait_s > 0:
            raise TooSoonError(wait_s)

    def _count_failure(self, name: str) -> None:
        if len(self._failed) > 1000:
            self._failed.pop(next(iter(self._failed)))
        self._failed[name] = self._failed.pop(name, (0, Stopwatch()))[0] + 1, Stopwatch()


_OF_NOBODY = PasswordHasher().hash(secrets.token_hex(16))


def _hash(secret: str) -> str:
    return hashlib.sha256(secret.encode()).hexdigest()


def _text(scopes: Iterable[Scope]) -> str:
    return " ".join(sorted(scopes))
