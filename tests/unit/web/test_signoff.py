"""Sign-off through the API: a second person, the password again, and an entry in the audit."""

from __future__ import annotations

import pytest

from bench.report.approval import APPROVAL
from bench.store.runs import summary
from bench.web.api.signoff import facts_of
from tests.support.web import PASSWORD, with_signers


async def decide(here, by, run, decision="approved", password=PASSWORD, **more):
    content = {"decision": decision, "comment": "looked at", "password": password, **more}
    return await here.ask("POST", f"/api/v1/runs/{run}/sign-off", cookie=here.session(by), content=content)


@pytest.mark.lengthy
@pytest.mark.leaves("the worker process that writes the report")
def test_a_second_person_approves_and_the_audit_has_it(tmp_path, smoke_copy):
    async def act(here):
        run = smoke_copy.name
        before = (await here.ask("GET", f"/api/v1/runs/{run}/sign-off", token=here.token)).json()
        assert (before["approved"], before["decisions"]) == (False, [])
        assert "the customer" in before["missing"]
        answer = await decide(here, "engineer", run, fields={"customer": "Mole & Sons"})
        assert answer.status == 201, answer.body
        signed = answer.json()
        assert signed["binds"].keys() >= {f"report.{signed['report']}.html", APPROVAL, "chain"}
        entry = next(each for each in here.audit.entries() if each["action"] == "approve")
        assert (entry["report"], entry["reason"], entry["who"]) == (signed["report"], "looked at", "engineer")
        again = await decide(here, "engineer", run)
        assert again.status == 422
        assert signed["report"] in again.json()["detail"]

    with_signers(tmp_path, act)


@pytest.mark.parametrize(
    ("by", "password", "status", "why"),
    [
        ("A. Technician", PASSWORD, 422, "a second person"),
        ("engineer", "wrong password", 422, "wrong"),
        ("operator", PASSWORD, 403, "approve"),
    ],
)
def test_who_may_not_decide_is_refused_without_a_trace(tmp_path, smoke_copy, by, password, status, why):
    async def act(here):
        answer = await decide(here, by, smoke_copy.name, password=password)
        assert answer.status == status
        assert why in answer.json()["detail"]
        assert here.daemon.sign_off.of_run(smoke_copy.name) == []
        assert [each for each in here.audit.entries() if each["action"] in ("approve", "reject")] == []

    with_signers(tmp_path, act)


def test_a_rejection_is_kept_with_its_reason(tmp_path, smoke_copy):
    async def act(here):
        assert (await decide(here, "engineer", smoke_copy.name, "rejected")).status == 201
        (found,) = here.daemon.sign_off.of_run(smoke_copy.name)
        assert (found.decision, found.comment) == ("rejected", "looked at")
        assert not (smoke_copy / APPROVAL).exists()

    with_signers(tmp_path, act)


def test_ambient_conditions_of_a_run_are_a_fact_for_its_certificate(smoke_copy):
    assert facts_of(summary(smoke_copy))["ambient"] == ""
    bench = smoke_copy / "bench.yaml"
    zone = "time_zone: Asia/Shanghai\n"
    bench.write_text(bench.read_text("utf-8").replace(zone, f"{zone}  ambient: [unit_temperature]\n"), "utf-8")
    ambient = facts_of(summary(smoke_copy))["ambient"]
    assert ambient.startswith("unit temperature ")
    assert "U = 0.6" in ambient
    bench.write_text("damaged")
    assert facts_of(summary(smoke_copy))["ambient"] == ""
