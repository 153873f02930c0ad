"""Interrupted runs that resume by themselves after a restart of the computer, as their bench files allow."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from bench.app.request import PreparedRun
from bench.app.resume import Resumption, prepare_again, read_interrupted
from bench.clock import boot_id, wall_utc
from bench.errors import BenchError, InputError
from bench.figures.times_and_sizes import duration
from bench.store.runs import list_runs


class Pending(NamedTuple):
    """Interrupted run: data for its resumption, or the reason why a person must decide."""

    path: Path
    found: tuple[Resumption, PreparedRun] | None
    why_not: str


def pending(runs: Path) -> Iterator[Pending]:
    """Yield each interrupted run below a directory, newest first; of each bench only the newest can resume."""
    taken: set[Path] = set()
    for each in reversed(list(list_runs(runs))):
        if each.state != "interrupted":
            continue
        try:
            resumption = read_interrupted(each.path)
            prepared = prepare_again(resumption, left_on=True)
        except (InputError, BenchError) as problem:
            yield Pending(each.path, None, str(problem))
            continue
        bench = prepared.loaded.document.path.absolute()
        why_not = (
            "a newer run on its bench was interrupted" if bench in taken else _needs_decision(resumption, prepared)
        )
        taken.add(bench)
        yield Pending(each.path, None if why_not else (resumption, prepared), why_not)


def _needs_decision(resumption: Resumption, prepared: PreparedRun) -> str:
    """Return the reason why a person must decide about a run; "" if its bench file lets it resume."""
    policy = prepared.loaded.bench.resume
    if policy is None:
        return "its bench file has no 'resume', so that a person decides"
    boots = [str(entry.data["boot"]) for entry in resumption.entries if "boot" in entry.data]
    if not boots or not boots[-1] or boots[-1] == boot_id():
        return "its computer has not started again since, so that it was not lost by it; a person decides"
    if resumption.number > policy.attempts:
        return f"it was resumed {resumption.number - 1} times; at most {policy.attempts} without a person"
    outage_s = resumption.outage_s(wall_utc())
    if outage_s > policy.within:
        return f"it was interrupted {duration(outage_s)} ago, longer than {duration(policy.within)}"
    return ""
