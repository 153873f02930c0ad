"""Alerts by the API: who may acknowledge and test, what is shown, and what an unattended submission needs."""

import asyncio
from contextlib import ExitStack

import pytest

from bench.app.request import RunRequest
from bench.clock import wall_utc
from bench.station.alerts.kinds import Cause, Kind
from bench.station.worker import check
from bench.store.tried import note_tried
from tests.support.in_process import inside, settings_of
from tests.support.receivers import webhook
from tests.support.runs import ROOT


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def test_an_alert_is_shown_and_acknowledged_by_an_operator(tmp_path):
    async def main():
        async with inside(settings_of(tmp_path, phone="json://127.0.0.1:9/s3cret")) as (daemon, clients):
            cause = Cause(Kind.ALARM, "k", "r1", "alarm", {"bench": "demo", "text": "too hot"}, "demo", "runs/r1")
            daemon.alerts.table.add([cause], wall_utc())
            (shown,) = (await clients["viewer"].get("/api/v1/alerts")).json()
            path = f"/api/v1/alerts/{shown['id']}/acknowledge"
            refused = await clients["viewer"].post(path)
            done = await clients["operator"].post(path)
            missing = await clients["operator"].post("/api/v1/alerts/x/acknowledge")
            routes = await clients["viewer"].get("/api/v1/alerts/routes")
            return shown, refused, done.json(), missing, routes

    shown, refused, done, missing, routes = asyncio.run(main())
    assert shown["text"].startswith("demo: too hot\nLook at the run")
    assert shown["ways"] == [{"route": "phone", "state": "waiting", "tries": 0, "problem": ""}]
    assert (refused.status_code, missing.status_code) == (403, 422)
    assert (done["by"], done["ways"][0]["state"]) == ("anna", "dropped")
    assert routes.json()[0]["name"] == "phone"
    assert "s3cret" not in routes.text


def test_a_station_without_alerts_says_what_it_needs(tmp_path):
    async def main():
        async with inside(settings_of(tmp_path)) as (_, clients):
            return await clients["engineer"].post("/api/v1/alerts/test", json={})

    answer = asyncio.run(main())
    assert answer.status_code == 422
    assert "needs a block 'alerts'" in answer.json()["detail"]


@pytest.mark.lengthy
def test_the_test_of_all_routes_says_of_each_whether_it_was_sent(tmp_path):
    async def main(url):
        async with inside(settings_of(tmp_path, phone=url, dead="json://127.0.0.1:9/s3cret")) as (_, clients):
            refused = await clients["operator"].post("/api/v1/alerts/test", json={})
            tested = await clients["engineer"].post("/api/v1/alerts/test", json={})
            missing = await clients["engineer"].post("/api/v1/alerts/test", json={"route": "phon"})
            return refused, tested, missing, (await clients["viewer"].get("/api/v1/alerts/routes")).json()

    with ExitStack() as stack:
        hook = stack.enter_context(webhook())
        refused, tested, missing, routes = asyncio.run(main(hook.url))
        assert hook.titles == ["Bench station: Test of the route phone, sent by anna"]
    assert (refused.status_code, missing.status_code) == (403, 422)
    found = {each["route"]: each for each in tested.json()}
    assert found["phone"]["sent"]
    assert not found["dead"]["sent"]
    assert "s3cret" not in tested.text
    assert [each["tried"] is not None for each in routes] == [True, False]


@pytest.mark.lengthy
def test_an_unattended_run_needs_a_route_that_has_worked(tmp_path):
    settings = settings_of(tmp_path, phone="json://127.0.0.1:9/x")
    request = RunRequest(
        str(ROOT / "sequences/smoke.yaml"), bench=str(ROOT / "config/simulated_wires.yaml"), units=("a=QF-1",),
        runs=tmp_path, unattended=True, past_due="mark",
    )  # fmt: skip
    assert "names no program that reaches a person" in check(request).problems[0]
    with_route = request._replace(alert_routes=settings.alert_routes)
    assert "no route of the station has worked within 24 h: route phone, tried never" in check(with_route).problems[0]
    assert check(with_route._replace(unattended=False)).problems == ()
    note_tried("alert", settings.alerts.routes["phone"].key)
    found = check(with_route)
    assert found.problems == ()
    assert "by the station, as long as it runs: route phone, tried last at" in found.warnings[-1]
