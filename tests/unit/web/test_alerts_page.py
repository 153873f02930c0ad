"""Page of alerts: an open alert is shown on every page until it is acknowledged, and each route has a test."""

import asyncio
import re
from datetime import timedelta

import pytest

from bench.clock import wall_utc
from bench.station.alerts.kinds import Cause, Kind
from tests.support.in_process import inside, settings_of

HTML = {"accept": "text/html"}
POLL = {**HTML, "bench-poll": "true"}
HOT = Cause(Kind.ALARM, "k", "r1", "alarm", {"bench": "demo", "text": "<b>too hot</b>"}, "demo", "runs/r1")
ENDED = Cause(Kind.END, "e", "r1", "end", {"bench": "demo", "title": "Smoke", "verdict": "PASS"}, "demo", "runs/r1")
ROUTES = {"routes": {"desk": {"next": "boss"}, "boss": {"events": ["alarm"], "language": "zh"}}}
ADDRESSES = {"desk": "json://127.0.0.1:9/s3cret", "boss": "json://127.0.0.1:9/s3cret"}


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def with_alerts(tmp_path, work, *causes):
    async def main():
        async with inside(settings_of(tmp_path, ROUTES, **ADDRESSES)) as (daemon, clients):
            daemon.alerts.table.add(causes, wall_utc())
            return await work(daemon, clients)

    return asyncio.run(main())


def test_an_open_alert_is_on_every_page_until_it_is_acknowledged(tmp_path):
    async def work(daemon, clients):
        seen = {path: (await clients["viewer"].get(path, headers=HTML)).text for path in ("/", "/queue", "/wall")}
        page = (await clients["operator"].get("/alerts", headers=HTML)).text
        (id_,) = re.findall(r'action="/alerts/(\w+)/acknowledge"', page)
        refused = await clients["viewer"].post(f"/alerts/{id_}/acknowledge")
        done = await clients["operator"].post(f"/alerts/{id_}/acknowledge")
        return (
            seen,
            page,
            refused,
            done,
            (await clients["viewer"].get("/alerts", headers=HTML)).text,
            (await clients["viewer"].get("/", headers=HTML)).text,
        )

    seen, page, refused, done, after, quiet = with_alerts(tmp_path, work, HOT, ENDED)
    for path, text in seen.items():
        assert "Open alerts: 1" in text, path
        assert "demo: &lt;b&gt;too hot&lt;/b&gt;" in text, path
    assert "Look at the run; abort it if the bench is not as it should be." in page
    assert "Smoke has ended: PASS" in page
    assert (refused.status_code, done.status_code) == (403, 303)
    assert "Nothing is open." in after
    assert "acknowledged by anna at" in after
    assert "Open alerts" not in quiet


def test_the_line_is_sent_again_only_when_it_has_changed(tmp_path):
    async def work(daemon, clients):
        first = (await clients["viewer"].get("/alerts/open", headers=POLL)).text
        (mark,) = re.findall(r"seen=(\w+)", first)
        same = await clients["viewer"].get(f"/alerts/open?seen={mark}", headers=POLL)
        daemon.alerts.table.add([HOT._replace(key="k2", subject="r2")], wall_utc())
        other = await clients["viewer"].get(f"/alerts/open?seen={mark}", headers=POLL)
        chinese = await clients["viewer"].get("/alerts/open", headers={**POLL, "accept-language": "zh"})
        return same, other, chinese

    same, other, chinese = with_alerts(tmp_path, work, HOT)
    assert (same.status_code, same.text) == (204, "")
    assert "Open alerts: 2" in other.text
    assert "未确认的报警：2" in chinese.text


def test_what_has_happened_is_in_the_language_of_the_reader_and_a_question_as_it_was_asked(tmp_path):
    why = "unit_temperature: 23.11 °C is outside -55 to 23 °C. Check the chamber and the sensor."
    left = HOT._replace(key="k2", values={**HOT.values, "text": why})
    question = HOT._replace(
        kind=Kind.QUESTION, key="k3", text="question", values={**HOT.values, "run": "r1", "text": "off"}
    )

    async def work(daemon, clients):
        headers = {**HTML, "accept-language": "zh"}
        return (await clients["operator"].get("/alerts", headers=headers)).text, daemon.alerts.table.newest(9)

    page, kept = with_alerts(tmp_path, work, left, question)
    assert "unit_temperature：23.11 °C 超出 -55 至 23 °C。请检查温箱和传感器。" in page
    assert re.search(r"(?<!\w)off(?!\w)", page)
    assert "关闭" not in page
    assert why in {each.cause.values["text"] for each in kept}, "what is sent and kept is as it was"


def test_ways_of_an_alert_and_the_route_to_come_are_shown(tmp_path):
    async def work(daemon, clients):
        table = daemon.alerts.table
        (alert,) = table.newest(1)
        first = next(each for each in table.deliveries(alert.id) if each.route == "desk")
        table.begin(first)
        table.not_sent(first, "no answer <of the server>", wall_utc(), again=False)
        before = (await clients["viewer"].get("/alerts", headers=HTML)).text
        table.escalate(timedelta(0), wall_utc() + timedelta(seconds=1))
        return before, (await clients["viewer"].get("/alerts", headers=HTML)).text

    cause = HOT._replace(kind=Kind.QUESTION, text="question", values={**HOT.values, "run": "r1"})
    before, after = with_alerts(tmp_path, work, cause)
    assert "no answer &lt;of the server&gt;" in before
    assert "Unless somebody acknowledges it, it goes to boss at" in before
    assert "waits, since nobody acknowledged it on desk" in after
    assert "goes to boss" not in after


@pytest.mark.lengthy
def test_an_engineer_tests_a_route_from_the_page(tmp_path):
    async def work(daemon, clients):
        refused = await clients["operator"].post("/alerts/test", data={"route": "desk"})
        return (
            refused,
            await clients["engineer"].post("/alerts/test", data={"route": "desk"}),
            (await clients["operator"].get("/alerts", headers=HTML)).text,
        )

    refused, tested, page = with_alerts(tmp_path, work)
    assert refused.status_code == 403
    assert "desk: the test was not sent" in tested.text
    assert "s3cret" not in tested.text
    assert 'action="/alerts/test"' in tested.text
    assert 'action="/alerts/test"' not in page
    assert "Nothing is open." in page


def test_a_station_without_alerts_says_what_it_needs(tmp_path):
    async def main():
        async with inside(settings_of(tmp_path)) as (_, clients):
            return await clients["viewer"].get("/alerts", headers=HTML)

    page = asyncio.run(main())
    assert page.status_code == 200
    assert "This station sends no alerts." in page.text
