"""An engineer edits a sequence in a browser: an error at its line, completion, save, difference, release."""

import re

import pytest

from tests.support.browser import browsing
from tests.support.station import serving

pytestmark = [pytest.mark.integration, pytest.mark.slow, pytest.mark.peer("chromium", "playwright")]
LONG_MS = 60_000  # on a busy machine a worker takes its time to begin


def test_a_sequence_is_edited_saved_compared_and_released(tmp_path):
    with serving(tmp_path) as station, browsing() as seen:
        page = seen.page
        page.set_default_timeout(LONG_MS)
        seen.log_in(station.url, station.code)
        page.click("nav >> text=Sequences")
        assert seen.grave() == []
        page.click("a:text-is('Smoke test')")
        page.wait_for_selector("text=A shipped sequence has the versions")
        assert seen.grave() == []
        page.click("text=Edit a copy")
        page.fill("#name", "mine")
        page.fill("#message", "from smoke")
        page.wait_for_selector("#checked img")  # checked, with the picture of its plan
        assert seen.grave() == []
        page.click("text=Save a new version")
        page.wait_for_url(re.compile("/sequences/mine"))

        page.click("a:text-is('Edit')")
        page.wait_for_selector("#checked img")
        page.click(".cm-line:has-text('title: Smoke test')")
        page.keyboard.press("End")
        page.keyboard.type("\npara")
        page.wait_for_selector(".cm-lint-marker-error")
        assert "line 12" in page.inner_text("#checked .found")
        page.keyboard.type("x")
        page.keyboard.press("Backspace")
        for _ in "para":
            page.keyboard.press("Backspace")
        page.keyboard.type("pres")  # a key of the file, as it has no presets
        page.click(".cm-completionLabel >> text=presets")
        assert "presets: " in page.inner_text(".cm-content")
        page.keyboard.type("{longer: {help: longer gate, set: {gate: 10 s}}}")
        page.wait_for_selector("#checked .good")
        page.wait_for_selector("#checked:not(.is-old) img")
        assert page.locator(".cm-lint-marker-error").count() == 0
        assert seen.grave() == []
        page.fill("#message", "a preset with a longer gate")
        page.click("text=Save a new version")

        page.wait_for_selector("td:text-is('a preset with a longer gate')")
        assert page.locator(".versions tbody tr").count() == 2
        page.click("text=Compare the two versions that are marked")
        page.wait_for_selector(".added >> text=+presets: {longer:")
        assert seen.grave() == []
        page.go_back()
        page.fill("#release-comment", "tried on the simulated bench")
        page.click("text=Release this version")
        page.wait_for_selector("#release >> text=✓ released")
        assert [(each["kind"], each["name"]) for each in station.get("releases")] == [("sequence", "mine")]
        assert station.get("queue", all_=True) == []
        assert station.get("runs") == []
    assert seen.complaints == []
