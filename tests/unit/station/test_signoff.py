"""Sign-off: who may decide, about which runs, and what an approval binds."""

import shutil
from datetime import date

import pytest
import yaml

from bench.config.laboratory import CertificateFields, LaboratoryFile, missing_fields
from bench.errors import InputError
from bench.report.approval import APPROVAL
from bench.report.revision import verify
from bench.station.signoff import SignOff, write_approved
from bench.station.storage.database import Database
from bench.store.runs import summary
from bench.store.seal import file_hash, read_seal
from tests.support.how_to import FOLDER, blocks
from tests.support.how_to import LABORATORY as HOW_TO_LABORATORY

(_TEXT,) = (text for _, text in blocks(FOLDER / "station.md") if text.startswith(HOW_TO_LABORATORY))
LABORATORY = LaboratoryFile.model_validate(yaml.safe_load(_TEXT))


@pytest.fixture
def sign_off(tmp_path):
    database = Database(tmp_path / "station")
    yield SignOff(database, "L3", LABORATORY)
    database.close()


@pytest.fixture
def run(smoke_copy):
    return summary(smoke_copy)


def approved(sign_off, run, by="boris", **more):
    number, signed = sign_off.begin(run, by, "looked at", **more)
    binds = write_approved(run.path, signed, LABORATORY, CertificateFields(customer="Mole & Sons <b>"), "html")
    return sign_off.complete(number, signed, binds)


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
    signed = approved(sign_off, run)
    page = (run.path / "report.html").read_text()
    assert f"<dd>{signed.report}</dd>" in page
    shown = ("Inertial Laboratory", "National Accreditation Body, 0815", "Mole &amp; Sons &lt;b&gt;", "relates only to")
    for text in (*shown, "End of the report"):
        assert text in page
    assert signed.binds == {
        "report.html": file_hash(run.path / "report.html"),
        APPROVAL: file_hash(run.path / APPROVAL),
        "chain": read_seal(run.path).head,
    }
    assert verify(run.path) == []
    assert sign_off.approval(run.id) == signed


def test_a_changed_record_is_not_approved(sign_off, run):
    with (run.path / "results.json").open("a") as results:
        results.write(" ")
    with pytest.raises(InputError, match="DAMAGED and cannot be approved"):
        approved(sign_off, run)
    assert sign_off.approval(run.id) is None
    assert not (run.path / APPROVAL).exists()


def test_a_re_issue_names_what_it_replaces(sign_off, run):
    first = approved(sign_off, run)
    with pytest.raises(InputError, match=first.report):
        sign_off.begin(run, "boris", "again")
    second = approved(sign_off, run, replaces=first.report)
    assert second.report != first.report
    assert f"<dd>{first.report}</dd>" in (run.path / "report.html").read_text()
    assert sign_off.approval(run.id) == second


def test_a_rejection_takes_an_approval_back_and_stays_in_the_list(sign_off, run):
    approved(sign_off, run)
    rejected = sign_off.reject(run, "dora", "the fixture was loose")
    assert sign_off.approval(run.id) is None
    assert sign_off.of_run(run.id)[-1] == rejected


def test_a_number_is_used_once_even_if_the_station_dies_before_the_report(sign_off, run, tmp_path):
    _, lost = sign_off.begin(run, "boris", "first")
    other = tmp_path / "other" / run.id
    shutil.copytree(run.path, other)
    _, next_one = sign_off.begin(summary(other), "boris", "second")
    assert lost.report != next_one.report
    assert sign_off.of_run(run.id) == []


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
