"""Sign-off on the page of a run: who is offered the form, what it does, and what it shows when it is refused."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from urllib.parse import urlencode

import pytest

from bench.report.approval import APPROVAL
from bench.store.seal import file_hash
from tests.support.web import PASSWORD, with_signers

FORM = "application/x-www-form-urlencoded"
HOSTILE = "<script>alert('QF')</script>&\"'"


async def look(here, run, by, language="en"):
    headers = {"accept": "text/html", "accept-language": language}
    answer = await here.ask("GET", f"/runs/{run}", cookie=here.session(by), headers=headers)
    assert answer.status == 200
    return answer.body.decode()


async def send(here, run, by, **fields):
    form = {"decision": "approved", "comment": "looked at", "password": PASSWORD, **fields}
    return await here.ask(
        "POST", f"/runs/{run}/sign-off", cookie=here.session(by), body=urlencode(form).encode(),
        headers={"content-type": FORM, "accept": "text/html"},
    )  # fmt: skip


def offers_form(page):
    return 'name="decision" value="approved"' in page


@pytest.mark.parametrize(
    ("by", "offered", "says"),
    [
        ("engineer", True, "Nobody has decided"),
        ("A. Technician", False, "a second person decides about it"),
        ("operator", False, "A second person decides"),
        ("viewer", False, "A second person decides"),
    ],
)
def test_the_form_is_offered_only_to_a_second_person(tmp_path, smoke_copy, by, offered, says):
    async def act(here):
        page = await look(here, smoke_copy.name, by)
        assert (offers_form(page), says in page) == (offered, True)
        assert "the address of the customer" in page

    with_signers(tmp_path, act)


@pytest.mark.lengthy
@pytest.mark.leaves("the worker process that writes the report")
def test_an_approval_releases_report_and_calibration_files_until_they_are_changed(tmp_path, tumble_run):
    folder = Path(shutil.copytree(tumble_run.path, tmp_path / "runs" / tumble_run.path.name))

    async def act(here):
        run = folder.name
        answer = await send(here, run, "engineer", customer="Mole & Sons", received="2026-11-02", remarks="one\r\ntwo")
        assert (answer.status, answer.headers["location"]) == (303, f"/runs/{run}#sign-off"), answer.body
        (signed,) = here.daemon.sign_off.of_run(run)
        (entry,) = (each for each in here.audit.entries() if each["action"] == "approve")
        assert (entry["who"], entry["report"]) == ("engineer", signed.report)
        page = await look(here, run, "viewer")
        assert f"Approved as {signed.report} by engineer" in page
        name = f"report.{signed.report}.html"
        assert signed.binds[name] == file_hash(folder / name)
        for digest in signed.binds.values():
            assert digest in page
        assert f'files/{name}" download>{name}</a> ✓ released' in page
        assert 'files/calibration_a.json" download>calibration_a.json</a> ✓ released' in page
        assert "the date of receipt" not in page
        assert "the environment" in page
        written = await here.ask("POST", f"/api/v1/runs/{run}/report?form=html", token=here.token)
        assert (written.status, signed.report in written.json()["detail"]) == (422, True)
        again = await look(here, run, "engineer")
        assert f'action="/runs/{run}/pdf"' not in again
        assert f'action="/runs/{run}/html"' not in again
        assert f'name="replaces" value="{signed.report}"' in again
        assert 'value="Mole &amp; Sons"' in again
        assert f'action="/runs/{run}/reduce"' in again
        (folder / name).write_text("another")
        changed = await look(here, run, "viewer")
        assert f"{name} is not the file that was approved" in changed
        assert f"download>{name}</a> ✓ released" not in changed
        answer = await send(here, run, "engineer", replaces=signed.report, language="zh", customer="Mole & Sons")
        assert answer.status == 303, answer.body
        _, second = here.daemon.sign_off.of_run(run)
        assert f"<dt>替代</dt><dd>{signed.report}</dd>" in (folder / f"report.{second.report}.html").read_text()
        shown = await look(here, run, "viewer")
        assert f"replaced by {second.report}" in shown
        assert f"Approved as {second.report} by engineer" in shown
        assert (await send(here, run, "engineer", decision="rejected", replaces=second.report)).status == 303
        assert "taken back" in await look(here, run, "viewer")
        assert not (folder / APPROVAL).exists()
        written = await here.ask("POST", f"/api/v1/runs/{run}/report?form=html", token=here.token)
        assert written.status == 202

    with_signers(tmp_path, act)


def test_a_rejection_has_an_entry_in_the_audit_and_is_shown_with_its_comment(tmp_path, smoke_copy):
    async def act(here):
        assert (await send(here, smoke_copy.name, "engineer", decision="rejected", comment=HOSTILE)).status == 303
        (entry,) = (each for each in here.audit.entries() if each["action"] == "reject")
        assert (entry["who"], entry["reason"]) == ("engineer", HOSTILE)
        page = await look(here, smoke_copy.name, "viewer", "zh")
        assert "已驳回" in page
        assert "&lt;script&gt;alert" in page
        assert "<script>alert" not in page

    with_signers(tmp_path, act)


@pytest.mark.parametrize(
    ("by", "fields", "says"),
    [
        ("engineer", {"password": "wrong password"}, "name or password is wrong"),
        ("engineer", {"comment": ""}, "comment: "),
        ("engineer", {"received": "yesterday"}, "received: "),
        ("engineer", {"decision": "maybe"}, "decision: "),
        ("engineer", {"replaces": "R-2026-00009"}, "has no approved report R-2026-00009"),
        ("A. Technician", {}, "a second person decides about it"),
    ],
)
def test_what_is_refused_is_said_on_the_page_and_what_was_entered_stays(tmp_path, smoke_copy, by, fields, says):
    async def act(here):
        answer = await send(here, smoke_copy.name, by, customer=HOSTILE, **fields)
        page = answer.body.decode()
        assert answer.status == 422
        (reason,) = re.findall(r'id="refused">✗ Nothing was decided: ([^<]*)', page)
        assert says in reason
        assert "<script>alert" not in page
        assert offers_form(page) == ("&lt;script&gt;alert" in page) == (by == "engineer")
        assert PASSWORD not in page
        assert "wrong password" not in page.replace("name or password is wrong", "")
        assert here.daemon.sign_off.of_run(smoke_copy.name) == []
        assert [each for each in here.audit.entries() if each["action"] in ("approve", "reject")] == []

    with_signers(tmp_path, act)


def test_an_operator_is_refused(tmp_path, smoke_copy):
    async def act(here):
        assert (await send(here, smoke_copy.name, "operator")).status == 403
        assert here.daemon.sign_off.of_run(smoke_copy.name) == []

    with_signers(tmp_path, act)
