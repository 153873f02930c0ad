"""A station that dies during an approval: there is one, or none, and its number is used once."""

import subprocess
import sys

import pytest

from bench.report.approval import APPROVAL, approval_of
from bench.report.revision import is_issued, verify
from bench.station.runs.record_files import files_of
from bench.station.signoff.decisions import SignOff
from bench.station.signoff.files import STAGED, write_staged
from bench.station.storage.database import Database
from bench.store.runs import summary
from bench.store.seal import file_hash
from tests.support.runs import ROOT
from tests.support.signing import ISSUE, LABORATORY, approved, settle_all


def after_a_restart(folder):
    """Start a station again; return the approval of its run, its directory, and the number of the next approval."""
    (run,) = (folder / "runs").iterdir()
    database = Database(folder)
    sign_off = SignOff(database, "L3", LABORATORY)
    settle_all(sign_off, folder / "runs")
    assert sign_off.pending() == []
    found = sign_off.approval(run.name)
    assert STAGED not in {each.suffix for each in run.iterdir()}
    next_one = approved(sign_off, run, replaces=found.report if found else "").report
    database.close()
    return found, run, next_one


def test_an_approval_that_was_begun_is_none_after_a_restart_and_its_number_is_not_used_again(tmp_path, smoke_copy):
    database = Database(tmp_path)
    begun = SignOff(database, "L3", LABORATORY).begin(summary(smoke_copy), "boris", "looked at")
    write_staged(smoke_copy, begun.signed, ISSUE)
    assert {each.name for each in smoke_copy.iterdir() if "report.L3" in each.name} == {
        f"report.{begun.signed.report}.html{STAGED}"
    }
    database.close()
    found, run, next_one = after_a_restart(tmp_path)
    assert found is None
    assert not (run / f"report.{begun.signed.report}.html").exists()
    assert next_one.split("-")[2] == "00002"


def test_an_approval_that_counts_has_its_files_after_a_restart(tmp_path, smoke_copy):
    database = Database(tmp_path)
    sign_off = SignOff(database, "L3", LABORATORY)
    begun = sign_off.begin(summary(smoke_copy), "boris", "looked at")
    signed = sign_off.decide(begun, write_staged(smoke_copy, begun.signed, ISSUE)).signed
    database.close()
    database = Database(tmp_path)
    sign_off = SignOff(database, "L3", LABORATORY)
    settle_all(sign_off, smoke_copy.parent)
    assert sign_off.approval(smoke_copy.name) == signed
    for name in (f"report.{signed.report}.html", APPROVAL):
        assert file_hash(smoke_copy / name) == signed.binds[name]
    assert verify(smoke_copy) == []
    database.close()


@pytest.mark.slow
def test_kill_9_at_every_change_of_a_file_leaves_one_approval_with_its_files(tmp_path, smoke_run):
    subprocess.run([sys.executable, "-m", "tests.support.signing", smoke_run.path, tmp_path], check=True, cwd=ROOT)
    folders, found = sorted(tmp_path.iterdir(), key=lambda each: int(each.name)), []
    assert len(folders) > 10
    for folder in folders:
        (run,) = (folder / "runs").iterdir()
        database = Database(folder)
        sign_off = SignOff(database, "L3", LABORATORY)
        settle_all(sign_off, folder / "runs")
        decisions = sign_off.of_run(run.name)
        for name in (f"report.{decisions[-1].report}.html", APPROVAL):
            assert file_hash(run / name) == decisions[-1].binds[name], folder
        assert approval_of(run)["report"] == decisions[-1].report
        issued = {each.name for each in run.iterdir() if is_issued(each.name)}
        assert issued == {f"report.{each.report}.html" for each in decisions}, folder
        assert STAGED not in {each.suffix for each in run.iterdir()}
        assert issued <= {each.name for each in files_of(summary(run))}, folder
        assert verify(run) == [], folder
        database.close()
        found.append(len(decisions))
    assert found == sorted(found), "once approved, it stays approved"
    assert (found.count(1) > 4, found.count(2) > 4) == (True, True)
