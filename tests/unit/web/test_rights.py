"""Who may do what: every route, role and state of a token, against a table written by hand."""

from __future__ import annotations

import asyncio
import sqlite3

import pytest
from fastapi import APIRouter, FastAPI

from bench.web.access import OPEN, ROLES, Person, Scope, expect_scopes, routes_of
from tests.support.web import PASSWORD, TERMINAL, with_station

SCOPES = """
GET    /health                                  open
GET    /api/v1/station                          read
GET    /api/v1/live                             read
GET    /api/v1/openapi.json                     read
GET    /api/v1/queue                            read
GET    /api/v1/queue/{id_}                      read
POST   /api/v1/check                            read
POST   /api/v1/queue                            run
POST   /api/v1/queue/{id_}/hold                 run
POST   /api/v1/queue/{id_}/release              run
POST   /api/v1/queue/{id_}/cancel               run
POST   /api/v1/queue/{id_}/move                 run
POST   /api/v1/queue/{id_}/clone                run
POST   /api/v1/benches/{bench}/go-on            engineer
PUT    /api/v1/benches/{bench}/lease            run
DELETE /api/v1/benches/{bench}/lease            run
POST   /api/v1/benches/{bench}/lease/take-over  engineer
GET    /api/v1/runs                             read
GET    /api/v1/runs/{run}                       read
GET    /api/v1/runs/{run}/live                  read
GET    /api/v1/runs/{run}/events                read
POST   /api/v1/runs/{run}/pause                 stop
POST   /api/v1/runs/{run}/stop                  stop
POST   /api/v1/runs/{run}/abort                 stop
POST   /api/v1/runs/{run}/resume                run
POST   /api/v1/runs/{run}/skip                  run
POST   /api/v1/runs/{run}/repeat                run
POST   /api/v1/runs/{run}/answer                run
POST   /api/v1/runs/{run}/acknowledge           safe:clear
GET    /api/v1/runs/{run}/sign-off              read
POST   /api/v1/runs/{run}/sign-off              approve
GET    /api/v1/releases                         read
POST   /api/v1/releases                         engineer
POST   /api/v1/releases/difference              read
GET    /api/v1/me                               read
POST   /api/v1/login                            open
POST   /api/v1/login/code                       open
POST   /api/v1/logout                           read
GET    /api/v1/users                            admin
PUT    /api/v1/users/{name}                     admin
DELETE /api/v1/users/{name}                     admin
GET    /api/v1/tokens                           admin
POST   /api/v1/tokens                           read
DELETE /api/v1/tokens/{id_}                     admin
GET    /api/v1/audit                            admin
GET    /api/v1/audit/verify                     admin
GET    /                                       read
GET    /alerts                                 read
GET    /alerts/open                            read
POST   /alerts/test                            engineer
POST   /alerts/{id_}/acknowledge               run
GET    /api/v1/alerts                          read
GET    /api/v1/alerts/routes                   read
POST   /api/v1/alerts/test                     engineer
POST   /api/v1/alerts/{id_}/acknowledge        run
POST   /api/v1/before-run                      run
GET    /api/v1/benches                         read
GET    /api/v1/comparison                      read
GET    /api/v1/health                          read
GET    /api/v1/jobs/{id_}                      read
GET    /api/v1/plan.svg                        read
POST   /api/v1/rehearsals                      run
GET    /api/v1/runs/{run}/files                read
GET    /api/v1/runs/{run}/files/{name}         read
GET    /api/v1/runs/{run}/findings             read
GET    /api/v1/runs/{run}/provenance           read
POST   /api/v1/runs/{run}/reduction            run
POST   /api/v1/runs/{run}/report               run
GET    /api/v1/runs/{run}/resumption           read
POST   /api/v1/runs/{run}/resumption           run
GET    /api/v1/runs/{run}/series               read
GET    /api/v1/runs/{run}/samples              read
GET    /api/v1/sequences                       read
GET    /api/v1/sequences/{name}                read
GET    /api/v1/unit                            read
GET    /api/v1/units                           read
POST   /appearance                             open
GET    /api/v1/benches/{bench}/instruments      read
POST   /api/v1/benches/{bench}/manual          engineer
GET    /api/v1/calibrations                    read
POST   /api/v1/runs/{run}/orders               engineer
POST   /api/v1/runs/{run}/orders/alive         engineer
POST   /api/v1/runs/{run}/orders/finish        engineer
POST   /api/v1/runs/{run}/orders/halt          stop
GET    /benches/{bench}                        read
GET    /benches/{bench}/manual                 engineer
POST   /benches/{bench}/manual                 engineer
GET    /instruments                            read
POST   /instruments/acknowledge                safe:clear
GET    /instruments/calibrations               read
POST   /manual/{run}/alive                     engineer
POST   /manual/{run}/finish                    engineer
POST   /manual/{run}/halt                      stop
POST   /manual/{run}/order                     engineer
POST   /benches/{bench}/go-on                  engineer
GET    /benches/{bench}/live                   read
GET    /compare                                read
GET    /login                                  open
POST   /login                                  open
POST   /logout                                 open
GET    /metrics                                read
GET    /queue                                  read
GET    /queue/{id_}                            read
POST   /queue/{id_}/{action}                   run
GET    /runs                                   read
GET    /runs/{run}                             read
GET    /runs/{run}/abort                       stop
POST   /runs/{run}/answer                      run
POST   /runs/{run}/do/{command}                stop
POST   /runs/{run}/go/{command}                run
GET    /runs/{run}/picture                     read
POST   /runs/{run}/sign-off                    approve
POST   /runs/{run}/{action}                    run
GET    /start                                  run
POST   /start                                  run
POST   /start/rehearsal                        run
GET    /static/{name:path}                     open
GET    /api/v1/benches/{bench}/files           read
GET    /api/v1/sequences/{name}/text           read
GET    /api/v1/sequences/{name}/versions       read
GET    /api/v1/sequences/{name}/difference     read
PUT    /api/v1/sequences/{name}                engineer
POST   /api/v1/sequences/{name}/check          engineer
POST   /api/v1/completion                      engineer
POST   /api/v1/releases/sequence/{name}        engineer
POST   /api/v1/releases/bench/{name}           engineer
GET    /sequences                              read
GET    /sequences/{name}                       read
GET    /sequences/{name}/difference            read
GET    /sequences/{name}/edit                  engineer
POST   /sequences/{name}/edit                  engineer
GET    /sequences/{name}/copy                  engineer
POST   /sequences/{name}/copy                  engineer
POST   /sequences/{name}/check                 engineer
POST   /sequences/{name}/release               engineer
GET    /bench-files/{bench}                    read
POST   /bench-files/{bench}/release            engineer
GET    /unit                                   read
GET    /units                                  read
GET    /wall                                   read
GET    /wall/{bench}                           read
"""
MAY = {
    "viewer": "read",
    "operator": "read stop run",
    "engineer": "read stop run approve engineer safe:clear",
    "admin": "read admin",
}
TABLE = [line.split() for line in SCOPES.strip().splitlines()]


def filled(path):
    for name, value in (("{id_}", "none"), ("{run}", "none"), ("{bench}", "none"), ("{name}", "nobody")):
        path = path.replace(name, value)
    return path


# The form to log in answers a wrong password with 401, and that to log out asks nobody who he is.
OF_THE_ENTRANCE = {("POST", "/login"), ("POST", "/logout")}


APART = [row for row in TABLE if tuple(row[:2]) not in OF_THE_ENTRANCE]


def outcome(answer):
    return answer.status if answer.status in (401, 403) else "admitted"


def test_the_table_has_every_route_and_every_role(tmp_path):
    async def act(here):
        routes = list(routes_of(here.app._app.routes))
        found = {(method, route.path) for route in routes for method in route.methods - {"HEAD"}}  # HEAD is of a GET
        assert found == {(method, path) for method, path, _ in TABLE}, "enter each route in the table of this file"

    with_station(tmp_path, act)
    assert {role: " ".join(scopes) for role, scopes in ROLES.items()}.keys() == MAY.keys()


def test_each_role_may_do_what_the_table_says_by_session_and_by_token(tmp_path):
    wrong = []

    async def act(here):
        here.add_users()
        for role, may in MAY.items():
            token = here.identity.new_token(Person(role, ROLES[role], "session"), "all", ROLES[role], 1)
            for method, path, scope in APART:
                expected = "admitted" if scope in (*may.split(), "open") else 403
                by_token = await here.ask(method, filled(path), token=token)
                cookie = here.session(role)  # a new one each time, since one route ends it
                by_session = await here.ask(method, filled(path), cookie=cookie)
                wrong.extend(
                    (role, method, path, how, outcome(answer))
                    for how, answer in (("token", by_token), ("session", by_session))
                    if outcome(answer) != expected
                )

    with_station(tmp_path, act)
    assert wrong == []


def test_a_token_that_is_missing_wrong_expired_or_too_low_admits_to_nothing(tmp_path):
    wrong, refused = [], 0

    async def act(here):
        nonlocal refused
        expired = here.identity.new_token(TERMINAL, "expired", Scope, -1)
        low = here.identity.new_token(TERMINAL, "low", (), 1)
        states = {"none": ("", 401), "wrong": ("bench_x", 401), "expired": (expired, 401), "low": (low, 403)}
        for method, path, scope in APART:
            for state, (token, expected) in states.items():
                answer = await here.ask(method, filled(path), token=token)
                if state == "none" and method != "GET":
                    expected = 403  # it did not come from a page of the station
                elif scope == "open":
                    expected = "admitted"
                refused += outcome(answer) != "admitted"
                if outcome(answer) != expected:
                    wrong.append((method, path, state, outcome(answer)))
        assert here.heard == []
        assert list(here.audit.entries()) == []

    with_station(tmp_path, act)
    assert wrong == []
    assert refused > 140


@pytest.mark.parametrize("included", [False, True])
def test_a_route_without_a_scope_stops_the_start(included):
    app, router = FastAPI(openapi_url=None, docs_url=None, redoc_url=None), APIRouter()
    router.get("/good", dependencies=[OPEN])(lambda: None)
    app.include_router(router)
    expect_scopes(app)
    (router if included else app).get("/bad")(lambda: None)
    with pytest.raises(RuntimeError, match="without a scope: /bad"):
        expect_scopes(app)


def test_an_application_without_routes_is_not_taken_for_a_safe_one():
    with pytest.raises(RuntimeError, match="no routes"):
        expect_scopes(FastAPI(openapi_url=None, docs_url=None, redoc_url=None))


def test_tokens_may_no_more_than_their_owner_may_now(tmp_path):
    async def act(here):
        here.identity.set_user("ben", "engineer", PASSWORD)
        ben = Person("ben", ROLES["engineer"], "session")
        strong = here.identity.new_token(ben, "strong", {Scope.READ, Scope.ENGINEER}, 1)
        weak = here.identity.new_token(ben, "weak", {Scope.READ}, 1)
        cookie = here.session("ben")
        here.identity.set_user("ben", "viewer", PASSWORD)
        assert here.identity.of_token(strong) is None
        assert here.identity.of_session(cookie) is None
        assert here.identity.of_token(weak).scopes == {Scope.READ}
        # A role that was reduced in some other way counts as well.
        here.identity.set_user("ben", "engineer", PASSWORD)
        strong = here.identity.new_token(ben, "strong", {Scope.READ, Scope.ENGINEER}, 1)
        with here.database.transaction() as tables:
            tables.execute("UPDATE user SET role = 'viewer'")
        assert here.identity.of_token(strong).scopes == {Scope.READ}
        here.identity.remove_user("ben")
        assert here.identity.of_token(weak) is None
        assert here.identity.of_token(here.token).scopes == frozenset(Scope)

    with_station(tmp_path, act)


def test_a_user_of_the_name_of_the_terminal_changes_nothing_for_its_token(tmp_path):
    async def act(here):
        here.identity.set_user(TERMINAL.name, "viewer", PASSWORD)
        assert here.identity.of_token(here.token).scopes == frozenset(Scope)
        here.identity.remove_user(TERMINAL.name)
        assert here.identity.of_token(here.token) is not None

    with_station(tmp_path, act)


def test_a_token_makes_no_token_and_none_may_more_than_its_owner(tmp_path):
    async def act(here):
        here.add_users()
        token = here.identity.new_token(Person("viewer", ROLES["viewer"], "session"), "t", {Scope.READ}, 1)
        wanted = {"label": "more", "scopes": ["read"], "days": 3650}
        assert (await here.ask("POST", "/api/v1/tokens", token=token, content=wanted)).status == 403
        cookie = here.session("viewer")
        assert (await here.ask("POST", "/api/v1/tokens", cookie=cookie, content=wanted)).status == 201
        wanted["scopes"] = ["read", "run"]
        assert (await here.ask("POST", "/api/v1/tokens", cookie=cookie, content=wanted)).status == 403

    with_station(tmp_path, act)


def test_the_last_use_of_a_token_is_recorded_at_most_once_a_minute(tmp_path, monkeypatch):
    async def act(here):
        def used():
            return [each["used"] for each in here.identity.tokens()]

        await here.ask("GET", "/api/v1/me", token=here.token)
        assert used() == [""]
        monkeypatch.setattr(here.identity._kept, "elapsed_s", lambda: 61.0)
        await here.ask("GET", "/api/v1/me", token=here.token)
        first = used()
        assert first != [""]
        for _ in range(20):
            await here.ask("GET", "/api/v1/me", token=here.token)
        assert used() == first

    with_station(tmp_path, act)


def test_a_command_that_makes_safe_needs_no_disk_and_says_so(tmp_path, monkeypatch):
    async def act(here):
        path = f"/api/v1/runs/{here.run.path.name}"
        with here.database.transaction() as tables:
            tables.execute("CREATE TRIGGER full BEFORE INSERT ON audit BEGIN SELECT RAISE(ABORT, 'full'); END")
        for command in ("stop", "abort"):
            answer = await here.ask("POST", f"{path}/{command}", token=here.token)
            assert (answer.status, "not in the audit yet" in answer.json()["answer"]) == (200, True)
        assert (await here.ask("POST", f"{path}/resume", token=here.token)).status == 503
        assert [command for command, _ in here.heard] == ["stop", "abort"]
        with here.database.transaction() as tables:
            tables.execute("DROP TRIGGER full")
        await here.ask("POST", f"{path}/skip", token=here.token)
        assert [entry["action"] for entry in here.audit.entries()] == ["stop", "abort", "skip"]

    with_station(tmp_path, act)


def test_where_tokens_cannot_be_read_nothing_is_admitted(tmp_path, monkeypatch):
    async def act(here):
        def fails(*_):
            raise sqlite3.OperationalError("disk I/O error")

        with here.database.transaction() as tables:
            tables.execute("ALTER TABLE token RENAME TO lost")
        assert (await here.ask("GET", "/api/v1/me", token=here.token)).status == 503

    with_station(tmp_path, act)


def test_a_stream_ends_when_its_reader_has_lost_the_right_to_it(tmp_path, monkeypatch):
    monkeypatch.setattr("bench.web.guards.ASKED_AGAIN_S", -1.0)
    monkeypatch.setattr("bench.web.api.station.AT_MOST_EVERY_S", 0.01)

    async def act(here):
        sent = []

        async def send(message):
            sent.append(message)
            if len(sent) == 4:
                with here.database.transaction() as tables:
                    tables.execute("DELETE FROM token")

        first = [{"type": "http.request", "body": b"", "more_body": False}]

        async def receive():
            while not first and not (sent and sent[-1].get("more_body") is False):  # noqa: ASYNC110  seen by what is sent
                await asyncio.sleep(0.01)
            return first.pop() if first else {"type": "http.disconnect"}

        headers = [(b"host", b"localhost"), (b"authorization", f"Bearer {here.token}".encode())]
        scope = {
            "type": "http", "asgi": {"spec_version": "2.3"}, "method": "GET", "scheme": "http",
            "path": "/api/v1/live", "raw_path": b"/api/v1/live", "query_string": b"", "headers": headers,
            "client": ("127.0.0.1", 1), "server": ("127.0.0.1", 2), "root_path": "", "http_version": "1.1",
        }  # fmt: skip
        await asyncio.wait_for(here.app(scope, receive, send), 5.0)
        assert sent[-1]["body"] == b""
        assert len(sent) == 5

    with_station(tmp_path, act)
