"""After a run, through the station: an interrupted one is resumed, reported as PDF, and reduced again."""

import json
import os
import signal

import pytest

from tests.support.station import serving

pytestmark = [pytest.mark.integration, pytest.mark.slow]


def test_an_interrupted_run_is_resumed_reported_and_reduced_again(tmp_path):
    with serving(tmp_path) as station:
        item = station.submit(units={"a": "QF-1"}, speed="30")
        run = station.until(lambda: station.get(f"queue/{item['id']}")["run"])
        folder = tmp_path / "runs" / run
        station.until(lambda: station.client.get(f"/api/v1/runs/{run}/live").json().get("done", 0) > 1)
        os.kill(json.loads((folder / "manifest.json").read_text())["process"], signal.SIGKILL)
        station.until(lambda: station.get(f"runs/{run}")["state"] == "interrupted")

        offered = station.get(f"runs/{run}/resumption")
        assert offered["possible"], offered
        assert "steps are done" in offered["lines"][0]
        station.post(f"runs/{run}/resumption")
        again = station.client.post(f"/api/v1/runs/{run}/resumption")
        assert again.status_code in (409, 422), again.text
        station.until(lambda: station.get(f"runs/{run}")["state"] == "completed")

        def done(job):
            return station.until(
                lambda: (found := station.get(f"jobs/{job['id']}"))["state"] in ("done", "failed") and found
            )

        reduced = done(station.post(f"runs/{run}/reduction"))
        assert reduced["result"]["changes"] == [], reduced
        report = done(station.post(f"runs/{run}/report?form=pdf&lang=en"))
        assert report["result"] == {"file": "report.pdf"}, report
        pdf = station.client.get(f"/api/v1/runs/{run}/files/report.pdf")
        assert pdf.content.startswith(b"%PDF-")
        assert pdf.headers["content-disposition"] == 'attachment; filename="report.pdf"'
