"""Station of this user, and which of its runs a command means."""

from __future__ import annotations

import getpass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from bench.cli.streams import remark, say

if TYPE_CHECKING:  # keeps imports out of `bench --help`
    from bench.client import Station

ABORT_LIMIT_S = 1.0  # then the abort is sent to the run itself
COMMAND_LIMIT_S = 15.0
MAKING_SAFE = frozenset({"pause", "stop", "stop_after_step", "abort"})  # harmless when they arrive twice


class Meant(NamedTuple):
    """Run that a command means: its name, its directory if it is on this computer, and the station that knows it."""

    name: str
    path: Path | None
    station: Station | None


def station_here(limit_s: float = COMMAND_LIMIT_S) -> Station | None:
    """Return the station of this user, or None if none runs. Raises InputError."""
    from bench.client.address import found_address

    try:
        address = found_address()
    except OSError:  # the folder of the user's state cannot be created
        return None
    if address is None:
        return None
    from bench.client import Station

    return Station(
        address.url, address.token, certificate=address.certificate, runs=address.runs, limit_s=limit_s
    )  # fmt: skip


def meant(run: str, runs: Path, limit_s: float = COMMAND_LIMIT_S) -> Meant:
    """Return the run of a name: in a directory, else in that of the station, else by its API. Raises InputError."""
    from bench.errors import InputError
    from bench.store.runs import find_run

    try:
        station = station_here(limit_s)
    except InputError as problem:  # a run must be reached whatever is wrong with a station
        remark(f"without the station: {problem}")
        station = None
    there = station.runs_folder if station is not None else None
    for folder in (runs, *([there] if there is not None else [])):
        try:
            path = find_run(run, folder)
        except InputError:
            continue
        is_its = there is not None and path.resolve().parent == there.resolve()
        return Meant(path.name, path, station if is_its else None)
    if station is None or there is not None:
        find_run(run, runs)  # raises
        raise InputError(f"{runs}: there is no run '{run}'")
    station.limit_s = COMMAND_LIMIT_S  # there is no other way
    return Meant(_name_there(station, run), None, station)


def _name_there(station: Station, run: str) -> str:
    """Return the name of a run that a station on another computer knows. Raises InputError."""
    from bench.errors import InputError

    names = [each["run"] for each in station.runs(limit=1000)]
    if run == "last" and names:
        return str(names[0])
    found = [name for name in names if name == run] or [name for name in names if name.startswith(run)]
    if len(found) != 1:
        problem = f"is ambiguous: {', '.join(found[:5])}" if found else "is no run of this station"
        raise InputError(f"{station.url}: '{run}' {problem}")
    return str(found[0])


def tell(run: str, runs: Path, command: str, **arguments: str) -> None:
    """Send a command to a run, through the station that knows it, else directly, and print the answer.

    A command that makes safe goes directly where the station fails or has not answered within 1 s. Raises BenchError.
    """
    found = meant(run, runs, ABORT_LIMIT_S if command in MAKING_SAFE else COMMAND_LIMIT_S)
    is_by_another = arguments.get("by", "") not in ("", getpass.getuser())  # a station names the owner of the token
    if found.station is None or (found.path is not None and is_by_another):
        answer, how = _directly(found, command, arguments), ""
    else:
        answer, how = _through(found.station, found, command, arguments)
    if how:
        remark(how)
    say(f"{found.name}: {answer}")


def _directly(found: Meant, command: str, arguments: dict[str, str]) -> str:
    from bench.runner.tell import send_command

    assert found.path is not None  # noqa: S101  only a station knows other runs
    return send_command(found.path, command, **arguments)


def _through(station: Station, found: Meant, command: str, arguments: dict[str, str]) -> tuple[str, str]:
    """Return the answer of a run to a command, and how it was sent: through its station, else directly."""
    from bench.client.http import NoStation
    from bench.errors import BenchError

    try:
        return _sent(station, found.name, command, arguments), f"through the station {station.url}"
    except BenchError as problem:
        if found.path is None or not (isinstance(problem, NoStation) or command in MAKING_SAFE):
            raise
        return _directly(found, command, arguments), f"{problem}; sent directly"


def _sent(station: Station, run: str, command: str, arguments: dict[str, str]) -> str:
    if command == "answer":
        return station.answer(run, arguments["answer"], arguments.get("step") or None)
    if command in ("stop", "stop_after_step"):
        return station.stop(run, after_step=command == "stop_after_step")
    sent: str = getattr(station, command)(run)
    return sent
