"""Runs of a folder that an archive does not have."""

from __future__ import annotations

from pathlib import Path

from bench.archive.destination import ABOUT, Destination
from bench.archive.publish import identity_of
from bench.archive.query import Archive
from bench.report.approval import APPROVAL
from bench.store.runs import SEAL, list_runs


def pending_runs(runs: Path, destination: Destination, *, approved: bool = False) -> list[Path]:
    """Return the sealed runs that are not in an archive, or whose approval is newer than their version there.

    With `approved`, only those with an approved report. Raises StoreError.
    """
    known = _known(destination)
    found = []
    for run in list_runs(runs):
        if not run.has_outcome or not (run.path / SEAL).exists():
            continue
        is_approved = (run.path / APPROVAL).is_file()
        if approved and not is_approved:
            continue
        there = known.get(identity_of(run.path, run.manifest))
        if there is None or (is_approved and not there):
            found.append(run.path)
    return found


def _known(destination: Destination) -> dict[str, bool]:
    """Return whether the latest version is that of an approved run, by the identity of the run."""
    if destination.read(ABOUT) is None:
        return {}
    rows = Archive(destination).query("SELECT uuid, report IS NOT NULL FROM runs").rows
    return {str(uuid): bool(approved) for uuid, approved in rows}
