"""Commands by MQTT: which are obeyed. Each is audited and answered, also one that is refused."""

from __future__ import annotations

import asyncio
from datetime import timedelta
from typing import NamedTuple

from pydantic import ValidationError

from bench.clock import wall_utc
from bench.errors import BenchError, InputError, StoreError
from bench.runner.tell import send_command
from bench.station.mqtt.messages import Command, Reply
from bench.station.runs.catalogue import Catalogue
from bench.station.storage.audit import Audit
from bench.station.storage.database import Database

VALID_FOR = timedelta(seconds=30)
KEPT_FOR = timedelta(minutes=10)
AT_MOST_EVERY_S = 0.2
_TABLE = """CREATE TABLE IF NOT EXISTS mqtt_nonce(user TEXT NOT NULL, nonce TEXT NOT NULL, at TEXT NOT NULL,
  PRIMARY KEY(user, nonce))"""


class Sender(NamedTuple):
    """User of the broker, as the audit names it; the topic of a user admits that user only."""

    name: str
    how: str = "mqtt"
    id: str = ""
    address: str = ""


class Orders:
    """Commands of a station. Raises StoreError: a pause that cannot be audited is not sent."""

    def __init__(self, database: Database, catalogue: Catalogue, users: tuple[str, ...]) -> None:
        self._database, self._catalogue, self._users, self._audit = database, catalogue, users, Audit(database)
        with database.transaction() as tables:
            tables.execute(_TABLE)

    async def obey(self, user: str, payload: str, *, retained: bool) -> Reply:
        """Obey a command or refuse it; return the reply."""
        sender, nonce = Sender(user), ""
        try:
            command = self._expected(user, payload, retained=retained)
            nonce = command.nonce
            run = self._catalogue.run(command.run).path
            if command.command == "pause":
                self._audit.note(sender, command.command, command.run, nonce=nonce)
            answer = await asyncio.to_thread(send_command, run, command.command, by=user)
            if command.command != "pause":  # making safe never waits for the disk of the station
                self._audit.note_afterwards(sender, command.command, command.run, nonce=nonce)
        except BenchError as problem:
            self._audit.note(sender, "command refused", user, why=str(problem), payload=payload[:500])
            return Reply(nonce=nonce or _nonce(payload), done=False, text=str(problem), at=wall_utc())
        return Reply(nonce=nonce, done=True, text=answer, at=wall_utc())

    def _expected(self, user: str, payload: str, *, retained: bool) -> Command:
        """Return a command that may be obeyed. Raises InputError."""
        if user not in self._users:
            raise InputError(f"'{user}' may not send commands")
        if retained:
            raise InputError("the command is retained; send it without the retain flag, and clear the topic")
        try:
            command = Command.model_validate_json(payload)
        except ValidationError as problem:
            wrong = "; ".join(f"{'.'.join(map(str, each['loc']))}: {each['msg']}" for each in problem.errors()[:5])
            raise InputError(f"the command is not valid: {wrong}") from None
        now = wall_utc()
        if command.at.tzinfo is None:
            raise InputError("'at' lacks a time zone, such as Z")
        if abs(now - command.at) > VALID_FOR:
            raise InputError(f"the command is of {command.at.isoformat()}; it is valid for 30 s. Check the clocks.")
        try:
            is_new = self._is_new(user, command.nonce)
        except StoreError:
            if command.command == "pause":
                raise
            is_new = True  # making safe never waits for the disk of the station
        if not is_new:
            raise InputError("the command is repeated; each needs a nonce of its own")
        return command

    def _is_new(self, user: str, nonce: str) -> bool:
        """Note a nonce, durably; False if it was there."""
        now = wall_utc()
        with self._database.transaction() as tables:
            tables.execute("DELETE FROM mqtt_nonce WHERE at < ?", ((now - KEPT_FOR).isoformat(),))
            done = tables.execute("INSERT OR IGNORE INTO mqtt_nonce VALUES (?, ?, ?)", (user, nonce, now.isoformat()))
        return done.rowcount == 1


def _nonce(payload: str) -> str:
    try:
        return Command.model_validate_json(payload).nonce
    except ValidationError:
        return ""
