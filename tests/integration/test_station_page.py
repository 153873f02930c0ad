"""The Station page in a browser: a technician logs in, watches a run, pauses and resumes it, and aborts it."""

from __future__ import annotations

import pytest

from bench.clock import Stopwatch
from bench.store.tail import Tail
from tests.support.browser import browsing
from tests.support.station import serving

STATION = """\
schema: itb-station/1
benches:
  a: {file: simulated}
sequences: own
"""
ASKS = """\
schema: itb-sequence/1
title: Asks
needs: {head: positioner}
steps:
  - prompt: "Turn the <b>unit</b> over."
    picture: turned.svg
  - prompt: Air pressure
    input: {unit: hPa, min: 800 hPa, max: 1100 hPa}
  - wait: 15 s
  - move: head
    to: 90°
"""
PICTURE = '<svg xmlns="http://www.w3.org/2000/svg" width="300" height="200"><script>document.title = 1</script></svg>'
pytestmark = [pytest.mark.integration, pytest.mark.slow, pytest.mark.peer("chromium", "playwright")]
LONG_MS = 90_000  # on a busy machine a run takes its time to begin
# The first three curves, and whether they are seen without scrolling.
SEEN = """[...document.querySelectorAll('#plots figure')].slice(0, 3).map(each => ({
  title: each.querySelector('figcaption span').textContent,
  seen: each.getBoundingClientRect().bottom <= document.getElementById('plots').getBoundingClientRect().bottom + 1
}))"""
FIELD = ".question input[name='answer']"
CHAMBER = "tr:has(th[title='chamber.process_value']) .value"


def newest(run, channel):
    """The newest recorded reading of a channel: its number, and its value as the page shows it."""
    with Tail(run) as tail:
        ((seq, value),) = tail._rows(
            "SELECT seq, value FROM reading JOIN channel ON channel.id = reading.channel WHERE name = ? "
            "ORDER BY seq DESC LIMIT 1",
            channel,
        )
    return seq, f"{value:.2f}"


def type_while_the_stream_connects(page, field, before, after):
    """Load the page again and type; its stream, which sends each part of the page anew, connects between two keys."""
    held = []
    page.route("**/live?*", lambda route: held.append(route))  # a built-in function is not accepted
    page.reload()
    page.wait_for_selector(field)
    page.evaluate("""document.body.addEventListener('htmx:sseMessage', event => {
      if (event.detail.type === 'questions') document.body.dataset.renewed = 'yes';
    })""")
    page.focus(field)
    page.keyboard.type(before)
    held.pop().continue_()
    page.unroute("**/live?*")
    page.wait_for_selector("body[data-renewed]")
    page.keyboard.type(after)


def test_a_technician_watches_a_run_and_aborts_it(tmp_path):
    with serving(tmp_path) as station, browsing() as seen:
        page = seen.page
        seen.log_in(station.url, station.code)
        assert "Nothing runs" in page.inner_text("main")
        assert seen.grave() == []
        item = station.submit(units={"a": "QF-0001"}, speed="5", settings={"soak": "20 min"})
        page.wait_for_selector(".now:has-text('Soaking at 20 °C')", timeout=LONG_MS)
        assert "Smoke test · QF-0001" in page.inner_text("h1")
        before = page.inner_text(".now")
        station.until(lambda: page.inner_text(".now") != before, within_s=5)

        run = tmp_path / "runs" / station.get(f"queue/{item['id']}")["run"]
        took_s = []
        for _ in range(5):
            seq, _ = newest(run, "chamber.process_value")
            station.until(lambda seq=seq: newest(run, "chamber.process_value")[0] != seq)
            watch, (_, shown) = Stopwatch(), newest(run, "chamber.process_value")
            station.until(lambda shown=shown: page.inner_text(CHAMBER) == shown, within_s=3)
            took_s.append(watch.elapsed_s())
        assert sorted(took_s)[2] < 1.0, took_s

        page.wait_for_selector("#plots canvas")
        station.until(lambda: page.locator("#plots figure").count() >= 3)
        shown = page.evaluate(SEEN)
        assert [each["title"].partition(" / ")[0] for each in shown] == [
            "Temperature", "Pulse rate minus expectation", "Angle",
        ]  # fmt: skip
        assert all(each["seen"] for each in shown), shown
        assert page.inner_text(".guard") == "no guardian · leases 0 of 4"
        assert "that of the plan" in str(page.get_attribute(".ends", "title"))
        assert seen.grave() == []
        page.click("[data-scope]")
        page.wait_for_selector("#plots canvas, #plots .quiet")
        page.click("button[data-last='3600']")
        page.wait_for_selector("#plots figure")
        page.click("text=Pause")
        page.wait_for_selector("text=Resume")
        assert "the run pauses" in page.inner_text("#said")
        page.click("text=Resume")
        page.wait_for_selector("text=Pause")

        abort = page.locator("#abort").bounding_box()
        page.mouse.move(abort["x"] + 20, abort["y"] + 20)
        page.mouse.down()
        page.wait_for_timeout(400)
        page.mouse.up()
        assert "Hold" in page.inner_text("#said")
        page.wait_for_timeout(1000)
        assert station.get(f"queue/{item['id']}")["state"] == "running"
        page.mouse.down()
        page.wait_for_timeout(1300)
        page.mouse.up()
        assert station.ended(item)["outcome"] == "aborted"
        page.wait_for_selector("text=Nothing runs", timeout=10_000)
        assert seen.complaints == []


def test_the_keyboard_aborts_after_a_confirmation(tmp_path):
    with serving(tmp_path) as station, browsing() as seen:
        seen.log_in(station.url, station.code)
        item = station.submit(units={"a": "QF-0001"}, speed="5", settings={"soak": "20 min"})
        seen.page.wait_for_selector("#abort", timeout=LONG_MS)
        seen.page.keyboard.press("Control+Alt+a")
        seen.page.keyboard.press("Enter")  # the answer that is offered first: no
        assert station.get(f"queue/{item['id']}")["state"] in ("starting", "running")
        seen.page.keyboard.press("Control+Alt+a")
        seen.page.keyboard.press("Tab")
        seen.page.keyboard.press("Enter")
        assert station.ended(item)["outcome"] == "aborted"
        assert seen.complaints == []


def test_questions_take_the_screen_and_are_answered(tmp_path):
    (tmp_path / "own").mkdir()
    (tmp_path / "own/asks.yaml").write_text(ASKS)
    (tmp_path / "own/turned.svg").write_text(PICTURE)
    (tmp_path / "station.yaml").write_text(STATION)
    with serving(tmp_path, "station.yaml") as station, browsing() as seen:
        page = seen.page
        seen.log_in(station.url, station.code)
        item = station.submit("asks", bench="a", speed="1")
        page.wait_for_selector(".question", timeout=LONG_MS)
        assert page.inner_text(".question h2") == "Turn the <b>unit</b> over."
        station.until(lambda: page.evaluate("document.querySelector('.question img').naturalWidth") == 300)
        assert seen.grave() == []
        page.click(".question button")
        page.wait_for_selector(FIELD)
        page.fill(FIELD, "2")
        page.click(".question button")
        station.until(lambda: "is 200 Pa, expected at least 80000 Pa" in page.inner_text("#said"))
        type_while_the_stream_connects(page, FIELD, "10", "13.2")
        assert page.input_value(FIELD) == "1013.2"
        page.click(".question button")
        page.wait_for_selector(".question", state="detached")
        page.wait_for_selector("text=answered by")
        assert station.ended(item)["outcome"] == "completed"
        assert seen.complaints == []
