"""Where the sequences of a station are used: by other sequences, in the queue, on its benches, and in runs."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from pydantic import BaseModel, ConfigDict

from bench.errors import InputError
from bench.station.daemon import Daemon
from bench.station.prepare.sequences import SequenceView
from bench.station.runs.catalogue import Catalogue
from bench.station.settings import Settings
from drivers.capabilities import OUTPUT

RUNS_MOST = 2000  # newest runs among which the last one of a sequence is looked for


class LastRun(BaseModel):
    """Last run of a sequence."""

    model_config = ConfigDict(frozen=True)

    run: str
    started: str
    state: str
    verdict: str | None
    bench: str


class Use(BaseModel):
    """Where a sequence is used."""

    model_config = ConfigDict(frozen=True)

    called_by: list[str]
    waiting: int
    last: LastRun | None = None


async def uses_of(daemon: Daemon, views: Sequence[SequenceView]) -> dict[str, Use]:
    """Return where each sequence is used, by name."""
    queue = daemon.queue
    waiting = Counter(each.submission.sequence for each in (*queue.waiting(), *queue.occupying()))
    last = await asyncio.to_thread(_last_runs, daemon.catalogue, {view.name for view in views})
    callers: dict[str, list[str]] = {}
    for view in views:
        for file in view.calls:
            callers.setdefault(file.rpartition("/")[2].removesuffix(".yaml"), []).append(view.name)
    return {
        view.name: Use(
            called_by=callers.get(view.name, []), waiting=waiting[view.name], last=last.get(view.name)
        )
        for view in views
    }  # fmt: skip


def suits(settings: Settings, view: SequenceView) -> dict[str, bool]:
    """Return whether each bench has what a sequence needs, by name; False for a bench file that cannot be read."""
    return {name: _suits(settings, name, view.needs.items()) for name in settings.benches}


def chosen(suitable: Mapping[str, bool]) -> str:
    """Return the first bench that has what a sequence needs, else the first one."""
    return next((name for name, has_all in suitable.items() if has_all), next(iter(suitable)))


def _suits(settings: Settings, name: str, needs: Iterable[tuple[str, str]]) -> bool:
    try:
        bench = settings.bench(name).bench
    except InputError:
        return False
    for role, kind in needs:
        device = bench.devices.get(role.partition(".")[0])
        if not (kind == OUTPUT or role in bench.readings or (device and kind in device.description.capabilities)):
            return False
    return True


def _last_runs(catalogue: Catalogue, names: set[str]) -> dict[str, LastRun]:
    found: dict[str, LastRun] = {}
    for number, run in enumerate(catalogue.all()):
        if number == RUNS_MOST or len(found) == len(names):
            break
        manifest, name = run.manifest, str(run.manifest.get("sequence", ""))
        if name in names and name not in found:
            found[name] = LastRun(
                run=run.id, started=str(manifest.get("started", "")), state=run.state,
                verdict=manifest.get("verdict"), bench=str(manifest.get("bench", "")),
            )  # fmt: skip
    return found
