"""Runs that many tests only look at: each is made once, by the first worker of a test run that asks for it."""

from __future__ import annotations

import fcntl
import json
import pickle
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:  # conftest.py imports this for every test, most of which need no run
    from bench.app.execute import RunResult
    from bench.store.ledger import LedgerEntry

SMOKE: dict[str, Any] = {"sequence": "smoke", "units": ("QF-0001",), "operator": "A. Technician"}
TUMBLE: dict[str, Any] = {"units": ("QF-0001",), "operator": "Ada"}
Files = dict[str, tuple[int, int]]  # size and time by name


class Made(NamedTuple):
    """A run as it was made, with its lines of the ledger."""

    result: RunResult
    entries: list[LedgerEntry]
    files: Files


class SharedRuns:
    """Runs with their reports, in a folder that all workers of a test run have in common."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._made: dict[str, Made] = {}

    def smoke(self) -> RunResult:
        """The smoke sequence."""
        return self._run("smoke", SMOKE)

    def tumble(self) -> RunResult:
        """A short tumble of three dwells, up and down."""
        return self._run("tumble", TUMBLE)

    def changed(self) -> list[str]:
        """Files that are no longer as they were made."""
        return [
            f"{made.result.path / name}"
            for made in self._made.values()
            for name in {each for each, _ in made.files.items() ^ _files(made.result.path).items()}
        ]

    def _run(self, name: str, wishes: dict[str, Any]) -> RunResult:
        if name not in self._made:
            self._made[name] = _made_once(self._folder / name, wishes)
        made = self._made[name]
        _note(made.result.path.name, made.entries)
        return made.result


def _made_once(folder: Path, wishes: dict[str, Any]) -> Made:
    from bench.store.ledger import entries_of
    from tests.support.runs import run_short

    folder.mkdir(parents=True, exist_ok=True)
    kept = folder / "made"
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if kept.exists():
            return Made(*pickle.loads(kept.read_bytes()))
        result = run_short(folder / "runs", no_report=False, **wishes)
        made = Made(result, list(entries_of(result.path.name)), _files(result.path))
        kept.write_bytes(pickle.dumps(tuple(made)))
        return made


def _note(run: str, entries: list[LedgerEntry]) -> None:
    """Let the ledger of this worker have these entries of a run, whatever became there of copies under its name."""
    from bench.store.ledger import LEDGER, entries_of
    from bench.store.user_state import state_folder

    if list(entries_of(run)) == entries:
        return
    ledger = state_folder() / LEDGER
    before = ledger.read_text("utf-8").splitlines() if ledger.exists() else []
    lines = [*(line for line in before if run not in line), *(json.dumps(asdict(entry)) for entry in entries)]
    ledger.parent.mkdir(parents=True, exist_ok=True)
    ledger.write_text("".join(f"{line}\n" for line in lines), "utf-8")


def _files(folder: Path) -> Files:
    """All files of a run but those that SQLite has beside a database while somebody reads it."""
    found = {path.name: path.stat() for path in folder.iterdir() if not path.name.startswith("run.db-")}
    return {name: (stat.st_size, stat.st_mtime_ns) for name, stat in found.items()}
