"""A technician starts a run in a real browser: log in, scan, parameters, checks, go, and the page of the run."""

import re

import pytest

from tests.support.station import serving

pytestmark = [pytest.mark.integration, pytest.mark.slow, pytest.mark.peer("chromium")]
CHROMIUM = "/usr/bin/chromium"


def test_a_run_is_started_with_the_scanner_and_seen_to_its_verdict(tmp_path):
    browsers = pytest.importorskip("playwright.sync_api")
    complaints: list[str] = []
    with serving(tmp_path) as station, browsers.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page()
        page.on("console", lambda said: complaints.append(said.text) if said.type in ("error", "warning") else None)
        page.goto(f"{station.url}login")
        page.fill("#code", station.code)
        page.press("#code", "Enter")
        page.wait_for_url(station.url)

        page.goto(f"{station.url}start")
        page.select_option("#sequence", "smoke")
        page.click("text=Next: unit")
        page.keyboard.type("QF-0815\n")  # as a scanner does, into the field that has the focus
        page.select_option("#speed", "max")
        page.click("text=Next: checks")
        page.wait_for_selector("text=Checked: about")
        station.until(lambda: page.evaluate("document.querySelector('.plan img').naturalWidth") > 0)
        page.click("button:text-is('Run unattended')")

        page.wait_for_url(re.compile("/runs/"), timeout=60_000)  # the page of the item goes to that of the run
        run = page.url.rpartition("/")[2]
        page.wait_for_selector("text=Report with plots", timeout=60_000)  # the page renews itself until it is there
        assert station.get(f"runs/{run}")["verdict"] == "PASS"
        assert "PASS" in page.inner_text(".verdict")
        with page.context.expect_page() as opened:
            page.click("text=Report with plots")
        opened.value.wait_for_selector("h1")
        assert opened.value.evaluate("window.origin") == "null"  # in a sandbox
        page.click("h1 a")
        assert "QF-0815" in page.inner_text("h1")
        assert page.locator("svg.chart").count() > 0
        browser.close()
    assert complaints == []
