"""users, tokens: who may use the station, through its API or, while it does not run, in its database."""

from __future__ import annotations

import getpass
import os
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

from bench.cli.commands import Command, argument, flag, option, options, whole_number
from bench.cli.streams import remark, say, say_json
from bench.errors import InputError

PASSWORD_LIMIT_BYTES = 1000
ROLES = ("viewer", "operator", "engineer", "admin")


class _People(Protocol):
    """Users and tokens, of a running station or of its database."""

    def users(self) -> list[dict[str, Any]]: ...
    def set_user(self, name: str, role: str, password: str) -> None: ...
    def remove_user(self, name: str) -> None: ...
    def tokens(self) -> list[dict[str, Any]]: ...
    def new_token(self, label: str, scopes: list[str], days: int = 90) -> str: ...
    def revoke(self, token: str) -> None: ...


def users(folder: Path | None, *, as_json: bool) -> None:
    """List the users of the station with their roles."""
    with _people(folder) as people:
        _write(people.users(), ("name", "role"), as_json=as_json)


def add_user(name: str, role: str, password_file: Path | None, folder: Path | None) -> None:
    """Add a user, or change role and password; the password is asked for on the terminal."""
    with _people(folder) as people:
        people.set_user(name, role, _password(name, password_file))
    say(f"user {name}: {role}")


def remove_user(name: str, folder: Path | None) -> None:
    """Remove a user with all sessions and tokens."""
    with _people(folder) as people:
        if name not in [each["name"] for each in people.users()]:
            raise InputError(f"there is no user '{name}'; 'bench users' lists them")
        people.remove_user(name)
    say(f"user {name}: removed")


def tokens(folder: Path | None, *, as_json: bool) -> None:
    """List the tokens of programs, without their secrets."""
    with _people(folder) as people:
        _write(people.tokens(), ("id", "name", "label", "scopes", "ends", "used"), as_json=as_json)


def new_token(label: str, scopes: tuple[str, ...], days: int, folder: Path | None) -> None:
    """Make a token for a program, and print its secret, which cannot be read again."""
    with _people(folder) as people:
        secret = people.new_token(label, list(scopes) or ["read"], days)
    say(secret)


def revoke(token: str, folder: Path | None) -> None:
    """Revoke a token."""
    with _people(folder) as people:
        if token not in [each["id"] for each in people.tokens()]:
            raise InputError(f"there is no token '{token}'; 'bench tokens' lists their ids")
        people.revoke(token)
    say(f"token {token}: revoked")


@contextmanager
def _people(folder: Path | None) -> Iterator[_People]:
    """Yield users and tokens: of the running station, else in the database of a folder of this user."""
    from bench.client.address import default_folder, found_address

    if found_address(folder) is not None:
        from bench.client import Station

        station = Station.found(folder)
        remark(f"through the station {station.url}")
        yield station
        return
    folder = folder or default_folder()
    if folder.exists() and folder.stat().st_uid != os.geteuid():
        raise InputError(f"{folder}: belongs to another user, and no station runs there; only that user can change it")
    from bench.station.storage.database import Database

    try:
        from bench.cli.people_offline import PeopleOffline
    except ImportError as problem:
        raise InputError(f"this needs more packages ({problem}): pip install 'inertial-test-bench[station]'") from None
    database = Database(folder)
    try:
        yield PeopleOffline(database, getpass.getuser())
    finally:
        database.close()


def _password(name: str, file: Path | None) -> str:
    """Return a password from a file that only this user can read, or from the terminal. Raises InputError."""
    if file is not None:
        return _password_of(file)
    if not sys.stdin.isatty():
        raise InputError("a password is typed on a terminal, or given by --password-file FILE")
    first = getpass.getpass(f"Password of {name}: ")
    if getpass.getpass("Once more: ") != first:
        raise InputError("the two passwords differ; nothing was changed")
    return first


def _password_of(file: Path) -> str:
    with file.open("rb") as opened:  # which may be a pipe
        if stat.S_IMODE(os.fstat(opened.fileno()).st_mode) & 0o077:
            raise InputError(f"{file}: other users can read this password; chmod 600 {file}")
        text = opened.read(PASSWORD_LIMIT_BYTES + 1)
    try:
        return text.decode().rstrip("\r\n")
    except UnicodeDecodeError:
        raise InputError(f"{file}: is not UTF-8") from None


def _write(rows: list[dict[str, Any]], names: tuple[str, ...], *, as_json: bool) -> None:
    from bench.figures.columns import in_columns

    if as_json:
        say_json(rows)
        return
    say(*in_columns([names, *([str(row[name]) for name in names] for row in rows)], "<" * len(names), indent=""))


_FOLDER = option("--folder DIR", "Folder of the station's own records.", read=Path)
_JSON = flag("--json", "Print only JSON on stdout.", to="as_json")
_NAME = argument("NAME", "Name of the user.")
COMMANDS = (
    Command("users", users, (_FOLDER, _JSON)),
    Command("users list", users, (_FOLDER, _JSON)),
    Command("users add", add_user, (
        _NAME,
        option("--role ROLE", f"{', '.join(ROLES)}.", choices=ROLES, is_required=True),
        option("--password-file FILE", "File with the password, readable by this user only.", read=Path),
        _FOLDER,
    )),
    Command("users remove", remove_user, (_NAME, _FOLDER)),
    Command("tokens", tokens, (_FOLDER, _JSON)),
    Command("tokens list", tokens, (_FOLDER, _JSON)),
    Command("tokens new", new_token, (
        argument("LABEL", "What the token is for."),
        options("--scope SCOPE", "What it may do, such as read, stop or run; repeatable. Default: read.", to="scopes"),
        option("--days N", "Days for which it is valid.", read=whole_number(1, 3650), default=90),
        _FOLDER,
    )),
    Command("tokens revoke", revoke, (argument("TOKEN", "Id of the token."), _FOLDER)),
)  # fmt: skip
