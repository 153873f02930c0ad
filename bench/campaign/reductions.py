"""Kind `reduce`: all runs of an archive reduced again by the present program, and what that changes.

The data are the same, so that the uncertainty of a result says nothing on how far it may change: every change is one of
the program. Changes are shown from a tenth of the standard uncertainty.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from bench.archive.query import Archive, opened
from bench.archive.reduction import candidates
from bench.archive.reduction import reduce_again as again
from bench.campaign.isolation import isolate
from bench.campaign.program import present
from bench.campaign.tasks import Known, Task
from bench.figures.columns import in_columns
from bench.report.export.csv_cells import harmless, write_csv

SHOWN_FROM = 0.1  # of the standard uncertainty
CHANGES = "changes.csv"
HEADER = (
    "run", "result", "unit", "value before", "value now", "change/u", "u before", "u now", "verdict before",
    "verdict now",
)  # fmt: skip


class Reductions:
    """Campaign over the runs of an archive, each in its latest version that is not of this program.

    With `publish` the changed ones become new versions. Raises InputError without an archive, and StoreError.
    """

    name = "reduce"

    def __init__(self, archive: str, *, publish: bool = False) -> None:
        found = opened(archive)
        more = {"publish": True} if publish else {}
        self._tasks = [
            Task(
                f"{each.run} {each.uuid[:8]}", "bench.campaign.reductions:reduce_again",
                {"archive": found.destination.url, "uuid": each.uuid, "version": each.version, **more},
            )
            for each in candidates(found, present())
        ]  # fmt: skip

    def tasks(self, known: Known) -> Sequence[Task]:
        """One for each run."""
        return self._tasks

    def lines(self, known: Known, out: Path) -> Iterator[str]:
        """Table of changes, also as a CSV file, and counts."""
        found = [result.content for task in self._tasks if (result := known(task)) is not None and result.is_finished]
        rows = [row for content in found for row in _rows(content)]
        write_csv(out / CHANGES, [HEADER, *(map(harmless, row) for row in rows)])
        if rows:
            yield from in_columns([HEADER, *rows], "<<<>>>>><<", indent="")
        below = sum(not is_shown(change) for content in found for change in content["changes"])
        verdicts = sum(content["verdict"]["before"] != content["verdict"]["now"] for content in found)
        published = sum("published" in content for content in found)
        findings = sum(content["findings"] for content in found)
        yield (
            f"reduce: {len(found)} runs with {findings} findings; {len(rows)} rows in {out / CHANGES}, {below} changes "
            f"below {SHOWN_FROM:g} u, {verdicts} changed verdicts of runs, {published} new versions"
        )

    def exit_code(self, known: Known) -> int:
        """Return 0: whether a change is right is for a person."""
        return 0


def reduce_again(archive: str, uuid: str, version: int, publish: bool = False) -> Mapping[str, Any]:
    """Restore a run of an archive, verified, and reduce it; return the findings that differ from its results."""
    with tempfile.TemporaryDirectory(dir=isolate()) as folder:
        opened_at = _archive(archive, uuid, version)
        found, number = again(opened_at, uuid, version, Path(folder), program=present(), publish=publish)
        return {**found.to_json(), **({"published": number} if number is not None else {})}


_opened = lru_cache(maxsize=1)(opened)


def _archive(archive: str, uuid: str, version: int) -> Archive:
    """Return an archive that has a version of a run; one that was opened earlier may not have it yet."""
    found = _opened(archive)
    if not found.query("SELECT 1 FROM all_runs WHERE uuid = ? AND version = ?", [uuid, version]).rows:
        _opened.cache_clear()
    return _opened(archive)


def _rows(content: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    """Yield a row for a changed verdict of a run, and for each change of a finding that is shown."""
    before, now = content["verdict"]["before"], content["verdict"]["now"]
    if before != now:
        yield (content["run"], "", "", "", "", "", "", "", str(before or "none"), str(now))
    for change in content["changes"]:
        if is_shown(change):
            yield (content["run"], change["id"], *_cells(change["before"], change["now"]))


def is_shown(change: Mapping[str, Any]) -> bool:
    """True for a finding that is new or gone, has another verdict, or has moved by at least `SHOWN_FROM`."""
    before, now = change["before"], change["now"]
    if before is None or now is None or (before["unit"], before["verdict"]) != (now["unit"], now["verdict"]):
        return True
    least = SHOWN_FROM * before["u"]
    return bool(abs(now["value"] - before["value"]) >= least or abs(now["u"] - before["u"]) >= least)


def _cells(before: Mapping[str, Any] | None, now: Mapping[str, Any] | None) -> tuple[str, ...]:
    unit = (now or before or {})["unit"]
    values = (_number(before, "value"), _number(now, "value"))
    change = ""
    if before is not None and now is not None and before["u"] and before["unit"] == unit:
        change = f"{(now['value'] - before['value']) / before['u']:+.2g}"
    uncertainties = (_number(before, "u", 4), _number(now, "u", 4))
    return (unit, *values, change, *uncertainties, _verdict(before), _verdict(now))


def _number(found: Mapping[str, Any] | None, key: str, digits: int = 9) -> str:
    return "-" if found is None else f"{found[key]:.{digits}g}"


def _verdict(found: Mapping[str, Any] | None) -> str:
    return "-" if found is None else found["verdict"] or "not judged"
