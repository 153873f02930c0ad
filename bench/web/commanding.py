"""Commands to runs, by the API and by pages, with their entries in the audit."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from bench.errors import InputError
from bench.runner.tell import send_command
from bench.web.access import Person
from bench.web.services import Services, plain

T = TypeVar("T")


async def command_run(
    station: Services, person: Person, run: str, command: str, reason: str, **arguments: str
) -> str:  # fmt: skip
    """Send a command to a run, once it is in the audit; return the answer of the run.

    Raises LeasedError if somebody else works at the bench, and InputError if the run refuses.
    """
    found = await _apart(station, lambda: station.daemon.catalogue.run(run))
    if command != "pause":
        station.daemon.leases.expect(station.daemon.bench_in(found.manifest), person.name)
    station.audit.note(person, command, run, reason=plain(reason), **arguments)
    try:
        return await _sent(station, found.path, command, by=person.name, **arguments)
    except InputError as problem:
        station.audit.note_afterwards(person, f"{command} refused", run, after=str(problem))
        raise


async def make_safe(
    station: Services, person: Person, run: str, command: str, reason: str, **arguments: str
) -> str:  # fmt: skip
    """Send a command that makes safe; return the answer of the run. Neither a disk nor a lease delays it."""
    path = (await _apart(station, lambda: station.daemon.catalogue.run(run))).path
    try:
        answer = await _sent(station, path, command, by=person.name, **arguments)
    except InputError as problem:
        station.audit.note_afterwards(person, f"{command} refused", run, reason=plain(reason), after=str(problem))
        raise
    problem_ = station.audit.note_afterwards(person, command, run, reason=plain(reason), after=answer, **arguments)
    return f"{answer}; this is not in the audit yet: {problem_}" if problem_ else answer


async def is_alive(station: Services, person: Person, run: str) -> str:
    """Give a run a sign of life of the person who controls it; return the state of the session as JSON.

    It is not in the audit. Raises InputError if the run takes no orders.
    """
    path = (await _apart(station, lambda: station.daemon.catalogue.run(run))).path
    return await _sent(station, path, "alive", by=person.name)


async def _sent(station: Services, path: Path, command: str, **arguments: str) -> str:
    return await _apart(station, lambda: send_command(path, command, **arguments))


async def _apart(station: Services, call: Callable[[], T]) -> T:
    """Return what a function returns, called in a thread that no reader uses."""
    return await asyncio.get_running_loop().run_in_executor(station.daemon.commands, call)
