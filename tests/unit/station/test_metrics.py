"""Metrics and health: every series of the dashboard exists, labels stay few, `/health` says nothing else."""

import asyncio
import json
import re
import shutil

from prometheus_client.parser import text_string_to_metric_families

from bench.station.runs.live import LiveRun
from bench.store.runs import summary
from tests.support.in_process import inside, settings_of
from tests.support.runs import ROOT

DASHBOARD = json.loads((ROOT / "docs/grafana/station.json").read_text("utf-8"))
NAME = re.compile(r"\b(?:bench|process)_[a-z_]+")


def scraped(folder, smoke, *, edit=lambda daemon: None):
    """The answer of `/metrics` of a station with a run in progress: that of a finished one, with readings."""

    async def main():
        settings = settings_of(folder, phone="json://127.0.0.1:9/x")
        settings.runs.mkdir()
        run = summary(shutil.copytree(smoke.path, settings.runs / smoke.path.name))
        async with inside(settings) as (daemon, clients):
            run = run.__class__(
                run.path, "running", {**run.manifest, "request": {"bench": str(settings.benches["demo"])}}
            )
            live = daemon.live.runs[run.id] = LiveRun(run)
            live.look()
            live.timeline = {"steps": [{"id": "s", "begin_s": 0.0, "duration_s": 10.0}], "total_s": 10.0}
            live.status = {"now_s": 1.0, "readings": {
                "chamber": {"quality": "valid", "value": 20.5, "unit": "°C", "age_s": 0.5},
                "head": {"quality": "stale"},
            }}  # fmt: skip
            live._now, live.state = live.begun, live.state.__class__(lost={"counter.x": 3}, done=1)
            edit(daemon)
            await clients["viewer"].get("/api/v1/station")
            answer = await clients["viewer"].get("/metrics")
            assert answer.status_code == 200
            return answer.text

    text = asyncio.run(main())
    return {sample.name: sample for each in text_string_to_metric_families(text) for sample in each.samples}, text


def test_every_series_of_the_dashboard_is_a_metric(tmp_path, smoke_run):
    found, _ = scraped(tmp_path, smoke_run)
    shown = [target["expr"] for panel in DASHBOARD["panels"] for target in panel["targets"]]
    shown += [each["query"] for each in DASHBOARD["templating"]["list"]]
    names = {name for expression in shown for name in NAME.findall(expression)}
    assert len(names) > 15
    assert names - set(found) == set()
    ours = {name for name in found if name.startswith("bench_") and not name.endswith(("_created", "_sum", "_count"))}
    assert ours - names == set(), "metrics that the dashboard does not show"


def test_values_are_those_of_the_run_and_a_stale_reading_has_none(tmp_path, smoke_run):
    found, text = scraped(tmp_path, smoke_run)
    assert (found["bench_reading"].value, found["bench_reading"].labels["unit"]) == (20.5, "°C")
    assert 'bench_reading_valid{bench="demo",channel="head"} 0.0' in text
    assert 'bench_reading{bench="demo",channel="head"' not in text
    assert found["bench_run_lost_frames"].value == 3
    assert found["bench_runs"].labels == {"state": "completed", "verdict": "PASS"}


def test_no_run_unit_or_person_is_a_label(tmp_path, smoke_run):
    _, text = scraped(tmp_path, smoke_run)
    labels = set(re.findall(r'[{,]([a-z_]+)="', text))
    assert labels <= {
        "bench", "state", "verdict", "channel", "unit", "part", "folder", "route", "method", "status", "le", "version",
    }  # fmt: skip
    assert smoke_run.path.name not in text


def test_metrics_and_parts_need_a_token_and_health_does_not(tmp_path):
    async def main():
        async with inside(settings_of(tmp_path)) as (daemon, clients):
            anybody = clients["viewer"]
            known = await anybody.get("/api/v1/health")
            anybody.headers.pop("authorization")
            daemon.live.problem = "the disk is full"
            answers = [await anybody.get(path) for path in ("/health", "/metrics", "/api/v1/health")]
            return known, answers, (await clients["operator"].get("/api/v1/health")).json()

    known, (health, metrics, parts), ill = asyncio.run(main())
    assert health.json() == {"status": "ok"}
    assert (metrics.status_code, parts.status_code) == (401, 401)
    assert known.json()["works"]
    assert not ill["works"]
    assert [part["problem"] for part in ill["parts"] if not part["works"]] == ["the disk is full"]
    assert {disk["folder"] for disk in ill["disks"]} == {"runs", "station"}
