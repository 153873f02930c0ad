"""Histories of units that were asked for, kept until a run of the unit is new or has changed."""

from __future__ import annotations

from typing import NamedTuple

from bench.station.runs.catalogue import Catalogue
from bench.station.units.history import UnitHistory, history
from bench.store.runs import RunSummary

KEPT = 100
Mark = tuple[tuple[str, str, str], ...]


class _Kept(NamedTuple):
    mark: Mark
    found: UnitHistory


class Histories:
    """Histories of units; used by several threads."""

    def __init__(self, catalogue: Catalogue) -> None:
        self._catalogue = catalogue
        self._kept: dict[str, _Kept] = {}

    def of(self, serial: str) -> UnitHistory:
        """Return the history of a unit; it has no runs if the unit is unknown."""
        runs = self.runs_of(serial)
        kept = self._kept.get(serial)
        if kept is not None and kept.mark == _mark(runs):
            return kept.found
        return self.keep(serial, runs, history(serial, runs))

    def runs_of(self, serial: str) -> list[RunSummary]:
        """Return the runs of a unit, newest first."""
        return [run for run in self._catalogue.all() if serial in run.units]

    def lacks(self, serial: str, runs: list[RunSummary]) -> bool:
        """Return True if the history of a unit with these runs would have to be made."""
        kept = self._kept.get(serial)
        return kept is None or kept.mark != _mark(runs)

    def keep(self, serial: str, runs: list[RunSummary], found: UnitHistory) -> UnitHistory:
        """Keep the history of a unit that was made of these runs, and return it."""
        if runs:
            self._kept.pop(serial, None)
            self._kept[serial] = _Kept(_mark(runs), found)
            for old in list(self._kept)[:-KEPT]:
                self._kept.pop(old, None)
        return found


def _mark(runs: list[RunSummary]) -> Mark:
    """Return what changes when a run of a unit is added, ends, is resumed or is damaged."""
    return tuple((run.id, run.state, str(run.manifest.get("ended"))) for run in runs)
