"""Limits of requests, logins and sessions."""

from __future__ import annotations

import asyncio
from datetime import timedelta
from http.cookies import SimpleCookie

import pytest

from bench.errors import InputError
from bench.web import identity
from bench.web.guards import BODY_LIMIT_BYTES
from bench.web.limits import OF_ALL, OF_ONE, BusyError, Limits
from bench.web.patience import Patience, TooSoonError
from tests.support.web import PASSWORD, TERMINAL, called, with_station


def test_a_sender_has_50_requests_a_second_and_is_never_banned():
    now_s = [0.0]
    limits = Limits(lambda: now_s[0])

    def admitted():
        try:
            with limits.request("anna"):
                return True
        except BusyError as problem:
            return not problem.is_of_sender

    found = []
    for _ in range(60 * 200):  # a minute, four times too fast
        now_s[0] += 1 / 200
        found.append(admitted())
    assert 60 * 50 <= sum(found) <= 60 * 50 + 100
    with limits.request("ben"):
        pass
    now_s[0] += 1.0
    assert admitted()


def test_requests_in_progress_are_limited_for_one_and_for_all():
    now_s = [0.0]
    limits = Limits(lambda: now_s[0])
    open_ = []
    for number in range(OF_ALL):
        now_s[0] += 1.0
        request = limits.request(f"sender {number // OF_ONE}")
        request.__enter__()
        open_.append(request)
    with pytest.raises(BusyError, match="close some") as mine, limits.request("sender 0"):
        pass
    with pytest.raises(BusyError, match="busy") as of_all, limits.request("somebody"):
        pass
    assert (mine.value.is_of_sender, of_all.value.is_of_sender) == (True, False)
    for request in open_:
        request.__exit__(None, None, None)
    with limits.request("somebody"):
        pass
    assert not limits._in_progress


def test_a_flood_is_answered_429_and_the_commands_that_make_safe_are_not(tmp_path):
    async def act(here):
        here.app._limits = Limits(lambda: 0.0)
        statuses = [(await here.ask("GET", "/api/v1/me", token=here.token)).status for _ in range(120)]
        assert (statuses.count(200), statuses.count(429)) == (100, 20)
        refused = await here.ask("GET", "/api/v1/me", token=here.token)
        assert refused.headers["retry-after"] == "1"
        path = f"/api/v1/runs/{here.run.path.name}"
        for command in ("abort", "stop", "pause"):
            assert (await here.ask("POST", f"{path}/{command}", token=here.token)).status == 200
        assert (await here.ask("POST", f"{path}/resume", token=here.token)).status == 429
        for _ in range(120):
            unknown = await here.ask("POST", f"{path}/abort", token="bench_x")
        assert unknown.status == 429, "only those who may abort are exempt"
        assert [command for command, _ in here.heard] == ["abort", "stop", "pause"]

    with_station(tmp_path, act)


@pytest.mark.parametrize(
    ("size", "token", "status"),
    [(2**20, True, 422), (2**20 + 1, True, 413), (2**14, False, 422), (2**14 + 1, False, 413)],
)
@pytest.mark.parametrize("declared", [True, False])
def test_a_body_is_limited_whatever_its_declared_length(tmp_path, size, token, status, declared):
    async def act(here):
        headers = [(b"host", b"localhost"), (b"origin", b"http://localhost"), (b"content-type", b"application/json")]
        headers += [(b"authorization", f"Bearer {here.token}".encode())] if token else []
        headers += [(b"content-length", str(size).encode())] if declared else []
        body = [b" " * min(4096, size - at) for at in range(0, size, 4096)]
        path = "/api/v1/queue" if token else "/api/v1/login"
        assert (await called(here.app, "POST", path, headers, body)).status == status

    with_station(tmp_path, act)


@pytest.mark.parametrize("length", ["-1", "1e3", "²", "9" * 5000, "", str(BODY_LIMIT_BYTES + 1)])
def test_a_length_that_is_no_good_number_is_refused(tmp_path, length):
    async def act(here):
        headers = [(b"host", b"localhost"), (b"content-length", length.encode("latin-1"))]
        assert (await called(here.app, "GET", "/health", headers, [b""])).status == 413

    with_station(tmp_path, act)


def test_headers_are_limited(tmp_path):
    async def act(here):
        for length, status in ((8000, 200), (8200, 431)):
            assert (await here.ask("GET", "/health", headers={"x": "y" * length})).status == status
            assert (await here.ask("GET", f"/health?{'y' * length}")).status == status

    with_station(tmp_path, act)


def test_a_body_that_does_not_come_is_waited_for_a_while(tmp_path, monkeypatch):
    monkeypatch.setattr("bench.web.guards.BODY_S", 0.05)

    async def act(here):
        sent = []

        async def receive():
            await asyncio.sleep(0.02)
            return {"type": "http.request", "body": b" ", "more_body": True}

        async def send(message):
            sent.append(message)

        headers = [(b"host", b"localhost"), (b"authorization", f"Bearer {here.token}".encode())]
        scope = {
            "type": "http", "method": "POST", "scheme": "http", "path": "/api/v1/queue", "raw_path": b"/api/v1/queue",
            "query_string": b"", "headers": headers, "client": ("127.0.0.1", 1), "asgi": {}, "http_version": "1.1",
        }  # fmt: skip
        await asyncio.wait_for(here.app(scope, receive, send), 5.0)
        assert sent[0]["status"] == 408
        assert not here.app._limits._in_progress

    with_station(tmp_path, act)


def test_guessing_is_slow_and_keeps_nobody_out():
    now_s = [0.0]
    patience = Patience(lambda: now_s[0])
    tried, waits_s = 0, []
    for _ in range(1000):  # ten a second, at one name
        now_s[0] += 0.1
        try:
            patience.expect("anna", "10.0.0.66")
        except TooSoonError as problem:
            waits_s.append(problem.wait_s)
        else:
            tried += 1
            patience.failed("anna", "10.0.0.66")
    assert 3 < tried <= 10
    assert 0 < min(waits_s) <= max(waits_s) <= 30.0
    patience.expect("anna", "10.0.0.7")
    now_s[0] += 30.0
    patience.expect("anna", "10.0.0.66")


def test_guessing_of_many_names_from_one_address_is_one_a_second():
    now_s = [0.0]
    patience = Patience(lambda: now_s[0])
    tried = 0
    for number in range(10000):
        now_s[0] += 0.1
        address = f"2001:db8::{number % 5000:x}"  # one computer may have all of these
        try:
            patience.expect(f"user {number}", address)
        except TooSoonError:
            continue
        tried += 1
        patience.failed(f"user {number}", address)
    assert tried <= 1000 + 10
    assert len(patience._failed) <= 2000


def test_passwords_are_checked_one_at_a_time_and_not_without_end(tmp_path):
    async def act(here):
        here.add_users()
        tries = [here.identity.check_password("viewer", "wrong" * 3, f"10.0.0.{number}") for number in range(10)]
        found = await asyncio.gather(*tries, return_exceptions=True)
        assert sorted(type(each).__name__ for each in found) == ["InputError"] * 4 + ["TooSoonError"] * 6
        assert await here.identity.check_password("viewer", PASSWORD, "10.0.0.99")

    with_station(tmp_path, act)


def test_a_session_ends_by_itself_by_logging_out_everywhere_and_by_a_new_login(tmp_path, monkeypatch):
    async def act(here):
        here.add_users()
        login = {"name": "viewer", "password": PASSWORD}
        own = {"origin": "http://localhost:8421"}

        async def cookie(before=""):
            answer = await here.ask("POST", "/api/v1/login", content=login, headers=own, cookie=before)
            assert answer.status == 200
            return SimpleCookie(answer.headers["set-cookie"])["bench_session"].value

        async def status(cookie):
            return (await here.ask("GET", "/api/v1/me", cookie=cookie)).status

        planted = here.session("viewer")
        first = await cookie(planted)
        assert first != planted
        assert (await status(planted), await status(first)) == (401, 200)
        second = await cookie()
        assert (await here.ask("POST", "/api/v1/logout", cookie=second)).status == 204
        assert (await status(first), await status(second)) == (200, 401)
        third = await cookie()
        assert (await here.ask("POST", "/api/v1/logout?everywhere=true", cookie=third)).status == 204
        assert (await status(first), await status(third)) == (401, 401)
        fourth = await cookie()
        here.identity.set_user("viewer", "viewer", PASSWORD)
        assert await status(fourth) == 401
        fifth = await cookie()
        now = identity.wall_utc
        monkeypatch.setattr("bench.web.identity.wall_utc", lambda: now() + timedelta(hours=12, seconds=1))
        assert await status(fifth) == 401

    with_station(tmp_path, act)


def test_a_session_that_is_not_used_ends_where_the_station_wants_it(tmp_path, monkeypatch):
    now, ahead = identity.wall_utc, [timedelta()]
    monkeypatch.setattr(identity, "wall_utc", lambda: now() + ahead[0])

    async def act(here):
        here.add_users()
        cookie = here.session("viewer")
        for minutes, expected in ((29, 200), (58, 200), (89, 401)):
            ahead[0] = timedelta(minutes=minutes)
            assert (await here.ask("GET", "/api/v1/me", cookie=cookie)).status == expected

    with_station(tmp_path, act, idle=timedelta(minutes=30))


def test_a_page_that_asks_by_itself_does_not_keep_a_session(tmp_path, monkeypatch):
    now, ahead = identity.wall_utc, [timedelta()]
    monkeypatch.setattr(identity, "wall_utc", lambda: now() + ahead[0])

    async def act(here):
        here.add_users()
        cookie = here.session("viewer")
        for minutes, expected in ((29, 204), (58, 401)):
            ahead[0] = timedelta(minutes=minutes)
            answer = await here.ask("GET", "/alerts/open", headers={"bench-poll": "true"}, cookie=cookie)
            assert answer.status == expected

    with_station(tmp_path, act, idle=timedelta(minutes=30))


def test_cookies_are_bound_to_the_host_behind_tls(tmp_path):
    async def act(here):
        here.add_users()
        login = {"name": "viewer", "password": PASSWORD}
        answer = await here.ask("POST", "/api/v1/login", content=login, headers={"origin": "https://localhost:8421"})
        given = answer.headers["set-cookie"]
        assert given.startswith("__Host-bench_session=")
        for word in ("HttpOnly", "Path=/", "SameSite=strict", "Secure"):
            assert word in given
        assert "Domain" not in given
        secret = given.partition("=")[2].partition(";")[0]
        assert (await here.ask("GET", "/api/v1/me", cookie=secret)).status == 200
        plain = {"cookie": f"bench_session={secret}"}
        assert (await here.ask("GET", "/api/v1/me", headers=plain)).status == 401
        twice = {"cookie": f"__Host-bench_session={secret}; __Host-bench_session={secret}"}
        assert (await here.ask("GET", "/api/v1/me", headers=twice)).status == 401
        ended = await here.ask("POST", "/api/v1/logout", cookie=secret)
        assert "Secure" in ended.headers["set-cookie"]

    with_station(tmp_path, act, secure=True)


def test_the_code_is_good_once_on_this_computer_only(tmp_path):
    async def act(here):
        own = {"origin": "http://localhost:8421"}
        code = {"code": here.identity.new_code()}
        away = await here.ask("POST", "/api/v1/login/code", content=code, headers=own, address="10.0.0.7")
        renamed = {"host": "bench.lab", "origin": "http://bench.lab"}
        proxied = await here.ask("POST", "/api/v1/login/code", content=code, headers=renamed)
        assert (away.status, proxied.status) == (403, 403)
        assert (await here.ask("POST", "/api/v1/login/code", content=code, headers=own)).status == 200
        assert (await here.ask("POST", "/api/v1/login/code", content=code, headers=own)).status == 422

    with_station(tmp_path, act)


def test_the_number_of_tokens_is_limited(tmp_path):
    async def act(here):
        for _ in range(99):
            here.identity.new_token(TERMINAL, "t", (), 1)
        with pytest.raises(InputError, match="revoke some"):
            here.identity.new_token(TERMINAL, "t", (), 1)

    with_station(tmp_path, act)
