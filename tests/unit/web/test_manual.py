"""Manual control through a station: engineers alone, with the lease of the bench, and all of it in the audit."""

from __future__ import annotations

import json

from bench.clock import wall_utc
from bench.station.worker import Checked
from bench.web.pages.controls import order_of
from tests.support.web import with_station


async def quickly(_):
    return Checked(300.0, inputs={"sequence.yaml": "", "bench.yaml": ""})


def test_a_session_is_an_item_before_all_others_and_takes_the_lease(tmp_path):
    async def act(here):
        here.add_users()
        here.daemon.checked = quickly
        engineer, operator = here.session("engineer"), here.session("operator")
        path = "/api/v1/benches/demo/manual"
        assert (await here.ask("POST", path, cookie=operator, content={})).status == 403
        refused = await here.ask(
            "POST", "/api/v1/queue", cookie=operator, content={"sequence": "manual", "bench": "demo"}
        )
        assert (refused.status, "needs the scope 'engineer'" in refused.json()["detail"]) == (422, True)
        first = await here.ask("POST", "/api/v1/queue", cookie=operator, content={"sequence": "smoke", "bench": "demo"})
        begun = await here.ask("POST", path, cookie=engineer, content={"silence": "2 min", "units": {"a": ""}})
        assert begun.status == 201, begun.body
        wanted = begun.json()["submission"]
        assert (wanted["sequence"], wanted["speed"], wanted["settings"]) == ("manual", "1", {"silence": "2 min"})
        waiting = [each.id for each in here.daemon.queue.waiting("demo")]
        assert waiting == [begun.json()["id"], first.json()["id"]]
        assert here.daemon.leases.of("demo").holder == "engineer"
        assert [each["action"] for each in here.audit.entries()] == ["submit", "take lease", "submit"]
        again = await here.ask("POST", f"/api/v1/queue/{begun.json()['id']}/clone", cookie=operator)
        assert again.status == 422

    with_station(tmp_path, act)


def test_orders_go_to_the_run_with_their_sender_and_halting_needs_no_lease(tmp_path):
    async def act(here):
        here.add_users()
        engineer, operator = here.session("engineer"), here.session("operator")
        orders, order = f"/api/v1/runs/{here.run.path.name}/orders", {"order": {"move": "head", "to": "90 °"}}
        alive = await here.ask("POST", f"{orders}/alive", cookie=engineer)
        assert (alive.status, alive.json()["left_s"]) == (200, 300.0)
        assert (await here.ask("POST", orders, cookie=engineer, content=order)).json() == {"answer": "done"}
        assert (await here.ask("POST", orders, cookie=operator, content=order)).status == 403
        assert (await here.ask("POST", f"{orders}/halt", cookie=operator, content={"device": "head"})).status == 200
        assert here.heard[-1] == ("halt", "operator")
        for wrong in ({}, {"order": {}}, {"order": {"Move!": "head"}}, {"order": {"move": "x" * 65}}, {"order": 3}):
            assert (await here.ask("POST", orders, cookie=engineer, content=wrong)).status == 422
        (entry,) = (each for each in here.audit.entries() if each["action"] == "order")
        assert (entry["who"], json.loads(entry["order"])) == ("engineer", {"move": "head", "to": "90 °"})

    with_station(tmp_path, act)


def test_who_takes_the_lease_over_controls_and_the_other_page_says_so(tmp_path):
    async def act(here):
        here.add_users()
        here.identity.set_user("zoe", "engineer", "another long password")
        run, first, second = here.run.path.name, here.session("engineer"), here.session("zoe")
        orders = f"/api/v1/runs/{run}/orders"
        assert (await here.ask("POST", f"{orders}/alive", cookie=first)).status == 200
        assert (await here.ask("POST", f"{orders}/alive", cookie=second)).status == 409
        await here.ask("POST", "/api/v1/benches/demo/lease/take-over", cookie=second, content={"note": "my turn"})
        page = await here.ask("POST", f"/manual/{run}/alive", cookie=first)
        assert (page.status, "zoe works at bench" in page.body.decode()) == (200, True)
        here.heard.clear()
        order = {"order": {"move": "head", "to": "90 °"}}
        assert (await here.ask("POST", orders, cookie=first, content=order)).status == 409
        assert (await here.ask("POST", orders, cookie=second, content=order)).status == 200
        assert here.heard == [("order", "zoe")]

    with_station(tmp_path, act)


def test_a_form_is_an_order_in_the_unit_of_its_inputs():
    fields = {"rotate": "table", "at": " 10,5 ", "unit.at": "°/s", "for": "2 min", "unit.for": "s", "acceleration": ""}
    assert order_of(fields) == {"rotate": "table", "at": "10.5 °/s", "for": "2 min"}
    assert list(order_of(fields)) == ["rotate", "at", "for"]


def test_pages_show_the_instruments_the_limits_and_what_each_button_does(tmp_path):
    async def act(here):
        here.add_users()
        engineer, viewer = here.session("engineer"), here.session("viewer")
        for path in ("/instruments", "/instruments/calibrations"):
            answer = await here.ask("GET", path, cookie=viewer, headers={"accept": "text/html"})
            assert answer.status == 200, answer.body
            assert "SIM-2026-0101" in answer.body.decode()
            assert "/benches/demo/manual" not in answer.body.decode()
        assert (await here.ask("GET", "/benches/demo/manual", cookie=viewer)).status == 403
        begin = (await here.ask("GET", "/benches/demo/manual", cookie=engineer)).body.decode()
        assert "Begin a session" in begin
        await here.daemon.live.look()
        (live,) = here.daemon.live.runs.values()
        live.timeline = {
            "steps": [{"id": "steps/a", "begin_s": 0.0, "duration_s": 300.0, "facts": {}}],
            "total_s": 300.0,
        }
        live._now, live.begun = (wall_utc(), 10.0), (wall_utc(), 0.0)
        assert live.ends() is not None
        live.status = {"manual": {"silence_s": 300.0, "left_s": 280.0, "busy": {}}}
        assert live.ends() is None, "a person ends it"
        live.timeline = None
        shown = (await here.ask("GET", "/benches/demo/manual", cookie=engineer)).body.decode()
        for text in ("−5 to 365°", "at most 3 °C/min", "at most 16 V", "Turns head to this angle", "Hold: ABORT"):
            assert text in shown, text
        other = await here.ask("GET", "/benches/demo/manual?run=another", cookie=engineer)
        assert other.headers["hx-refresh"] == "true"

    with_station(tmp_path, act)
