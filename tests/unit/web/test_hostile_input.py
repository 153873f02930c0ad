"""Hostile input: no path leads out of the folders of the station, no secret is told, and nothing breaks the station."""

from __future__ import annotations

import os
import random
import sys
from itertools import product
from urllib.parse import quote

import pytest

from bench.station.worker import Checked
from bench.store.user_state import state_folder
from bench.web.access import routes_of
from tests.support.web import with_station

SECRET = "bytes from outside, 7f3a91"
UP = (
    "../",
    "..\\",
    "..%2f",
    "%2e%2e/",
    "%2e%2e%2f",
    "%252e%252e%252f",
    "..%c0%af",
    "..%ef%bc%8f",
    "․․/",
    "..;/",
    "....//",
)
TARGETS = ("outside", "outside/manifest.json", "outside.yaml", "etc/passwd", "proc/self/environ", "station/token")
BEGIN = ("", "/", "//", "./", "runs/", "file://", "~/", "\\\\?\\")
END = ("", "/", "%00", "%00.yaml", ".yaml", "#", "?", " ", "%0d%0a")
ROUTES = (
    ("GET", "/api/v1/runs/{}"), ("GET", "/api/v1/runs/{}/live"), ("GET", "/api/v1/runs/{}/events"),
    ("POST", "/api/v1/runs/{}/abort"), ("POST", "/api/v1/runs/{}/resume"), ("GET", "/api/v1/queue/{}"),
    ("POST", "/api/v1/queue/{}/clone"), ("POST", "/api/v1/benches/{}/go-on"),
    ("POST", "/api/v1/benches/{}/lease/take-over"), ("DELETE", "/api/v1/users/{}"), ("DELETE", "/api/v1/tokens/{}"),
    ("GET", "/api/v1/sequences/{}/text"), ("GET", "/api/v1/sequences/{}/versions"),
)  # fmt: skip
FIELDS = ("sequence", "bench", "preset", "units", "settings", "operator", "order", "procedure", "speed")


def strings():
    for up, target, begin, end, depth in product(UP, TARGETS, BEGIN, END, (1, 3)):
        yield begin + up * depth + target + end


_WATCH: list[set[str] | None] = [None]


def _note(event, arguments):
    if event == "open" and _WATCH[0] is not None and isinstance(arguments[0], str | bytes | os.PathLike):
        _WATCH[0].add(os.path.realpath(os.fsdecode(arguments[0])))


sys.addaudithook(_note)  # notes nothing outside the tests of this file


@pytest.mark.slow
def test_none_of_five_thousand_paths_leads_out_of_the_station(tmp_path):
    chosen = random.Random(1).sample(list(strings()), 5000)
    told, opened = [], set[str]()
    for place in (tmp_path, tmp_path / "a"):
        (place / "outside").mkdir(parents=True)
        (place / "outside/manifest.json").write_text(f'{{"state": "running", "title": "{SECRET}"}}')
        (place / "outside/run.lock").touch()
        (place / "outside.yaml").write_text(SECRET)

    async def act(here):
        (here.run.path.parent / "link").symlink_to(tmp_path / "outside")
        assert (await here.ask("GET", "/api/v1/runs/link", token=here.token)).status == 422
        _WATCH[0] = opened
        assert (await here.ask("GET", f"/api/v1/runs/{here.run.path.name}", token=here.token)).status == 200
        try:
            for number, text in enumerate(chosen):
                method, path = ROUTES[number % len(ROUTES)]
                safe = quote(text, safe="/%;:\\~?#")
                answers = [await here.ask(method, path.format(safe), token=here.token)]
                field = FIELDS[number % len(FIELDS)]
                content = {"sequence": "smoke", "bench": "nowhere"}
                content |= {field: {text: text} if field in ("units", "settings") else text}
                answers.append(await here.ask("POST", "/api/v1/queue", token=here.token, content=content))
                told.extend(
                    (text, answer.status) for answer in answers
                    if SECRET.encode() in answer.body or b"root:" in answer.body or not 300 <= answer.status < 500
                )  # fmt: skip
        finally:
            _WATCH[0] = None
        assert here.heard == []

    with_station(tmp_path / "a/b", act)
    # "?" and "#" at the end of a path leave it; what is left names nothing outside either.
    assert told == []
    allowed = (str(tmp_path / "a/b"), str(state_folder()), *map(os.path.realpath, sys.path), sys.prefix, "/dev")
    assert opened, "nothing was traced"
    assert not [path for path in opened if not path.startswith(allowed)]


def test_no_secret_is_in_answers_entries_logs_or_files(tmp_path, caplog, capfd):
    caplog.set_level(0)
    secrets, seen = set[str](), []

    async def act(here):
        own = {"origin": "http://localhost:8421"}
        code, password = here.identity.new_code(), "canary password 51c2"
        secrets.update({code, code.replace("-", ""), password, here.token})
        shown = await here.ask(
            "PUT", "/api/v1/users/ben", token=here.token, content={"role": "viewer", "password": password}
        )
        login = await here.ask("POST", "/api/v1/login", content={"name": "ben", "password": password}, headers=own)
        cookie = login.headers["set-cookie"].partition("=")[2].partition(";")[0]
        made = await here.ask("POST", "/api/v1/tokens", cookie=cookie, content={"label": "t", "scopes": ["read"]})
        secrets.update({cookie, made.json()["token"]})
        seen.append(login.body + shown.body)
        wrong = [
            ("POST", "/api/v1/login", {"name": password, "password": "x" * 12}),
            ("POST", "/api/v1/login", {"name": "ben", "password": [password]}),
            ("POST", "/api/v1/login", {"name": 3, "password": password}),
            ("POST", "/api/v1/login", [password]),
            ("POST", "/api/v1/login/code", {"code": code + "A"}),
            ("POST", "/api/v1/login/code", {"code": [code]}),
            ("PUT", "/api/v1/users/ben", {"role": "king", "password": password}),
            ("PUT", "/api/v1/users/ben", {"password": password}),
        ]
        for method, path, content in wrong:
            for token in ("", here.token, made.json()["token"]):
                answer = await here.ask(method, path, token=token, content=content, headers=own)
                seen.append(answer.body)
        for method, path in {
            (method, each.path) for each in routes_of(here.app._app.routes) for method in each.methods
        }:
            for how in ({"token": here.token}, {"cookie": cookie}):
                answer = await here.ask(method, path.replace("{", "").replace("}", ""), **how)
                seen.append(answer.body + repr(answer.headers).encode())

    with_station(tmp_path, act)
    seen.append(caplog.text.encode() + "".join(capfd.readouterr()).encode())
    seen.extend(path.read_bytes() for path in tmp_path.rglob("*") if path.is_file())
    seen.extend(path.read_bytes() for path in state_folder().rglob("*") if path.is_file())
    assert len(secrets) == 6
    assert len(seen) > 80
    assert [(secret, part[:200]) for secret in secrets for part in seen if secret.encode() in part] == []


VALUES = (
    None, True, 0, -1, 2**31, 2**63, 2**64, -(2**63), 10**400, 0.5, 1e308, "", " ", "\0", "a\nb", "\x1b[2J", "<script>",
    "‮", "\ufeff", "é" * 70, "x" * 70000, "../x", "'; DROP TABLE audit; --", "{{7*7}}", "%s%n", "٣", "1e9", "nan",
    "2026-01-01T00:00:00", "2026-01-01T00:00:00Z", "9999-12-31T23:59:59-23:00", "0001-01-01T00:00:00+23:00",
    [], [None], {}, {"": ""}, {"a": {"a": {}}}, "smoke", "demo", "viewer", "read", ["read"], "max", "1",
)  # fmt: skip
NAMES = (
    "version", "before", "sequence", "bench", "units", "settings", "speed", "seed", "not_before", "priority", "name",
    "password", "code", "role", "label", "scopes", "days", "answer", "step", "note", "reason", "past_due", "unattended",
    "text", "base", "message", "at", "beside", "digest", "comment",
)  # fmt: skip
QUERIES = ("after", "limit", "text", "state", "before", "all_", "held", "when", "reason", "everywhere", "old", "new")


@pytest.mark.slow
def test_no_input_makes_an_error_of_the_server(tmp_path):
    chosen, failed, statuses = random.Random(2), [], set()

    async def act(here):
        async def checked(_):
            return Checked()

        here.daemon.checked = checked
        every = routes_of(here.app._app.routes)
        routes = sorted((method, each.path) for each in every for method in each.methods - {"HEAD"})
        for number in range(40 * len(routes)):
            method, path = routes[number % len(routes)]
            name = chosen.choice(
                [here.run.path.name, "demo", "none", "%00", "a" * 300, "%ff", "é", "%F0%9F%98%80", "1"]
            )
            while "{" in path:
                path = path[: path.index("{")] + quote(name, safe="%") + path[path.index("}") + 1 :]
            query = "&".join(f"{each}={quote(str(chosen.choice(VALUES))[:2000])}" for each in chosen.sample(QUERIES, 2))
            content = {"sequence": "smoke", "bench": "demo"} if chosen.random() < 0.7 else {}
            content |= {each: chosen.choice(VALUES) for each in chosen.sample(NAMES, chosen.choice((0, 1, 3, 8)))}
            headers = {
                "origin": "http://localhost:8421",
                "last-event-id": str(chosen.choice((1, -1, 10**30, "²", "9" * 5000))),
                "idempotency-key": "k" * chosen.choice((1, 100, 101)),
            }  # fmt: skip
            try:
                answer = await here.ask(method, f"{path}?{query}", token=here.token, content=content, headers=headers)
            except Exception as problem:  # noqa: BLE001  each is what is looked for
                failed.append((method, path, query, content, repr(problem)))
                continue
            statuses.add(answer.status)
            if answer.status >= 500:
                failed.append((method, path, query, content, answer.body))

    with_station(tmp_path, act)
    assert failed == []
    assert statuses >= {200, 201, 204, 422}
