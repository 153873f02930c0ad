"""A day at the station in a browser: anna starts a run, answers it, pauses and resumes it; erik approves its report."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import pypdf
import pytest

from tests.support.browser import browsing
from tests.support.station import serving

STATION = """\
schema: itb-station/1
benches:
  a: {title: Bench A, file: simulated}
sequences: own
report_prefix: L3
"""
DAY = """\
schema: itb-sequence/1
title: Tumble of a day
needs:
  head: positioner
  counter: pulse_counter
  supply: power_supply
  unit_temperature: thermometer
setup:
  - set: supply
    voltage: 15 V
    current_limit: 120 mA
    output: on
steps:
  - prompt: Air pressure
    input: {unit: hPa, min: 800 hPa, max: 1100 hPa}
  - wait: 60 s
  - wait: 60 s
  - for_each: position
    in: [1°, 91°, 181°, 271°]
    steps:
      - move: head
        to: ${position}
        approach: from_below
        settle: 1 s
      - acquire: counter
        for: 5 s
        label: tumble
teardown:
  - set: supply
    output: off
  - move: head
    to: 0°
results:
  - method: temperature_tumble
    data: tumble
    settings: {degree: 4}
    limits:
      K0: {min: -5 mg, max: 5 mg}
"""
PASSWORDS = {"anna": "anna measures slowly", "erik": "erik reads everything"}
pytestmark = [pytest.mark.integration, pytest.mark.slow, pytest.mark.peer("chromium", "playwright")]
LONG_MS = 90_000  # on a busy machine a run takes its time to begin


def log_in(page, url, name):
    page.goto(f"{url}login")
    page.fill("#name", name)
    page.fill("#password", PASSWORDS[name])
    page.click("main button")
    page.wait_for_url(url)


def log_out(page):
    page.click("header .menu summary")
    page.click("text=Log out")
    page.wait_for_selector("#password")


def start(page, url):
    """Go through the five steps as with a scanner and a keyboard."""
    page.goto(f"{url}start")
    page.select_option("#sequence", "day")
    page.click("text=Next: unit")
    page.wait_for_selector(".scan:focus")
    page.keyboard.type("QF-0815\n")  # as a scanner does, into the field that has the focus
    page.select_option("#speed", "20")
    page.click("text=Next: checks")
    page.wait_for_selector("text=Checked: about", timeout=LONG_MS)
    page.click("button:text-is('Start the run')")


def attend(page, url):
    """Answer the question, pause and resume."""
    page.goto(url)
    page.wait_for_selector(".question input[name='answer']", timeout=LONG_MS)
    assert "Tumble of a day · QF-0815" in page.inner_text("h1")
    page.fill(".question input[name='answer']", "1013.2")
    page.click(".question button")
    page.wait_for_selector(".question", state="detached")
    page.click("text=Pause")
    page.wait_for_selector("text=Resume")
    page.click("text=Resume")
    page.wait_for_selector("text=Pause")


def is_refused(page, url, run):
    """Return True if the person who is logged in sees no form to decide, and is refused if she sends one."""
    offered = page.locator("#sign-off form").count()
    form = {"decision": "approved", "comment": "mine", "password": PASSWORDS["anna"]}
    origin = {"origin": url.rstrip("/"), "accept": "text/html"}
    answer = page.request.post(f"{url}runs/{run}/sign-off", form=form, headers=origin)
    return (offered, answer.status, "may not do this" in answer.text()) == (0, 403, True)


def approve(page, comment):
    page.fill("#sign-customer", "Mole & Sons")
    page.fill("#sign-received", "2026-11-02")
    page.fill("#sign-comment", comment)
    page.fill("#sign-password", PASSWORDS["erik"])
    page.click("button:has-text('Approve')")
    page.wait_for_selector("text=Approved as L3-", timeout=LONG_MS)


def downloaded(page, name) -> bytes:
    with page.expect_download() as loading:
        page.click(f".released a:text-is('{name}')")
    return Path(loading.value.path()).read_bytes()


def text_of(path, content):
    path.write_bytes(content)
    return "".join(each.extract_text() for each in pypdf.PdfReader(path).pages)


def test_anna_measures_and_erik_approves(tmp_path):
    (tmp_path / "own").mkdir()
    (tmp_path / "own/day.yaml").write_text(DAY)
    (tmp_path / "station.yaml").write_text(STATION)
    with serving(tmp_path, "station.yaml") as station, browsing() as seen:
        page = seen.page
        for name, role in (("anna", "operator"), ("erik", "engineer")):
            content = {"role": role, "password": PASSWORDS[name]}
            assert station.client.put(f"/api/v1/users/{name}", json=content).status_code < 300
        log_in(page, station.url, "anna")
        start(page, station.url)
        page.wait_for_url(re.compile("/runs/"), timeout=LONG_MS)  # the page of the item goes to that of the run
        run = page.url.rpartition("/")[2]
        attend(page, station.url)
        page.goto(f"{station.url}runs/{run}")
        page.wait_for_selector("text=Report with plots", timeout=LONG_MS)  # the page renews itself until it is there
        assert "PASS" in page.inner_text(".verdict")
        assert seen.grave() == []
        assert is_refused(page, station.url, run)
        log_out(page)

        log_in(page, station.url, "erik")
        page.goto(f"{station.url}runs/{run}")
        assert seen.grave() == []
        approve(page, "seen and compared")
        assert seen.grave() == []
        (signed,) = station.get(f"runs/{run}/sign-off")["decisions"]
        name = f"report.{signed['report']}.pdf"
        content = downloaded(page, name)
        assert (signed["by"], signed["comment"]) == ("erik", "seen and compared")
        assert content.startswith(b"%PDF")
        assert f"sha256:{hashlib.sha256(content).hexdigest()}" == signed["binds"][name]
        text = text_of(tmp_path / "report.pdf", content)
        assert signed["report"] in text
        assert "Mole & Sons" in text
        assert signed["report"] in page.inner_text("#sign-off")
    assert seen.complaints == []
