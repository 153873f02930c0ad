"""Alerts of a station as users have it: of runs that end, also while the station is down; its log and metrics."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import pytest

from tests.support.receivers import webhook
from tests.support.station import serving

STATION = """\
schema: itb-station/1
title: Laboratory 3
benches:
  demo: {file: simulated}
alerts:
  addresses: addresses.yaml
  digest: null
  routes:
    phone: {events: [end, safe_stop, question, alarm]}
"""
pytestmark = [pytest.mark.integration, pytest.mark.slow]


def configured(folder: Path, url: str, mode: int = 0o600) -> None:
    (folder / "station.yaml").write_text(STATION)
    (folder / "addresses.yaml").write_text(f"phone: '{url}'\n")
    (folder / "addresses.yaml").chmod(mode)


def test_ends_are_told_also_of_a_run_that_ended_while_the_station_was_down(tmp_path):
    with webhook() as hook:
        configured(tmp_path, hook.url)
        with serving(tmp_path, "station.yaml") as station:
            first = station.submit(speed="20")  # slow enough to be seen in progress
            assert station.ended(first)["verdict"] == "PASS"
            station.until(lambda: hook.received)
            second = station.submit(speed="20")
            run = station.until(lambda: station.get(f"queue/{second['id']}")["run"])
            station.process.send_signal(signal.SIGKILL)
            _, log = station.process.communicate()
        manifest = tmp_path / "runs" / run / "manifest.json"
        station.until(lambda: json.loads(manifest.read_text())["state"] != "running")
        with serving(tmp_path, "station.yaml") as station:
            station.until(lambda: len(hook.received) > 1)
            assert station.ended(second)["verdict"] == "PASS"
            alerts = station.get("alerts")
            sent = 'bench_alerts_sent_total{route="phone"} 1.0'
            station.until(lambda: sent in station.client.get("/metrics").text)
            assert station.get("health")["works"]
    assert [each["kind"] for each in alerts] == ["end", "end"]
    assert hook.titles[0].endswith("has ended: PASS")
    assert hook.titles[1].endswith("has ended: PASS (while the station was down)")
    assert hook.received[1]["message"].splitlines()[2] == f"{station.url}runs/{run}"
    entries = [json.loads(line) for line in log.splitlines() if line.startswith("{")]  # Python adds a line at a kill
    assert {"station begins", "item", "run begins", "run has ended", "request"} <= {each["event"] for each in entries}
    assert "s3cret" not in log


def test_a_station_does_not_start_with_addresses_that_others_can_read(tmp_path):
    configured(tmp_path, "json://127.0.0.1:9/s3cret", mode=0o644)
    with pytest.raises(AssertionError, match="chmod 600") as problem, serving(tmp_path, "station.yaml"):
        pass
    assert "s3cret" not in str(problem.value)
