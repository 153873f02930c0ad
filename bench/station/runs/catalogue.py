"""Catalogue of the runs of a station: those of its queue and those started by hand."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from bench.errors import InputError
from bench.files import mark_of
from bench.store.runs import LOCK, MANIFEST, RunSummary, summary

TICKET = "ticket"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,254}")
CLOCKS_DIFFER_BY = timedelta(hours=1)


class Catalogue:
    """Runs of a folder. What has ended and was sealed is read once; a changed manifest is read again."""

    def __init__(self, runs: Path) -> None:
        self.runs = runs
        self._ended: dict[str, tuple[tuple[int, int], RunSummary]] = {}

    def names(self) -> list[str]:
        """Return the names of all run directories, newest first."""
        return sorted((path.name for path in self._folders() if _is_run(path)), reverse=True)

    def all(self) -> Iterator[RunSummary]:
        """Yield all runs, newest first."""
        for name in self.names():
            yield self._summary(self.runs / name)

    def running(self) -> list[RunSummary]:
        """Return the runs in progress, newest first. Called twice a second, it looks at no run that has ended."""
        others = (path for path in self._folders() if path.name not in self._ended and _is_run(path))
        found = (self._summary(path) for path in sorted(others, reverse=True))
        return [run for run in found if run.state == "running"]

    def run(self, name: str) -> RunSummary:
        """Return the run of a directory name. Raises InputError."""
        path = self.runs / name
        if not _NAME.fullmatch(name) or path.is_symlink() or not _is_run(path):
            raise InputError(f"there is no run '{name[:100]}'")
        return self._summary(path)

    def of_ticket(self, ticket: str, since: datetime) -> RunSummary | None:
        """Return the run of a ticket that was begun after an instant, or None."""
        first = f"{since - CLOCKS_DIFFER_BY:%Y%m%dT%H%M%SZ}"
        for name in self.names():
            if name < first:
                return None
            found = self._summary(self.runs / name)
            if ticket_of(found.manifest) == ticket:
                return found
        return None

    def _folders(self) -> Iterator[Path]:
        return self.runs.iterdir() if self.runs.is_dir() else iter(())

    def _summary(self, path: Path) -> RunSummary:
        if (mark := mark_of(path / MANIFEST)) is None:
            return summary(path)
        if (known := self._ended.get(path.name)) is not None and known[0] == mark:
            return known[1]
        found = summary(path)
        if found.has_outcome:
            self._ended[path.name] = (mark, found)
        return found


def request_of(manifest: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the request of a run from its manifest; {} if it has none."""
    request = manifest.get("request")
    return request if isinstance(request, Mapping) else {}


def ticket_of(manifest: Mapping[str, Any]) -> str:
    """Return the ticket of a run from its manifest; "" if it was started by hand."""
    return str(request_of(manifest).get(TICKET) or "")


def bench_file_of(manifest: Mapping[str, Any]) -> str:
    """Return the path of the bench file of a run from its manifest; "" if it is not known."""
    return str(request_of(manifest).get("bench", ""))


def _is_run(path: Path) -> bool:
    return (path / MANIFEST).is_file() or (path / LOCK).is_file()
