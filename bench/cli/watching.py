"""watch: progress and events of a run in progress, until it ends."""

from __future__ import annotations

import queue
import sys
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.cli.commands import Command, argument
from bench.cli.exits import BENCH_ERROR, NOT_SAFE, OF_VERDICT
from bench.cli.stored import RUNS
from bench.cli.streams import say
from bench.cli.through import Meant, meant, station_here
from bench.errors import BenchError, InputError

if TYPE_CHECKING:  # keeps imports out of `bench --help`
    from bench.client import Station

LOOK_EVERY_S = 0.5
_CLEAR_LINE = "\r\x1b[K"
_pause = threading.Event().wait

Json = Mapping[str, Any]
Look = tuple[Json | None, list[Json]]  # state of the run, None if it is unknown, and new entries of its journal


def watch(run: str, runs: Path) -> int:
    """Print what a run does until it ends; the exit code is that of the run. Ctrl-C ends the watching alone."""
    found = meant(run or _only_run(runs), runs)
    looks = _looks_there(found.station, found.name) if found.path is None else _looks_here(found.path)
    line = _ProgressLine()
    for state, entries in looks:
        for entry in entries:
            line.write_above(_entry_text(entry))
        if state is not None:
            line.show(state_text(state))
    line.show("")
    info = _info(found)
    latched = f"; {info['latched']}" if info["latched"] else ""
    say(f"{found.name}: {info['state']}, {info['verdict'] or 'no verdict'}{latched}")
    return NOT_SAFE if info["latched"] else OF_VERDICT.get(info["verdict"], BENCH_ERROR)


def _only_run(runs: Path) -> str:
    """Return the run in progress. Raises InputError if there is none, or more than one."""
    from bench.store.runs import list_runs

    station = station_here()
    found = {run.id for run in list_runs(runs) if run.state == "running"}
    if station is not None:
        seen = station.state()
        found |= {run["run"] for run in [*seen["other_runs"], *(run for b in seen["benches"] for run in b["running"])]}
    if len(found) != 1:
        listed = f"several runs are in progress: {', '.join(sorted(found))}" if found else "no run is in progress"
        raise InputError(f"{listed}; give the RUN to watch")
    return found.pop()


def _looks_here(path: Path) -> Iterator[Look]:
    """Yield what a run on this computer does."""
    from bench.station.runs.live import LiveRun
    from bench.station.view import event_view, run_view
    from bench.store.runs import summary

    live = LiveRun(summary(path))
    while True:
        goes_on = summary(path).state == "running"  # before the look, which must see its last entries
        entries: list[Json] = [event_view(None, each).model_dump(mode="json") for each in live.look()]
        yield run_view(live).model_dump(mode="json"), entries
        if not goes_on:
            return
        _pause(LOOK_EVERY_S)


def _looks_there(station: Station | None, run: str) -> Iterator[Look]:
    """Yield what a run does of which only a station knows."""
    assert station is not None  # noqa: S101  it is the only one that knows the run
    entries = _entries(station, run)
    while True:
        new, is_over = _taken(entries)
        try:
            state = None if is_over else station.live(run)
        except InputError:  # it is beginning or ending
            state = None
        yield state, new
        if is_over:
            return


def _entries(station: Station, run: str) -> queue.SimpleQueue[Json | BenchError | None]:
    """Return a queue into which a thread puts the entries of a journal; then None, or the error that has ended it."""
    entries: queue.SimpleQueue[Json | BenchError | None] = queue.SimpleQueue()

    def read() -> None:
        try:
            for entry in station.events(run):
                entries.put(entry)
            entries.put(None)
        except BenchError as problem:
            entries.put(problem)

    threading.Thread(target=read, name="events", daemon=True).start()
    return entries


def _taken(entries: queue.SimpleQueue[Json | BenchError | None]) -> tuple[list[Json], bool]:
    """Return the entries of the next half second, and whether they were the last. Raises BenchError."""
    new: list[Json] = []
    while True:
        try:
            entry = entries.get(timeout=0.0 if new else LOOK_EVERY_S)
        except queue.Empty:
            return new, False
        if isinstance(entry, BenchError):
            raise entry
        if entry is None:
            return new, True
        new.append(entry)


def _info(found: Meant) -> Json:
    if found.path is None:
        assert found.station is not None  # noqa: S101
        return found.station.run(found.name)
    from bench.station.view import run_info
    from bench.store.runs import summary

    return run_info(summary(found.path)).model_dump(mode="json")


def _entry_text(entry: Json) -> str:
    from bench.figures.times_and_sizes import duration
    from bench.store.machine_state import printable

    facts = ", ".join(f"{name} {_fact(value)}" for name, value in entry["data"].items() if _is_shown(value))
    kind = str(entry["kind"]).replace("_", " ")
    return printable(f"{duration(entry['at_s']):>12}  {kind} {entry['step']}  {facts}".rstrip())


def _is_shown(value: Any) -> bool:
    return value not in ("", None) and not isinstance(value, dict | list)


def _fact(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def state_text(state: Json) -> str:
    """Return the state of a run in progress in one line."""
    from bench.store.machine_state import printable

    total = f" of {state['total']}" if state["total"] else ""
    parts = [f"{state['done']}{total} steps done", *state["steps"]]
    parts += [f"held by {', '.join(state['held_by'])}"] if state["held_by"] else []
    parts += [f"ASKS: {each['text']} ({each['expected']})" for each in state["questions"]]
    readings = [each for each in state["readings"] if each["value"] is not None]
    parts += [f"{each['name']} {each['value']:g} {each['unit']}" for each in readings]
    return printable("  ".join(parts))


class _ProgressLine:
    """Last line of a terminal, which is written again and again; elsewhere only lines above it are written."""

    def __init__(self) -> None:
        self._is_terminal, self._text = sys.stdout.isatty(), ""

    def show(self, text: str) -> None:
        """Replace the line."""
        if self._is_terminal:
            import shutil

            self._text = text[: shutil.get_terminal_size().columns - 1]
            sys.stdout.write(f"{_CLEAR_LINE}{self._text}")
        sys.stdout.flush()

    def write_above(self, text: str) -> None:
        """Write a line that stays."""
        sys.stdout.write(f"{_CLEAR_LINE}{text}\n{self._text}" if self._is_terminal else f"{text}\n")


COMMANDS = (
    Command("watch", watch, (
        argument("RUN", "A run directory, an id, its first characters, or last; default: that in progress", default=""),
        RUNS,
    )),
)  # fmt: skip
