"""The audit: what changes something has an entry or does not happen, and every change of entries is found."""

from __future__ import annotations

import random

import pytest

from bench.errors import InputError
from bench.station.queue.items import Submission
from bench.station.storage.audit import BEGINNING, _head
from bench.station.worker import Checked
from bench.web.access import Person, routes_of
from tests.support.web import PASSWORD, TERMINAL, with_station

ITEM = {"sequence": "smoke", "bench": "demo"}
# Routes that change something: path, content, and how it begins.
ACTIONS = {
    "POST /queue/{id_}/{action}": ("/queue/ITEM/clone", None),
    "POST /benches/{bench}/go-on": ("/benches/demo/go-on", None),
    "POST /runs/{run}/go/{command}": ("/runs/RUN/go/resume", None),
    "POST /api/v1/queue": ("/api/v1/queue", ITEM),
    "POST /api/v1/queue/{id_}/hold": ("/api/v1/queue/ITEM/hold", {"reason": "lunch"}),
    "POST /api/v1/queue/{id_}/release": ("/api/v1/queue/ITEM/release", {}),
    "POST /api/v1/queue/{id_}/move": ("/api/v1/queue/ITEM/move", {}),
    "POST /api/v1/queue/{id_}/clone": ("/api/v1/queue/ITEM/clone", None),
    "POST /api/v1/queue/{id_}/cancel": ("/api/v1/queue/ITEM/cancel", {}),
    "POST /api/v1/benches/{bench}/go-on": ("/api/v1/benches/demo/go-on?reason=looked+at+it", None),
    "PUT /api/v1/benches/{bench}/lease": ("/api/v1/benches/demo/lease", {"note": "tuning"}),
    "DELETE /api/v1/benches/{bench}/lease": ("/api/v1/benches/demo/lease", None),
    "POST /api/v1/benches/{bench}/lease/take-over": ("/api/v1/benches/demo/lease/take-over", {"note": "fire"}),
    "POST /api/v1/runs/{run}/pause": ("/api/v1/runs/RUN/pause?reason=noise", None),
    "POST /api/v1/runs/{run}/resume": ("/api/v1/runs/RUN/resume", None),
    "POST /api/v1/runs/{run}/skip": ("/api/v1/runs/RUN/skip", None),
    "POST /api/v1/runs/{run}/repeat": ("/api/v1/runs/RUN/repeat", None),
    "POST /api/v1/runs/{run}/orders": ("/api/v1/runs/RUN/orders", {"order": {"move": "head", "to": "90 °"}}),
    "POST /api/v1/runs/{run}/orders/finish": ("/api/v1/runs/RUN/orders/finish", None),
    "POST /api/v1/runs/{run}/answer": ("/api/v1/runs/RUN/answer", {"answer": "yes"}),
    "POST /api/v1/releases": ("/api/v1/releases", {"submission": ITEM, "comment": "tried"}),
    "POST /api/v1/login": ("/api/v1/login", {"name": "viewer", "password": PASSWORD}),
    "POST /api/v1/login/code": ("/api/v1/login/code", {"code": "CODE"}),
    "POST /api/v1/logout": ("/api/v1/logout", None),
    "PUT /api/v1/users/{name}": ("/api/v1/users/ben", {"role": "viewer", "password": PASSWORD}),
    "DELETE /api/v1/users/{name}": ("/api/v1/users/operator", None),
    "POST /api/v1/tokens": ("/api/v1/tokens", {"label": "t", "scopes": ["read"]}),
    "DELETE /api/v1/tokens/{id_}": ("/api/v1/tokens/TOKEN", None),
}
FIRST = {
    "POST /api/v1/runs/{run}/stop": ("/api/v1/runs/RUN/stop?reason=smoke", None),
    "POST /api/v1/runs/{run}/orders/halt": ("/api/v1/runs/RUN/orders/halt", {"device": "head"}),
    "POST /runs/{run}/do/{command}": ("/runs/RUN/do/abort", None),
    "POST /api/v1/runs/{run}/abort": ("/api/v1/runs/RUN/abort?reason=fire", None),
}
CHANGE_NOTHING = {
    "POST /api/v1/check", "POST /api/v1/releases/difference", "POST /api/v1/before-run", "POST /appearance",
    "POST /api/v1/completion", "POST /api/v1/sequences/{name}/check", "POST /sequences/{name}/check",
}  # fmt: skip
# Forms of pages that call what the API does, and what needs a sealed run, a worker or routes of alerts.
ELSEWHERE = {
    "POST /api/v1/runs/{run}/acknowledge",
    "POST /login", "POST /logout", "POST /start", "POST /start/rehearsal", "POST /runs/{run}/{action}",
    "POST /runs/{run}/answer", "POST /api/v1/runs/{run}/sign-off", "POST /api/v1/runs/{run}/report",
    "POST /api/v1/runs/{run}/reduction", "POST /api/v1/runs/{run}/resumption", "POST /api/v1/rehearsals",
    "PUT /api/v1/sequences/{name}", "POST /sequences/{name}/edit", "POST /sequences/{name}/copy",
    "POST /api/v1/releases/sequence/{name}", "POST /api/v1/releases/bench/{name}", "POST /sequences/{name}/release",
    "POST /bench-files/{bench}/release",
    "POST /api/v1/alerts/test", "POST /api/v1/alerts/{id_}/acknowledge", "POST /runs/{run}/sign-off",
    "POST /api/v1/benches/{bench}/manual", "POST /benches/{bench}/manual", "POST /api/v1/runs/{run}/orders/alive",
    "POST /manual/{run}/alive", "POST /manual/{run}/order", "POST /manual/{run}/halt", "POST /manual/{run}/finish",
    "POST /instruments/acknowledge",
    "POST /alerts/test", "POST /alerts/{id_}/acknowledge",
}  # fmt: skip


async def act(here, route):
    """Do what a route does; return its answer."""
    path, content = (ACTIONS | FIRST)[route]
    item = here.daemon.queue.items()[0]
    token = next((each["id"] for each in here.identity.tokens() if each["label"] == "other"), "")
    path = path.replace("TOKEN", token).replace("ITEM", item.id).replace("RUN", here.run.path.name)
    if content and content.get("code") == "CODE":
        content = {"code": here.identity.new_code()}
    own = {"origin": "http://localhost:8421"}
    return await here.ask(route.split()[0], path, token=here.token, content=content, headers=own)


def prepare(here):
    """Let there be users and an item; checks are as good as instantaneous."""
    here.add_users()
    here.identity.new_token(TERMINAL, "other", (), 1)
    here.daemon.queue.submit(Submission(**ITEM), "anna")

    async def checked(_):
        return Checked(inputs={"sequence.yaml": "", "bench.yaml": ""})

    here.daemon.checked = checked


def test_each_route_that_changes_something_is_in_the_tables(tmp_path):
    async def look(here):
        routes = {f"{method} {each.path}" for each in routes_of(here.app._app.routes) for method in each.methods}
        changing = {each for each in routes if not each.startswith(("GET ", "HEAD "))}
        assert changing == ACTIONS.keys() | FIRST.keys() | CHANGE_NOTHING | ELSEWHERE, "say how the audit knows of it"

    with_station(tmp_path, look)


def test_each_action_has_one_entry_with_sender_and_address(tmp_path):
    wrong = {}

    async def look(here):
        prepare(here)
        number = 0
        for route in ACTIONS | FIRST:
            answer = await act(here, route)
            new = list(here.audit.entries(after=number))
            number += len(new)
            if answer.status >= 400 or len(new) != 1 or new[0]["address"] != "127.0.0.1" or not new[0]["who"]:
                wrong[route] = answer.status, answer.body, new
        assert here.audit.first_wrong() is None
        entries = {entry["action"]: entry for entry in here.audit.entries()}
        assert entries["hold"]["reason"] == "lunch"
        assert (entries["hold"]["before"], entries["hold"]["after"]) == ("queued", "held")
        assert entries["abort"]["reason"] == "fire"
        assert entries["take over lease"]["reason"] == "fire"
        assert (entries["remove user"]["before"], entries["set user"]["after"]) == ("operator", "viewer")
        assert entries["go on"]["reason"] == "looked at it"

    with_station(tmp_path, look)
    assert wrong == {}


def test_an_action_that_cannot_be_entered_does_not_happen(tmp_path):
    wrong = {}

    async def look(here):
        prepare(here)
        with here.database.transaction() as tables:
            tables.execute("CREATE TRIGGER full BEFORE INSERT ON audit BEGIN SELECT RAISE(ABORT, 'disk full'); END")

        def state():
            tables = [
                here.database.rows(f"SELECT * FROM {name}") for name in ("item", "user", "token", "stopped", "release")
            ]
            return [[tuple(row) for row in rows] for rows in tables], list(here.heard), here.daemon.leases.of("demo")

        for route in ACTIONS:
            before = state()
            answer = await act(here, route)
            if answer.status != 503 or state() != before or "set-cookie" in answer.headers:
                wrong[route] = answer
        assert here.heard == []
        for route in FIRST:
            assert (await act(here, route)).status < 400
        assert [command for command, _ in here.heard] == ["stop", "halt", "abort", "abort"]

    with_station(tmp_path, look)
    assert wrong == {}


def test_an_entry_and_its_change_are_made_together_or_not_at_all(tmp_path):
    async def look(here):
        prepare(here)

        def half() -> None:
            with here.audit.noted(TERMINAL, "set user", "ben"):
                here.identity.set_user("ben", "viewer", PASSWORD)
                here.identity.set_user("ben", "king", PASSWORD)

        with pytest.raises(InputError):
            half()
        assert here.identity.role("ben") is None
        assert list(here.audit.entries()) == []
        here.audit.note(TERMINAL, "after that")
        assert here.audit.first_wrong() is None

    with_station(tmp_path, look)


class Tamperer:
    """Random changes of the table of entries, by somebody who may write it."""

    def __init__(self, seed, rows):
        self.random = random.Random(seed)
        self.rows = rows

    def edit(self, tables):
        number = self.random.randint(1, self.rows)
        column = self.random.choice(("at", "data", "head"))
        text = tables.execute(f"SELECT {column} FROM audit WHERE number = ?", (number,)).fetchone()[0]
        at = self.random.randrange(len(text))
        other = self.random.choice([letter for letter in "abcdef0123456789 \n\0é" if letter != text[at]])
        new = self.random.choice([text[:at] + other + text[at + 1 :], text[:at] + text[at + 1 :], text + " ", ""])
        if new == text:
            new = text + "x"
        tables.execute(f"UPDATE audit SET {column} = ? WHERE number = ?", (new, number))

    def damage(self, tables):
        number = self.random.randint(1, self.rows)
        column = self.random.choice(("at", "data", "head"))
        tables.execute(f"UPDATE audit SET {column} = CAST(x'ff00fe' AS TEXT) WHERE number = ?", (number,))

    def delete(self, tables):
        numbers = self.random.sample(range(1, self.rows + 1), self.random.randint(1, self.rows))
        tables.executemany("DELETE FROM audit WHERE number = ?", [(number,) for number in numbers])

    def reorder(self, tables):
        a, b = self.random.sample(range(1, self.rows + 1), 2)
        for old, new in ((a, 10**6), (b, a), (10**6, b)):
            tables.execute("UPDATE audit SET number = ? WHERE number = ?", (new, old))

    def renumber(self, tables):
        first = self.random.randint(1, self.rows)
        tables.execute("DELETE FROM audit WHERE number = ?", (first,))
        tables.execute("UPDATE audit SET number = number - 1 WHERE number > ?", (first,))

    def truncate(self, tables):
        tables.execute("DELETE FROM audit WHERE number > ?", (self.random.randint(0, self.rows - 1),))

    def rewrite(self, tables):
        """Cut the end off and write another one, with a chain that is right in itself."""
        self.truncate(tables)
        last = tables.execute("SELECT number, head FROM audit ORDER BY number DESC LIMIT 1").fetchone()
        number, head = (last["number"], last["head"]) if last else (0, BEGINNING)
        for each in range(number + 1, self.rows + self.random.randint(0, 3)):
            head = _head(head, "2026-01-01", "{}")
            tables.execute("INSERT INTO audit VALUES (?, ?, ?, ?)", (each, "2026-01-01", "{}", head))


KINDS = ("edit", "damage", "delete", "reorder", "renumber", "truncate", "rewrite")


def test_each_of_a_thousand_changes_is_found(tmp_path):
    missed = []

    async def look(here):
        for number in range(20):
            here.audit.note(Person(f"user {number}", frozenset(), "session"), "hold", f"item {number}", before=number)
        assert here.audit.first_wrong() is None
        for seed in range(1000):
            tamperer = Tamperer(seed, 20)
            kind = KINDS[seed % len(KINDS)]
            with here.database.transaction() as tables:
                tables.execute("SAVEPOINT before")
                getattr(tamperer, kind)(tables)
                if here.audit.first_wrong() is None:
                    missed.append((seed, kind))
                tables.execute("ROLLBACK TO before")
        assert here.audit.first_wrong() is None
        assert (await here.ask("GET", "/api/v1/audit/verify", token=here.token)).json() == {"first_wrong": None}
        with here.database.transaction() as tables:
            tables.execute("DELETE FROM audit WHERE number > 15")
        assert (await here.ask("GET", "/api/v1/audit/verify", token=here.token)).json() == {"first_wrong": 16}
        here.audit.note(TERMINAL, "goes on")
        assert here.audit.first_wrong() == 16

    with_station(tmp_path, look)
    assert missed == []


def test_entries_that_somebody_has_made_unreadable_are_shown_as_such(tmp_path):
    async def look(here):
        here.audit.note(TERMINAL, "hold", "x")
        for data in ("no json", "[1]", "3"):
            with here.database.transaction() as tables:
                tables.execute("UPDATE audit SET data = ?", (data,))
            answer = await here.ask("GET", "/api/v1/audit", token=here.token)
            assert answer.json()[0]["unreadable"] == data
        with here.database.transaction() as tables:
            tables.execute("UPDATE audit SET data = CAST(x'ff' AS TEXT)")
        assert (await here.ask("GET", "/api/v1/audit", token=here.token)).status == 200

    with_station(tmp_path, look)
