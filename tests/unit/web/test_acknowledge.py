"""A latch is acknowledged through the API by who may do so, with a reason, and the audit has it."""

from __future__ import annotations

import json
import re

import pytest

from bench.store.latch import INCIDENT, latch
from bench.store.runs import summary
from tests.support.web import with_station


@pytest.fixture
def latched(smoke_copy):
    (smoke_copy / INCIDENT).write_text(json.dumps({"event": "begins", "why": "the run hung"}) + "\n")
    assert latch(summary(smoke_copy)) is not None
    return smoke_copy


def asked(tmp_path, run, by="engineer", **content):
    found = []

    async def ask(here):
        here.add_users()
        path = f"/api/v1/runs/{run.name}/acknowledge"
        answer = await here.ask("POST", path, cookie=here.session(by), content=content)
        found.extend([answer, [(each["action"], each.get("reason")) for each in here.audit.entries()]])

    with_station(tmp_path, ask)
    return found


def test_an_engineer_acknowledges_a_latched_run(tmp_path, latched):
    answer, entries = asked(tmp_path, latched, reason="looked at the bench: all off")
    assert answer.status == 200, answer.body
    assert "the run hung" in answer.json()["answer"]
    assert latch(summary(latched)) is None
    assert entries == [("acknowledge", "looked at the bench: all off")]


@pytest.mark.parametrize(
    ("by", "content", "status"),
    [("operator", {"reason": "x"}, 403), ("engineer", {}, 422), ("engineer", {"reason": " "}, 422)],
)
def test_without_the_right_or_a_reason_it_stays_latched(tmp_path, latched, by, content, status):
    answer, entries = asked(tmp_path, latched, by, **content)
    assert answer.status == status
    assert entries == []
    assert latch(summary(latched)) is not None


def test_a_run_that_is_not_latched_is_refused_and_the_refusal_is_in_the_audit(tmp_path, smoke_copy):
    answer, entries = asked(tmp_path, smoke_copy, reason="to be sure")
    assert answer.status == 422
    assert [action for action, _ in entries] == ["acknowledge", "acknowledge refused"]


def test_the_form_survives_updates_of_the_page_whatever_the_units_name(tmp_path, latched):
    """The id of what is preserved goes into a selector, where a dot would begin a class."""
    run = latched.rename(latched.with_name(f"{latched.name}.15"))
    found = []

    async def ask(here):
        here.add_users()
        found.append((await here.ask("GET", "/instruments", cookie=here.session("engineer"))).body.decode())

    with_station(tmp_path, ask)
    assert f'name="run" value="{run.name}"' in found[0]
    (kept,) = re.findall(r'hx-preserve id="([^"]+)"', found[0])
    assert re.fullmatch(r"[a-z][a-z0-9-]*", kept)
