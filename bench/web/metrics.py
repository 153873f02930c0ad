"""Metrics of a station for Prometheus. Labels are names of the settings; no run, unit or person is one."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Iterator, Mapping
from importlib.metadata import version

from prometheus_client import CollectorRegistry, Histogram, ProcessCollector, generate_latest
from prometheus_client.metrics_core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily, Metric
from prometheus_client.registry import Collector

from bench.station.daemon import Daemon
from bench.station.health import disks_of, parts_of
from bench.station.queue.items import WAITING
from bench.station.runs.live import LiveRun
from bench.station.view import run_view

VERDICTS = frozenset({"PASS", "FAIL", "NOT JUDGED", "INCOMPLETE", "ERROR", "none"})
STATES = frozenset({"completed", "failed", "error", "aborted", "interrupted", "damaged", "running"})
BUCKETS_S = (0.005, 0.02, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0)


class StationMetrics(Collector):
    """Metrics of a station, made when they are asked for."""

    def __init__(self, daemon: Daemon) -> None:
        self._daemon = daemon
        self.runs: Mapping[tuple[str, str], int] = {}

    def count_runs(self) -> None:
        """Count all runs by state and verdict; blocks for the disk."""
        self.runs = Counter(
            (_known(run.state, STATES), _known(str(run.manifest.get("verdict") or "none"), VERDICTS))
            for run in self._daemon.catalogue.all()
        )

    def collect(self) -> Iterator[Metric]:
        """Yield all metrics."""
        station = InfoMetricFamily("bench_station", "Version of the program")
        station.add_metric([], {"version": version("inertial-test-bench")})
        yield station
        yield _runs(self.runs)
        yield from self._queue()
        yield from _in_progress(self._of_benches())
        yield from self._state()
        yield from self._alerts()

    def _of_benches(self) -> dict[str, LiveRun]:
        """Return one run in progress of each bench."""
        runs = {self._daemon.bench_of(name): live for name, live in list(self._daemon.live.runs.items())}
        return {bench: live for bench, live in runs.items() if bench is not None}

    def _queue(self) -> Iterator[Metric]:
        length = GaugeMetricFamily("bench_queue_items", "Items that wait", labels=["bench", "state"])
        counts = Counter((each.submission.bench, each.state) for each in self._daemon.queue.waiting())
        stopped = GaugeMetricFamily("bench_stopped", "1 while no item begins at the bench", labels=["bench"])
        for bench in self._daemon.settings.benches:
            stopped.add_metric([bench], float(bool(self._daemon.queue.stopped(bench))))
            for state in sorted(WAITING):
                length.add_metric([bench, state], counts[bench, state])
        yield from (length, stopped)

    def _state(self) -> Iterator[Metric]:
        parts = GaugeMetricFamily("bench_part_works", "1 if a part of the station works", labels=["part"])
        for part in parts_of(self._daemon):
            parts.add_metric([part.name], float(part.works))
        free = GaugeMetricFamily("bench_disk_free_bytes", "Free space", labels=["folder"])
        size = GaugeMetricFamily("bench_disk_size_bytes", "Size of the disk", labels=["folder"])
        for disk in disks_of(self._daemon):
            free.add_metric([disk.folder], disk.free_bytes)
            size.add_metric([disk.folder], disk.size_bytes)
        yield from (parts, free, size)

    def _alerts(self) -> Iterator[Metric]:
        sent = CounterMetricFamily("bench_alerts_sent", "Alerts that were sent", labels=["route"])
        failed = CounterMetricFamily("bench_alert_failures", "Attempts at an alert that failed", labels=["route"])
        waiting = GaugeMetricFamily("bench_alerts_unacknowledged", "Urgent alerts that nobody has acknowledged")
        if (alerts := self._daemon.alerts) is not None:
            waiting.add_metric([], alerts.table.open())
            for name, each in alerts.sending.items():
                sent.add_metric([name], each.successes)
                failed.add_metric([name], each.failures)
        yield from (sent, failed, waiting)


def _runs(counted: Mapping[tuple[str, str], int]) -> Metric:
    found = GaugeMetricFamily("bench_runs", "Runs in the folder of runs", labels=["state", "verdict"])
    for labels, count in sorted(counted.items()):
        found.add_metric(list(labels), count)
    return found


def _in_progress(runs: dict[str, LiveRun]) -> Iterator[Metric]:
    progress = GaugeMetricFamily("bench_run_progress_ratio", "Steps that have ended, of all", labels=["bench"])
    ends = GaugeMetricFamily("bench_run_end_timestamp_seconds", "Estimated end of the run", labels=["bench"])
    problems = GaugeMetricFamily("bench_run_problems", "Problems of the run so far", labels=["bench"])
    questions = GaugeMetricFamily("bench_run_questions", "Questions that wait for an answer", labels=["bench"])
    lost = GaugeMetricFamily("bench_run_lost_frames", "Frames lost in the run so far", labels=["bench", "channel"])
    reading = GaugeMetricFamily("bench_reading", "Newest valid reading", labels=["bench", "channel", "unit"])
    age = GaugeMetricFamily("bench_reading_age_seconds", "Age of the newest reading", labels=["bench", "channel"])
    valid = GaugeMetricFamily("bench_reading_valid", "1 if the newest reading is valid", labels=["bench", "channel"])
    for bench, live in runs.items():
        run = run_view(live)
        if run.total:
            progress.add_metric([bench], run.done / run.total)
        if run.ends is not None:
            ends.add_metric([bench], run.ends.timestamp())
        problems.add_metric([bench], len(run.problems))
        questions.add_metric([bench], len(run.questions))
        for channel, frames in live.state.lost.items():
            lost.add_metric([bench, channel], frames)
        for each in run.readings:
            valid.add_metric([bench, each.name], float(each.quality == "valid"))
            if each.value is not None:
                reading.add_metric([bench, each.name, each.unit], each.value)
            if each.age_s is not None:
                age.add_metric([bench, each.name], each.age_s)
    yield from (progress, ends, problems, questions, lost, reading, age, valid)


def _known(text: str, words: frozenset[str]) -> str:
    """Return a text that is one of these words, else 'other': a record that somebody has changed adds no series."""
    return text if text in words else "other"


class Metrics:
    """Registry of a station, and the durations of its requests by route."""

    def __init__(self, daemon: Daemon) -> None:
        self.registry = CollectorRegistry(auto_describe=False)
        self._station = StationMetrics(daemon)
        self.registry.register(self._station)
        ProcessCollector(registry=self.registry)
        self._durations = Histogram(
            "bench_request_duration_seconds", "Time until a request was answered", ["method", "route", "status"],
            buckets=BUCKETS_S, registry=self.registry,
        )  # fmt: skip

    async def exposition(self) -> bytes:
        """Return all metrics as Prometheus reads them."""
        await asyncio.to_thread(self._station.count_runs)
        return generate_latest(self.registry)

    def request(self, method: str, route: str, status: int, duration_s: float) -> None:
        """Count a request; `route` is its pattern, and the method one of those of routes."""
        self._durations.labels(method, route, f"{status // 100}xx").observe(duration_s)
