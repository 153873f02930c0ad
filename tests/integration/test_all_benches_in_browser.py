"""The page of all benches in a browser: a technician logs in, sees what waits, and the page follows by itself."""

from __future__ import annotations

import re

import pytest

from tests.support.broker import broker
from tests.support.browser import browsing
from tests.support.overview_served import showing
from tests.support.publishing import publishing, station_of

pytestmark = [pytest.mark.integration, pytest.mark.slow, pytest.mark.peer("chromium", "playwright", "mosquitto")]
LONG_MS = 60_000
WEIGHT = "performance.getEntriesByType('resource').reduce((sum, each) => sum + each.encodedBodySize, 0)"
OTHER_TEMPERATURE = """([before]) => [...document.querySelectorAll('.bench-card')]
  .find(each => each.innerText.includes('Bench 01')).querySelector('.temperature .value').innerText !== before"""
WIDE = "document.documentElement.scrollWidth - innerWidth"
BEYOND = "document.documentElement.scrollHeight - innerHeight"
SMALL = """[...document.querySelectorAll('.filter select, .filter label.check, .bench-card .button')]
  .filter(each => each.getBoundingClientRect().height < 47.5).map(each => each.outerHTML)"""


@pytest.fixture(scope="module")
def stations(tmp_path_factory):
    """Twenty stations, one of which can be killed, and the page of their benches."""
    folder = tmp_path_factory.mktemp("all")
    kinds = {3: "asks", 7: "paused", 9: "alarm", 12: "idle", 13: "idle"}
    hostile = {"title": "<img src=x onerror=alert(1)>" + "W" * 90, "run_title": "M" * 150, "text": "Turn it. " * 40}
    with broker(folder / "broker", is_open=True) as of:
        others = [
            station_of(folder, of.port, number, kinds.get(number, "running"), **(hostile if number == 3 else {}))
            for number in range(1, 20)
        ]
        with publishing(others), publishing([station_of(folder, of.port, 20)]) as dying, \
                showing(folder, f"mqtt://127.0.0.1:{of.port}") as board:  # fmt: skip
            board.until(lambda page: page.count('class="bench-card') == 20, within_s=90)
            yield board, dying


@pytest.mark.parametrize(
    ("width", "height", "scheme", "locale", "path"),
    [
        (390, 844, "light", "zh-CN", ""), (390, 844, "dark", "en-GB", "wall"), (1280, 800, "dark", "zh-CN", ""),
        (1920, 1080, "light", "en-GB", ""), (1920, 1080, "dark", "zh-CN", "wall"),
    ],
)  # fmt: skip
def test_it_fits_every_screen_is_accessible_and_breaks_no_policy(stations, width, height, scheme, locale, path):
    board, _ = stations
    session = board.client.post("/api/v1/tokens", json={"label": "browser", "scopes": ["read"]}).json()["token"]
    headers = {"authorization": f"Bearer {session}"}
    view = {"width": width, "height": height}
    with browsing(viewport=view, color_scheme=scheme, locale=locale, extra_http_headers=headers) as seen:
        page = seen.page
        page.goto(f"{board.url}{path}")
        page.wait_for_selector(".bench-card")
        page.wait_for_function("document.querySelectorAll('.bench-card').length === 20")
        assert page.evaluate(WIDE) <= 0
        if path == "wall" and width == 1920:
            assert page.evaluate(BEYOND) <= 400, "with one hostile name that takes five lines"
        if path == "":
            assert page.evaluate(SMALL) == []
        assert page.title().startswith("(2) ")
        assert seen.grave() == []
        assert seen.complaints == []
        assert page.evaluate(WEIGHT) < 300_000


def test_a_technician_logs_in_and_sees_a_bench_die(stations):
    board, dying = stations
    with browsing() as seen:
        page = seen.page
        seen.log_in(board.url, board.code)
        first = page.locator(".bench-card").first
        assert "Needs an answer" in first.inner_text()
        assert first.locator("a.button").get_attribute("href") == "http://lab3.example.org:8421/benches/a"
        temperature = page.locator(".bench-card:has-text('Bench 01') .temperature .value")
        before = temperature.inner_text()
        page.wait_for_function(OTHER_TEMPERATURE, arg=[before], timeout=10_000)
        link = page.locator("h3 a:has-text('Bench 02')")
        dying.kill()
        page.wait_for_selector(".kind-lost:has-text('Bench 20')", timeout=LONG_MS)
        assert re.search("last heard|not heard", page.inner_text(".kind-lost.bench-card"))
        page.select_option("#station", label="Laboratory 20")
        page.wait_for_url("**station=lab20*")
        assert page.locator(".bench-card").count() == 1
        page.select_option("#station", value="")
        page.wait_for_function("document.querySelectorAll('.bench-card').length === 20")
        link.click()
        page.wait_for_selector("text=Newest alarms")
        assert "There is no archive" in page.inner_text("main")
        assert page.locator(".bench-card").count() == 1
        assert seen.grave() == []
        assert seen.complaints == []


def test_without_scripts_everything_can_be_read(stations):
    board, _ = stations
    headers = {"authorization": board.client.headers["authorization"]}
    with browsing(java_script_enabled=False, extra_http_headers=headers) as seen:
        seen.page.goto(board.url)
        assert seen.page.locator(".bench-card").count() == 20
        assert "Soaking at −40 °C" in seen.page.inner_text("main")
        assert seen.page.locator("noscript button").count() == 1
