"""A technician starts a run in a browser: log in, scan, parameters, checks, go, then the pages of run and unit."""

import re

import pytest

from tests.support.browser import browsing
from tests.support.station import serving

pytestmark = [pytest.mark.integration, pytest.mark.slow, pytest.mark.peer("chromium", "playwright")]
LONG_MS = 90_000  # on a busy machine a run takes its time to begin


def test_a_run_is_started_with_the_scanner_and_seen_to_its_verdict(tmp_path):
    with serving(tmp_path) as station, browsing() as seen:
        page = seen.page
        seen.log_in(station.url, station.code)
        page.goto(f"{station.url}start")
        assert seen.grave() == []
        page.select_option("#sequence", "smoke")
        page.click("text=Next: unit")
        page.wait_for_selector(".scan:focus")
        page.keyboard.type("QF-0815\n")  # as a scanner does, into the field that has the focus
        page.select_option("#speed", "max")
        page.click("text=Next: checks")
        page.wait_for_selector("text=Checked: about", timeout=LONG_MS)
        station.until(lambda: page.evaluate("document.querySelector('.plan img').naturalWidth") > 0)
        assert seen.grave() == []
        page.click("button:text-is('Run unattended')")

        page.wait_for_url(re.compile("/runs/"), timeout=LONG_MS)  # the page of the item goes to that of the run
        run = page.url.rpartition("/")[2]
        page.wait_for_selector("text=Report with plots", timeout=LONG_MS)  # the page renews itself until it is there
        assert station.get(f"runs/{run}")["verdict"] == "PASS"
        assert "PASS" in page.inner_text(".verdict")
        assert seen.grave() == []
        with page.context.expect_page() as opened:
            page.click("text=Report with plots")
        opened.value.wait_for_selector("h1")
        assert opened.value.evaluate("window.origin") == "null"  # in a sandbox
        page.click("h1 a")
        assert "QF-0815" in page.inner_text("h1")
        assert page.locator("svg.chart").count() > 0
        for path in ("unit?serial=QF-0815", "runs", "queue", "units", "alerts", f"compare?run={run}&run={run}"):
            page.goto(f"{station.url}{path}")
            assert seen.grave() == [], path
    assert seen.complaints == []
