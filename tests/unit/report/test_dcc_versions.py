"""Certificates in later versions of the schema: valid, with the same numbers, each thing in its place."""

import re

import pytest
import yaml

from bench.certificates.certificate import read_certificate
from bench.certificates.signature import verified
from bench.config.load import load_file
from bench.errors import InputError
from bench.report.dcc.versions import DEFAULT, VERSIONS
from bench.report.revision import issued_name
from bench.station.settings import StationFile, read_station
from bench.station.signoff.decisions import SignOff
from bench.station.storage.database import Database
from tests.support.certified import FIELDS, LABORATORY, NUMBER, approve, approved_copy, certificate
from tests.support.dcc import DCC, SI, errors, parsed, quantities, text_of
from tests.support.signing import ISSUE, approved, key_files
from tests.support.signing import LABORATORY as OF_STATION

LATER = [name for name in VERSIONS if name != DEFAULT]
CORE = "administrativeData/coreData"
XSI = "{http://www.w3.org/2001/XMLSchema-instance}"


@pytest.fixture(scope="module")
def made(shared_runs, tmp_path_factory):
    """Directory of certificates VERSION-RUN-LANGUAGE.xml, those of the smoke run signed, and the PEM of the key."""
    folder = tmp_path_factory.mktemp("versions")
    key = key_files(folder)
    runs = {
        "tumble": (approved_copy(shared_runs.tumble().path, folder), None),
        "smoke": (approved_copy(shared_runs.smoke().path, folder), key),
    }
    for version in VERSIONS:
        for name, (run, signing) in runs.items():
            for lang in ("en", "zh"):
                path = folder / f"{version}-{name}-{lang}.xml"
                path.write_bytes(certificate(run, signing, lang, version))
    return folder


def root_of(made, version, run="tumble", lang="en"):
    return parsed((made / f"{version}-{run}-{lang}.xml").read_bytes())


@pytest.mark.parametrize("version", VERSIONS)
def test_they_are_valid_by_the_schemas_of_their_version(made, version):
    assert errors(*made.glob(f"{version}-*.xml")) == []


@pytest.mark.parametrize("version", VERSIONS)
def test_they_name_their_version(made, version):
    root = root_of(made, version)
    assert root.get("schemaVersion") == version
    assert root.get(f"{XSI}schemaLocation") == f"https://ptb.de/dcc https://ptb.de/dcc/v{version}/dcc.xsd"


@pytest.mark.parametrize("lang", ["en", "zh"])
@pytest.mark.parametrize("version", LATER)
def test_every_number_limit_and_word_is_that_of_the_first_version(made, version, lang):
    known, found = (quantities(root_of(made, each, lang=lang)) for each in (DEFAULT, version))
    assert len(known) > 20
    assert found == known
    assert any(each.real.interval for each in found)
    assert sum(each.real.k is not None for each in found) > 20


@pytest.mark.parametrize("version", VERSIONS)
def test_the_reader_of_instruments_reads_the_same_numbers(made, version):
    read = read_certificate(made / f"{version}-tumble-en.xml").quantities
    stated = quantities(root_of(made, version))
    assert len(read) == len(stated)
    for each, other in zip(read, stated, strict=True):
        (value,) = each.values
        assert (float(value.number), value.written) == (other.real.value, other.real.unit)
        assert (float(value.expanded), float(value.k)) == (other.real.uncertainty, other.real.k or 1.0)


@pytest.mark.parametrize(
    ("version", "names", "others"),
    [
        ("3.1.2", ("expandedUnc", "coverageInterval"), ("measurementUncertaintyUnivariate",)),
        ("3.2.1", ("expandedUnc", "coverageInterval"), ("measurementUncertaintyUnivariate",)),
        ("3.3.0", ("expandedMU", "coverageIntervalMU"), ("expandedUnc", "coverageInterval", "uncertainty")),
    ],
)
def test_uncertainties_have_the_elements_of_their_d_si(made, version, names, others):
    root = root_of(made, version)
    assert all(root.find(f".//{SI}{name}") is not None for name in names)
    assert all(root.find(f".//{SI}{name}") is None for name in others)
    around = {each.getparent().tag for name in names for each in root.iterfind(f".//{SI}{name}")}
    assert around == {f"{SI}{'measurementUncertaintyUnivariate' if version == '3.3.0' else 'real'}"}


@pytest.mark.parametrize("version", VERSIONS)
def test_the_signature_has_its_place_and_covers_everything(made, version):
    path, root = made / f"{version}-smoke-en.xml", root_of(made, version, "smoke")
    assert verified(read_certificate(path).markup, made / "approvals.pem").is_expected
    (signature,) = root.iterfind(".//{http://www.w3.org/2000/09/xmldsig#}Signature")
    if version == DEFAULT:
        assert signature.getparent().tag == f"{DCC}comment"
    else:
        assert root[-1] is signature
        assert root.find(f"{DCC}comment") is None
    changed = path.read_bytes().replace(b"QF-0001", b"QF-0002")
    (made / "changed").write_bytes(changed)
    with pytest.raises(InputError, match="has an invalid signature"):
        verified(read_certificate(made / "changed").markup)


@pytest.mark.parametrize("version", LATER)
def test_issue_and_replaced_certificate_are_where_programs_look(smoke_copy, tmp_path, version):
    old = "L3-2026-00001-XXXXX"
    (smoke_copy / issued_name(old, "pdf")).write_bytes(b"%PDF earlier")
    content = certificate(approve(smoke_copy, replaces=old), version=version)
    root = parsed(content)
    assert text_of(root, f"{CORE}/issueDate") == "2026-11-21"
    assert text_of(root, f"{CORE}/reportAmendedSubstituted/typeOfChange") == "substituted"
    assert text_of(root, f"{CORE}/reportAmendedSubstituted/replacedUniqueIdentifier") == f"SIMULATED-{old}"
    (tmp_path / "made.xml").write_bytes(content)
    assert errors(tmp_path / "made.xml") == []


@pytest.mark.parametrize("version", VERSIONS)
def test_what_is_not_stated_or_has_spaces_around_it_is_valid(smoke_copy, tmp_path, version):
    """Later versions have no empty texts, and none that begin or end with a space."""
    bare = {name: text for name, text in LABORATORY.items() if name not in ("email", "accreditation")}
    spaced = {**FIELDS, "model": " Maker  QF ", "customer_address": "\n1 Hole "}
    content = certificate(approve(smoke_copy, laboratory=bare, fields=spaced, by=" boris "), version=version)
    root = parsed(content)
    stated = root.findall(f"{DCC}administrativeData/{DCC}calibrationLaboratory/{DCC}contact/{DCC}eMail")
    assert len(stated) == (version == DEFAULT)
    ends = [each for each in root.iter() if not len(each) and each.tag != f"{DCC}eMail"]
    assert all(re.fullmatch(r"\S+(\s+\S+)*", each.text) for each in ends)
    (tmp_path / "made.xml").write_bytes(content)
    assert errors(tmp_path / "made.xml") == []


def test_the_command_writes_the_version_it_is_told(smoke_copy, bench_here, tmp_path):
    told = ("report", approve(smoke_copy).name, "--runs", str(smoke_copy.parent))
    out = tmp_path / "made.xml"
    done = bench_here(*told, "--format", "dcc", "--dcc-version", "3.3.0", "--out", str(out))
    assert done.returncode == 0, done.stderr
    assert parsed(out.read_bytes()).get("schemaVersion") == "3.3.0"
    assert bench_here(*told, "--format", "dcc").returncode == 0
    assert parsed((smoke_copy / issued_name(NUMBER, "xml")).read_bytes()).get("schemaVersion") == DEFAULT
    wrong = bench_here(*told, "--format", "dcc", "--dcc-version", "3.3")
    assert (wrong.returncode, "--dcc-version 3.3: unknown, expected 3.1.2, 3.2.1, 3.3.0" in wrong.stderr) == (2, True)
    other = bench_here(*told, "--dcc-version", "3.3.0")
    assert (other.returncode, "--dcc-version is for --format dcc" in other.stderr) == (2, True)


@pytest.mark.parametrize(
    ("stated", "version"),
    [
        ({}, ""),
        ({"dcc": False}, ""),
        ({"dcc": True}, DEFAULT),
        ({"dcc": {}}, DEFAULT),
        ({"dcc": {"version": "3.3.0"}}, "3.3.0"),
    ],
)
def test_a_station_states_its_version(tmp_path, stated, version):
    path = tmp_path / "station.yaml"
    path.write_text(yaml.safe_dump({"schema": "itb-station/1", "benches": {"demo": {"file": "simulated"}}, **stated}))
    assert read_station(path, tmp_path).dcc == version


def test_a_version_that_is_not_written_is_an_error_of_the_settings(tmp_path):
    path = tmp_path / "station.yaml"
    path.write_text("schema: itb-station/1\nbenches: {demo: {file: simulated}}\ndcc:\n  version: 3.2.0\n")
    with pytest.raises(InputError, match=r"station.yaml:4:\d+: version: is '3.2.0'.*'3.2.1' or '3.3.0'$") as found:
        load_file(path, StationFile)
    assert len(str(found.value).splitlines()) == 1


def test_a_station_issues_it_in_its_version(smoke_copy, tmp_path):
    database = Database(tmp_path)
    found = approved(SignOff(database, "L3", OF_STATION), smoke_copy, ISSUE._replace(dcc="3.3.0"))
    database.close()
    content = (smoke_copy / issued_name(found.report, "xml")).read_bytes()
    assert parsed(content).get("schemaVersion") == "3.3.0"
