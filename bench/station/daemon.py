"""The daemon: all parts of a station at work in one event loop."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from datetime import datetime
from typing import Any

from bench.app.inputs import digest_of
from bench.app.request import RunRequest
from bench.clock import wall_utc
from bench.config.laboratory import load_laboratory
from bench.errors import InputError
from bench.sequence.steps.manual import SEQUENCE as MANUAL
from bench.station.alerts.alerts import Alerts
from bench.station.alerts.watch import Watched
from bench.station.archiving import Archiving
from bench.station.instruments.records import Records
from bench.station.jobs import Jobs
from bench.station.leases import Leases
from bench.station.log import Changes, Log
from bench.station.part import Part
from bench.station.prepare.releases import Releases
from bench.station.prepare.sequences import Sequences
from bench.station.prepare.texts import Texts
from bench.station.queue.attempts import LAUNCHERS, Launcher
from bench.station.queue.items import Item, Submission
from bench.station.queue.resuming import Resuming
from bench.station.queue.schedule import Expected, expected
from bench.station.queue.scheduler import Scheduler
from bench.station.queue.table import Queue
from bench.station.runs.catalogue import Catalogue, bench_file_of
from bench.station.runs.live import Live, LiveRun, Timelines
from bench.station.settings import Settings
from bench.station.signoff.decisions import SignOff
from bench.station.signoff.placing import Placing, UsableKey
from bench.station.storage.database import Database
from bench.station.storage.snapshots import Snapshots
from bench.station.units.histories import Histories
from bench.station.watchdog import Watchdog, watchdog_every_s
from bench.station.worker import Checked, Workers, check
from bench.store.runs import RunSummary

DRAFT_S = 15.0  # for a check of a text that somebody types, beside those of runs
APPROVED_WITHIN_S = 900.0  # a report of many hours, on a busy computer


class Daemon:
    """Parts of a running station. Made by `at_work`, in whose event loop it is used."""

    def __init__(self, settings: Settings, database: Database, workers: Workers, launch: Launcher) -> None:
        self.settings, self.database, self.workers = settings, database, workers
        self.queue = Queue(database, self._changed)
        self.leases = Leases()
        self.address = ""  # URL at which others reach the pages; empty while there is none
        self.commands = ThreadPoolExecutor(8, "commands")  # apart from those of readers, who may be many
        self.on_item: list[Callable[[Item], object]] = []
        self.catalogue = Catalogue(settings.runs)
        self.scheduler = Scheduler(settings, self.queue, self.catalogue, launch)
        self.live = Live(self.running)
        self.records = Records(self.catalogue, self.bench_in)
        laboratory = load_laboratory(settings.laboratory) if settings.laboratory is not None else None
        self.releases = Releases(database)
        self.sign_off = SignOff(database, settings.report_prefix, laboratory)
        self.placing, self.approvals = Placing(self.sign_off, settings.runs), Workers(limit_s=APPROVED_WITHIN_S)
        self.sequences, self.jobs = Sequences(settings), Jobs()
        self.texts, self.drafts = Texts(settings), Workers(limit_s=DRAFT_S)
        self.histories = Histories(self.catalogue)
        self.resuming = Resuming(settings, self.queue, launch)
        self.parts: dict[str, Part] = {
            "queue": self.scheduler,
            "live view": self.live,
            "timelines": Timelines(self.live, workers, self.catalogue),
            "snapshots": Snapshots(database),
            "sign-off": self.placing,
            "jobs": self.jobs,
        }
        if settings.signature is not None:
            self.parts["signature"] = UsableKey(settings.signature, self.approvals)
        if settings.archive:
            self.parts["archive"] = Archiving(settings.archive, settings.runs)
        self.alerts: Alerts | None = None
        if settings.alerts is not None:
            watched = Watched(settings, self.queue, self.catalogue, self.live)
            self.alerts = Alerts(settings.alerts, database, watched)
            self.parts |= dict(self.alerts.parts())
            self.on_item.append(self.alerts.watch.queue_changed)
        if (every_s := watchdog_every_s()) is not None:
            self.parts["watchdog"] = Watchdog(list(self.parts.values()), every_s)

    def problems(self) -> list[str]:
        """Return the last errors of all parts, with their names."""
        return [f"{name}: {part.problem}" for name, part in self.parts.items() if part.problem]

    def running(self) -> list[RunSummary]:
        """Return the runs in progress, also those started by hand."""
        return self.catalogue.running()

    def request(self, submission: Submission) -> RunRequest:
        """Return the request of a submission. Raises InputError for names that the station does not have."""
        return submission.request(
            sequence=str(self.settings.sequence_file(submission.sequence)),
            bench=str(self.settings.bench_file(submission.bench)),
            runs=self.settings.runs,
            alert_routes=self.settings.alert_routes,
        )

    async def checked(self, submission: Submission) -> Checked:
        """Check a submission. Raises InputError for names that the station does not have."""
        return await self.workers.call(check, self.request(submission))

    async def submit(
        self, submission: Submission, by: str, *, key: str = "", held: bool = False, may_be_new: bool = True,
        submitted: Callable[[Item], object] = lambda _: None,
    ) -> Item:  # fmt: skip
        """Check a submission and append it to the queue. Raises InputError with all problems.

        `may_be_new` is true for engineers: it admits manual control and, at a station that runs only what is released,
        other files. The item is not submitted if `submitted` raises.
        """
        if submission.sequence == MANUAL and not may_be_new:
            raise InputError("manual control of a bench needs the scope 'engineer'")
        if not submission.operator:
            submission = submission.model_copy(update={"operator": by})
        found = await self.checked(submission)
        if found.problems:
            raise InputError(*found.problems)
        if self.settings.released_only and not may_be_new:
            self.releases.expect_released(submission.sequence, submission.bench, found.inputs)
        with self.database.transaction():
            item = self.queue.submit(
                submission, by, expected_s=found.expected_s, inputs=digest_of(found.inputs), key=key, held=held
            )
            submitted(item)
        return item

    async def clone(
        self, id_: str, by: str, *, may_be_new: bool = True, submitted: Callable[[Item], object] = lambda _: None
    ) -> Item:
        """Submit again what an item in any state was submitted for, without its earliest instant."""
        again = self.queue.item(id_).submission.model_copy(update={"not_before": None})
        return await self.submit(again, by, may_be_new=may_be_new, submitted=submitted)

    def expected(self) -> dict[str, Expected]:
        """Return the estimated begin and end of all items that run or wait, by id."""
        now, found = wall_utc(), dict[str, Expected]()
        occupying, waiting = self.queue.occupying(), self.queue.waiting()
        ends = {each.id: ends for each in occupying if (ends := self._ends(each)) is not None}
        for bench in self.settings.benches:
            items = [each for each in (*occupying, *waiting) if each.submission.bench == bench]
            found |= expected(items, now, ends)
        return found

    def bench_of(self, run: str) -> str | None:
        """Return the name of the bench of a run in progress, by its bench file; None for a file of somebody else."""
        live = self.live.runs.get(run)
        return self.bench_in(live.run.manifest) if live is not None else None

    def live_at(self, bench: str) -> LiveRun | None:
        """Return the run in progress at a bench, or None."""
        runs = list(self.live.runs.values())  # which change while another thread looks
        return next((live for live in runs if self.bench_in(live.run.manifest) == bench), None)

    def bench_in(self, manifest: Mapping[str, Any]) -> str | None:
        """Return the name of the bench of a run by its manifest; None for a bench file of somebody else."""
        return self.settings.bench_of(bench_file_of(manifest))

    def _ends(self, item: Item) -> datetime | None:
        live = self.live.runs.get(item.run)
        return live.ends() if live is not None else None

    def _changed(self, item: Item) -> None:
        self.scheduler.wake()
        for call in self.on_item:
            call(item)


@asynccontextmanager
async def at_work(
    settings: Settings,
    launch: Launcher | None = None,
    more: Callable[[Daemon], Mapping[str, Part]] = lambda _: {},
    log: Log | None = None,
) -> AsyncIterator[Daemon]:
    """Yield a daemon at work; at the end of the block it stops, and the runs go on. `more` makes further parts of it.

    `launch` starts runs otherwise than the settings say.

    Raises InUseError if another daemon uses the folder, and StoreError. An error of a part ends the block.
    """
    database, workers = Database(settings.folder), Workers()
    daemon = Daemon(settings, database, workers, launch or LAUNCHERS[settings.launch])
    try:
        daemon.parts |= more(daemon)
        if log is not None:
            changes = daemon.parts["log"] = Changes(log, daemon.parts, daemon.live)
            daemon.on_item.append(changes.item)
        async with asyncio.TaskGroup() as parts:
            tasks = [parts.create_task(part.work(), name=name) for name, part in daemon.parts.items()]
            try:
                yield daemon
            finally:
                for task in tasks:
                    task.cancel()
    except BaseExceptionGroup as problems:
        if len(problems.exceptions) == 1:
            raise problems.exceptions[0] from None
        raise
    finally:
        daemon.commands.shutdown(wait=False)
        daemon.jobs.close()
        daemon.drafts.close()
        daemon.approvals.close()
        workers.close()
        database.close()
