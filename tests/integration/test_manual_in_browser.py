"""An engineer controls a bench by hand in a browser: begin, order, refusal, halt, end; instruments and due list."""

import os
import re
import subprocess
import sys

import pytest

from tests.support.browser import browsing
from tests.support.runs import ROOT
from tests.support.station import serving

pytestmark = [pytest.mark.integration, pytest.mark.slow, pytest.mark.peer("chromium", "playwright")]
LONG_MS = 90_000
WIDTHS = ((1280, 800), (1920, 1080), (390, 844))


@pytest.fixture(scope="module")
def station(tmp_path_factory):
    with serving(tmp_path_factory.mktemp("station")) as served:
        yield served


def looked_at(seen, station, path):
    """The serious findings of a page at all widths, and how far it is wider than the screen."""
    found = []
    for width, height in WIDTHS:
        seen.page.set_viewport_size({"width": width, "height": height})
        seen.page.goto(f"{station.url}{path}")
        found += seen.grave()
        wide = seen.page.evaluate("document.documentElement.scrollWidth")
        if wide > width:
            found.append(f"{path} at {width} px is {wide} px wide")
    seen.page.set_viewport_size({"width": WIDTHS[0][0], "height": WIDTHS[0][1]})
    return found


@pytest.mark.leaves("the connection to the station, which the other test uses")
def test_an_engineer_controls_a_bench_by_hand_and_all_of_it_is_in_the_record(station):
    with browsing() as seen:
        page = seen.page
        seen.log_in(station.url, station.code)
        assert looked_at(seen, station, "benches/demo/manual") == []
        page.click("text=Begin a session")
        page.wait_for_selector("#abort:not([hidden])", timeout=LONG_MS)
        page.wait_for_selector("text=controls from this page")
        run = page.locator(".abort").first.get_attribute("data-run")
        assert looked_at(seen, station, "benches/demo/manual") == []
        assert looked_at(seen, station, "instruments") == []
        assert looked_at(seen, station, "instruments/calibrations") == []

        page.goto(f"{station.url}benches/demo/manual")
        supply = page.locator(".controls > li", has=page.locator("input[name=voltage]"))
        supply.locator("input[name=voltage]").fill("48")
        supply.locator("input[name=current_limit]").fill("120 mA")
        supply.locator("button:has-text('Switch on')").click()
        page.wait_for_selector("#said .problem:has-text('above the 16 V')")
        supply.locator("input[name=voltage]").fill("15")
        supply.locator("button:has-text('Switch on')").click()
        page.wait_for_selector("#said:has-text('Order 1 begins')")
        page.wait_for_selector(".order-done:has-text('set supply')")
        head = page.locator(".controls > li", has=page.locator("button:has-text('Home')"))
        head.locator("input[name=to]:not([type=hidden])").fill("350")
        head.locator("button:has-text('Move')").click()
        page.wait_for_selector("#said:has-text('Order 2 begins')")
        head.locator("button:has-text('Halt')").click()
        page.wait_for_selector(".order-cut:has-text('move head')")
        page.click("text=End the session")
        page.wait_for_selector("text=Begin a session", timeout=LONG_MS)  # the page renews itself

        events = station.client.get(f"/api/v1/runs/{run}/events").text
        kinds = re.findall(r"^event: (\w+)$", events, re.M)
        assert (kinds.count("order"), kinds.count("order_refused"), "made_safe" in kinds) == (2, 1, True)
        station.until(lambda: station.get(f"runs/{run}")["state"] == "completed")
        assert station.get("benches/demo/instruments")["instruments"][1]["serial"] == "SIM-HEAD-01"
    assert [each for each in seen.complaints if "422" not in each] == []


@pytest.mark.leaves("the connection to the station, which the other test uses")
def test_the_script_of_the_page_controls_a_bench(station):
    text = (ROOT / "docs/how-to/manual_control.md").read_text("utf-8")
    (example,) = re.findall(r"^```python\n(.*?)^```", text, re.M | re.S)
    token = (station.folder / "station/token").read_text()
    done = subprocess.run(
        [sys.executable, "-c", example], capture_output=True, text=True, timeout=120, check=False,
        env={**os.environ, "BENCH_STATION": station.url, "BENCH_TOKEN": token},
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert "'silence_s': 120.0" in done.stdout
    item = station.get("queue", all_=True)[-1]["item"]
    ended = station.ended(item)
    assert (ended["submission"]["sequence"], ended["outcome"]) == ("manual", "completed")
