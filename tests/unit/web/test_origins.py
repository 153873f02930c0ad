"""Which hosts and origins are admitted, against tables written by hand."""

from __future__ import annotations

from itertools import product

import pytest

from tests.support.web import PASSWORD, called, with_station

OWN = "http://localhost:8421"
METHODS = ("GET", "POST")
ORIGINS = (
    None, OWN, "http://localhost:9999", "http://evil.example", "https://localhost:8421", "null", "",
    "http://localhost:8421.evil.example",
)  # fmt: skip
REFERERS = (None, f"{OWN}/queue", "http://evil.example/")
SITES = (None, "same-origin", "same-site", "cross-site", "none")
COOKIES = TOKENS = ("none", "right", "wrong")

# The first line that fits counts; * is anything. Referer is never looked at.
RULES = """
method  token   cookie  site         origin   result
*       right   *       *            *        done
*       wrong   *       *            *        401
GET     *       *       same-site    *        403
GET     *       *       cross-site   *        403
GET     *       right   *            *        done
GET     *       *       *            *        401
POST    *       right   -            own      done
POST    *       right   same-origin  own      done
POST    *       *       -            own      401
POST    *       *       same-origin  own      401
POST    *       *       *            *        403
"""
TABLE = [line.split() for line in RULES.strip().splitlines()[1:]]


def expected(method, token, cookie, site, origin):
    row = (method, token, cookie, site or "-", "own" if origin == OWN else "foreign")
    for *rule, result in TABLE:
        if not [pair for pair in zip(rule, row, strict=True) if pair[0] not in ("*", pair[1])]:
            return result
    raise AssertionError(row)


def test_browsers_act_for_pages_of_the_station_only(tmp_path):
    wrong, rows = [], list(product(METHODS, TOKENS, COOKIES, SITES, ORIGINS, REFERERS))
    assert len(rows) == 2160

    async def act(here):
        here.add_users()
        path = f"/api/v1/runs/{here.run.path.name}"
        secrets = {"none": None, "right": here.session("operator"), "wrong": "x" * 43}
        bearers = {"none": None, "right": f"Bearer {here.token}", "wrong": "Bearer bench_x"}
        for method, token, cookie, site, origin, referer in rows:
            headers = {
                "sec-fetch-site": site, "origin": origin, "referer": referer, "authorization": bearers[token],
                "cookie": f"bench_session={secrets[cookie]}" if secrets[cookie] else None,
            }  # fmt: skip
            here.heard.clear()
            answer = await here.ask(method, path if method == "GET" else f"{path}/abort", headers=headers)
            result = "done" if answer.status == 200 else str(answer.status)
            heard = len(here.heard)
            wanted = expected(method, token, cookie, site, origin)
            if result != wanted or heard != (method == "POST" and wanted == "done"):
                wrong.append((method, token, cookie, site, origin, referer, result, heard))

    with_station(tmp_path, act)
    assert wrong == []


ALLOWED = ["localhost", "LocalHost", "127.0.0.1", "[::1]", "bench.lab", "BENCH.LAB"]
NAMES = (
    "", " ", "localhost.", ".localhost", "localhost..", "evil.example", "localhost.evil.example", "evil-localhost",
    "bench.lab.", "bench.lab.evil.example", "xbench.lab", "bench.labx", "127.0.0.1.nip.io", "127.0.0.2", "127.1",
    "2130706433", "0x7f000001", "0177.0.0.1", "0.0.0.0", "127.0.0.1.", "::1", "[::1", "::1]", "[::]",
    "[::ffff:127.0.0.1]",
    "[::1%lo]", "[0:0:0:0:0:0:0:1]", "[localhost]", "user@localhost", "localhost@evil.example",
    "evil.example@localhost",
    "localhost/", "localhost/x", "localhost?x", "localhost#x", "localhost\\", "local\thost", "localhost\t",
    " localhost",
    "localhost ", "localhost,evil.example", "localhost;evil", "http://localhost", "//localhost", "localhost%00",
    "localhost%2eevil", "lo\u00adcalhost", "loc\u00e0lhost", "localhost\u00a0", "192.168.0.10", "*", "localhost:*",
)  # fmt: skip
PORTS = (
    ":",
    ":x",
    ":80x",
    ":-1",
    ":+80",
    ":8421:80",
    ":999999",
    ": 80",
    ":80 ",
    ":\u00b2",
    ":0x50",
    ":80@evil.example",
)
GOOD_PORTS = ("", ":80", ":8421", ":65535", ":1")


def hosts():
    yield from ((f"{name}{port}", True) for name, port in product(ALLOWED, GOOD_PORTS))
    yield from ((f"{name}{port}", False) for name, port in product(NAMES, ("", ":8421")))
    yield from ((f"{name}{port}", False) for name, port in product(ALLOWED, PORTS))


def test_only_the_hosts_of_the_station_are_answered(tmp_path):
    rows = list(hosts())
    assert len(rows) >= 200
    wrong = []

    async def act(here):
        for host, allowed in rows:
            answer = await here.ask("GET", "/health", headers={"host": host})
            if answer.status != (200 if allowed else 421):
                wrong.append((host, answer.status))
        for many in ([], [b"localhost", b"localhost"], [b"localhost", b"evil.example"]):
            headers = [(b"host", each) for each in many]
            assert (await called(here.app, "GET", "/health", headers, [b""])).status == 421

    with_station(tmp_path, act)
    assert wrong == []


@pytest.mark.parametrize("origin", [None, "null", "http://evil.example", "http://localhost:9999"])
def test_another_site_cannot_log_a_visitor_in(tmp_path, origin):
    async def act(here):
        here.add_users()
        right = {"name": "operator", "password": PASSWORD}
        answer = await here.ask("POST", "/api/v1/login", content=right, headers={"origin": origin})
        assert (answer.status, answer.headers.get("set-cookie")) == (403, None)

    with_station(tmp_path, act)


def test_a_page_of_the_station_may_be_opened_from_elsewhere_but_not_fetched(tmp_path):
    async def act(here):
        here.add_users()
        cookie = here.session("viewer")
        opened = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate", "sec-fetch-dest": "document"}
        assert (await here.ask("GET", "/api/v1/me", cookie=cookie, headers=opened)).status == 200
        for dest in ("image", "iframe", "script", "empty"):
            headers = {**opened, "sec-fetch-dest": dest}
            assert (await here.ask("GET", "/api/v1/me", cookie=cookie, headers=headers)).status == 403

    with_station(tmp_path, act)


def test_all_answers_have_the_headers_that_keep_browsers_safe(tmp_path):
    async def act(here):
        for path, status in (("/health", 200), ("/none", 404), ("/api/v1/me", 401)):
            answer = await here.ask("GET", path)
            assert answer.status == status
            assert "default-src 'self'" in answer.headers["content-security-policy"]
            assert answer.headers["x-content-type-options"] == "nosniff"
            assert "strict-transport-security" not in answer.headers
            assert not [name for name in answer.headers if name.startswith("access-control")]

    async def secured(here):
        assert "max-age=" in (await here.ask("GET", "/health")).headers["strict-transport-security"]

    with_station(tmp_path / "a", act)
    with_station(tmp_path / "b", secured, secure=True)
