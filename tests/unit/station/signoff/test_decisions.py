"""Sign-off: who may decide, about which runs, and what an approval binds."""

from datetime import date

import pytest

from bench.config.laboratory import CertificateFields, missing_fields
from bench.errors import InputError
from bench.reduce.stored_run import open_run
from bench.report.approval import APPROVAL, approval_of
from bench.report.revision import verify
from bench.report.write import write_report
from bench.station.signoff.decisions import SignOff
from bench.station.storage.database import Database
from bench.store.runs import summary
from bench.store.seal import file_hash, read_seal
from tests.support.signing import LABORATORY, approved, settle_all


@pytest.fixture
def sign_off(tmp_path):
    database = Database(tmp_path / "station")
    yield SignOff(database, "L3", LABORATORY)
    database.close()


@pytest.fixture
def run(smoke_copy):
    return summary(smoke_copy)


@pytest.mark.parametrize("by", ["anna", "ANNA", "carla"])
def test_neither_the_operator_nor_the_submitter_decides(sign_off, run, by):
    with pytest.raises(InputError, match="a second person"):
        sign_off.expect_allowed(run, by, ["anna", "Carla", ""])
    sign_off.expect_allowed(run, "boris", ["anna", "Carla", ""])


@pytest.mark.parametrize("state", ["running", "interrupted", "damaged"])
def test_only_a_sealed_run_is_signed_off(sign_off, run, state):
    with pytest.raises(InputError, match="only a sealed run"):
        sign_off.expect_allowed(type(run)(run.path, state, run.manifest), "boris", [])


def test_an_approval_numbers_the_report_and_binds_what_it_covers(sign_off, run):
    signed = approved(sign_off, run.path)
    page = (run.path / f"report.{signed.report}.html").read_text()
    assert f"<dd>{signed.report}</dd>" in page
    shown = ("Inertial Laboratory", "National Accreditation Body, 0815", "Mole &amp; Sons &lt;b&gt;", "relates only to")
    for text in (*shown, "End of the report"):
        assert text in page
    name = f"report.{signed.report}.html"
    assert signed.binds == {
        name: file_hash(run.path / name),
        APPROVAL: file_hash(run.path / APPROVAL),
        "chain": read_seal(run.path).head,
    }
    assert verify(run.path) == []
    assert sign_off.approval(run.id) == signed


def test_a_changed_record_is_not_approved(sign_off, run):
    with (run.path / "results.json").open("a") as results:
        results.write(" ")
    with pytest.raises(InputError, match="DAMAGED and cannot be approved"):
        approved(sign_off, run.path)
    assert sign_off.approval(run.id) is None
    assert not (run.path / APPROVAL).exists()


def test_a_re_issue_names_what_it_replaces(sign_off, run):
    first = approved(sign_off, run.path)
    with pytest.raises(InputError, match=first.report):
        sign_off.begin(run, "boris", "again")
    second = approved(sign_off, run.path, replaces=first.report)
    assert second.report != first.report
    assert f"<dd>{first.report}</dd>" in (run.path / f"report.{second.report}.html").read_text()
    assert file_hash(run.path / f"report.{first.report}.html") == first.binds[f"report.{first.report}.html"]
    assert sign_off.approval(run.id) == second
    assert verify(run.path) == []


def test_a_rejection_takes_an_approval_back_and_stays_in_the_list(sign_off, run):
    approved(sign_off, run.path)
    rejected = sign_off.reject(run, "dora", "the fixture was loose")
    settle_all(sign_off, run.path.parent)
    assert sign_off.approval(run.id) is None
    assert sign_off.of_run(run.id)[-1] == rejected.signed
    assert approval_of(run.path) is None
    with open_run(run.path) as stored:
        assert 'id="certificate"' not in write_report(stored).read_text()


def test_a_run_is_approved_once_at_a_time(sign_off, run):
    begun = sign_off.begin(run, "boris", "looked at")
    for act in (sign_off.begin, sign_off.reject):
        with pytest.raises(InputError, match="another decision"):
            act(run, "dora", "looked at too")
    with pytest.raises(InputError, match="another decision"):
        sign_off.expect_allowed(run, "dora", [])
    sign_off.drop(begun)
    settle_all(sign_off, run.path.parent)
    sign_off.expect_allowed(run, "dora", [])


def test_two_stations_with_one_prefix_give_different_numbers(tmp_path, sign_off, run):
    first = sign_off.begin(run, "boris", "looked at").signed
    copied = Database(tmp_path / "copied")  # as a backup that was made before
    second = SignOff(copied, "L3", LABORATORY).begin(run, "boris", "looked at").signed
    copied.close()
    common = f"L3-{first.at:%Y}-00001-"
    assert first.report.startswith(common)
    assert second.report.startswith(common)
    assert first.report != second.report


def test_a_report_without_an_approval_has_no_certificate(smoke_run):
    page = (smoke_run.path / "report.html").read_text()
    assert 'id="certificate"' not in page
    assert "End of the report" in page


def test_what_a_certificate_lacks_is_listed_in_words():
    fields = CertificateFields(
        customer="Mole", customer_address="2 Hill", model="QF-1", condition="new", received=date(2026, 11, 1)
    )
    run = {"order": "O-1", "ambient": "room 21 °C"}
    assert missing_fields(LABORATORY, fields, run) == []
    lacking = missing_fields(None, CertificateFields(), {})
    assert lacking[0].startswith("the laboratory")
    assert "the date of receipt" in lacking
    assert "the environment" in lacking
