"""Rounds of a station, each minute: free space, due calibrations, and the digest of the morning."""

from __future__ import annotations

import asyncio
import shutil
from collections import Counter
from collections.abc import Mapping
from datetime import date, datetime, time, timedelta
from pathlib import Path

from bench.clock import Stopwatch, wall_utc
from bench.errors import InputError
from bench.station.alerts import causes
from bench.station.alerts.kinds import Cause, Kind
from bench.station.alerts.settings import AlertSettings
from bench.station.alerts.table import AlertTable
from bench.station.alerts.watch import Watched
from bench.station.part import Part
from bench.store.runs import RunSummary

GB = 1e9
CALIBRATIONS_EVERY_S = 3600.0
SHOWN = 10  # runs of a digest


class Rounds(Part):
    """Rounds of a station."""

    every_s = 60.0

    def __init__(self, alerts: AlertSettings, table: AlertTable, watched: Watched) -> None:
        super().__init__()
        self._alerts, self._table = alerts, table
        self._settings, self._queue, self._catalogue, _ = watched
        self._looked: Stopwatch | None = None
        self._due: Mapping[str, Mapping[str, date]] = {}

    async def look(self) -> None:
        """Look at the disk, at due calibrations once an hour, and send the digest when it is time."""
        now = wall_utc()
        today = now.astimezone(self._alerts.zone).date()
        self._table.add(await asyncio.to_thread(self._disk, today), now)
        if self._looked is None or self._looked.elapsed_s() > CALIBRATIONS_EVERY_S:
            self._due, self._looked = await asyncio.to_thread(self._calibrations, today), Stopwatch()
            found = [causes.of_calibrations(bench, due, today) for bench, due in self._due.items()]
            self._table.add([each for each in found if each is not None], now)
        if self._is_time(now) and not self._table.is_known(f"digest/{today}"):
            self._table.add([await asyncio.to_thread(self._digest, now, today)], now)

    def _is_time(self, now: datetime) -> bool:
        if self._alerts.entry.digest is None:
            return False
        return now.astimezone(self._alerts.zone).time() >= time.fromisoformat(self._alerts.entry.digest)

    def _disk(self, today: date) -> list[Cause]:
        """Return the cause of an alert for each folder with little space, one a day."""
        limit_gb = self._alerts.entry.disk_free_gb
        return [
            Cause(
                Kind.DISK_LOW, f"disk/{place}/{today}", str(place), "disk_low",
                {"place": str(place), "free": f"{free_gb:.1f}", "limit": f"{limit_gb:g}"},
            )
            for place, free_gb in self._free_gb().items()
            if free_gb < limit_gb
        ]  # fmt: skip

    def _free_gb(self) -> dict[Path, float]:
        """Return the free space at the runs and at the station's own records, once if these share a disk."""
        found, disks = {}, set()
        for place in (self._settings.runs, self._settings.folder):
            there = next(each for each in (place, *place.parents) if each.exists())
            if (disk := there.stat().st_dev) not in disks:
                disks.add(disk)
                found[place] = shutil.disk_usage(there).free / GB
        return found

    def _calibrations(self, today: date) -> dict[str, Mapping[str, date]]:
        found: dict[str, Mapping[str, date]] = {}
        for bench in self._settings.benches:
            try:
                file = self._settings.bench(bench).bench
            except InputError:
                continue  # the queue says so
            found[bench] = causes.calibrations(file, today, self._alerts.entry.calibration_due_within_days)
        return found

    def _digest(self, now: datetime, today: date) -> Cause:
        since = f"{now - timedelta(days=1):%Y%m%dT%H%M%SZ}"
        runs = [self._catalogue.run(name) for name in self._catalogue.names() if name >= since]
        counts = Counter(_outcome(run) for run in runs)
        named = [f"{run.manifest.get('title') or run.id}: {_outcome(run)}" for run in runs[:SHOWN]]
        summary = ", ".join(f"{count} {what}" for what, count in sorted(counts.items()))
        waiting = Counter(each.submission.bench for each in self._queue.waiting())
        due = [f"{bench}: {name} {on}" for bench, found in self._due.items() for name, on in sorted(found.items())]
        values = {
            "ran": f"{summary} ({'; '.join(named)})" if runs else "", "due": ", ".join(due),
            "open": str(self._table.open()),
            "waiting": ", ".join(f"{count} × {bench}" for bench, count in sorted(waiting.items())),
            "disk": ", ".join(f"{free_gb:.0f} GB" for free_gb in self._free_gb().values()),
        }  # fmt: skip
        return Cause(Kind.DIGEST, f"digest/{today}", str(today), "digest", values)


def _outcome(run: RunSummary) -> str:
    return str(run.manifest.get("verdict") or run.state)
