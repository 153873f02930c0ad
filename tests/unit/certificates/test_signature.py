"""Signatures of certificates: by the key of a station, verified as XAdES too, and what is found if changed."""

import re
import shutil

import pytest
import yaml

from bench.certificates.certificate import read_certificate
from bench.certificates.signature import verified
from bench.config.bench import load_bench
from bench.errors import InputError
from bench.report.revision import issued_name
from bench.report.revision import verify as intact
from bench.station.signoff.decisions import SignOff
from bench.station.storage.database import Database
from bench.store.seal import file_hash
from tests.support.certified import approve, approved_copy, certificate
from tests.support.dcc import document, errors, parsed
from tests.support.runs import ROOT
from tests.support.signing import ISSUE, LABORATORY, approved, key_files


@pytest.fixture(scope="module")
def signed(shared_runs, tmp_path_factory):
    """A signed certificate, and the PEM of its key."""
    folder = tmp_path_factory.mktemp("signed")
    key = key_files(folder, b"open sesame")
    path = folder / "signed.xml"
    path.write_bytes(certificate(approved_copy(shared_runs.smoke().path, folder), key))
    return path, folder / "approvals.pem"


def test_it_is_intact_by_the_key_of_the_station_and_valid_by_the_schemas(signed):
    path, pem = signed
    found = verified(read_certificate(path).markup, pem)
    assert (found.subject, found.is_expected) == ("CN=Approvals", True)
    assert not verified(read_certificate(path).markup).is_expected
    assert errors(path) == []


def test_a_verifier_of_xades_finds_it_valid(signed):
    from cryptography.x509 import load_pem_x509_certificate
    from signxml.xades import XAdESVerifier

    certificate = load_pem_x509_certificate(signed[1].read_bytes())
    results = XAdESVerifier().verify(signed[0].read_bytes(), x509_cert=certificate)
    assert results[0].signed_xml.tag.endswith("digitalCalibrationCertificate")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (rb"<si:value>(-?\d)", rb"<si:value>9\1"), (rb"<si:unit>.metre<", rb"<si:unit>\\second<"),
        (rb"<dcc:valid>false", rb"<dcc:valid>true"), (rb"QF-0001", rb"QF-0002"),
        (rb"SigningTime>2", rb"SigningTime>1"),
    ],
)  # fmt: skip
def test_a_changed_number_word_or_time_is_found(signed, tmp_path, old, new):
    content = signed[0].read_bytes()
    if not re.search(old, content):
        old, new = rb"<dcc:release>", rb"<dcc:release>9"
    path = tmp_path / "changed.xml"
    path.write_bytes(re.sub(old, new, content, count=1))
    with pytest.raises(InputError, match=r"changed.xml:\d+: has an invalid signature"):
        verified(read_certificate(path).markup)


def test_another_key_and_no_signature_are_found_where_one_is_expected(signed, tmp_path):
    path, _ = signed
    key_files(tmp_path)
    with pytest.raises(InputError, match=r"whose certificate is not in approvals\.pem"):
        verified(read_certificate(path).markup, tmp_path / "approvals.pem")
    with pytest.raises(InputError, match="is not signed, and signed_by wants"):
        verified(read_certificate(ROOT / "config/certificates/head.xml").markup, tmp_path / "approvals.pem")
    (tmp_path / "none.pem").write_text("none")
    with pytest.raises(InputError, match="contains no certificate in PEM"):
        verified(read_certificate(path).markup, tmp_path / "none.pem")


def test_a_certificate_put_in_place_of_the_one_of_the_key_is_found(signed, tmp_path):
    """The certificate names who signed; the key of another one does not verify."""
    key_files(tmp_path)
    lines = (tmp_path / "approvals.pem").read_text().splitlines()[1:-1]
    path = tmp_path / "other.xml"
    path.write_bytes(
        re.sub(rb"(X509Certificate>)[^<]+<", rb"\1" + "".join(lines).encode() + b"<", signed[0].read_bytes())
    )
    with pytest.raises(InputError, match="has an invalid signature"):
        verified(read_certificate(path).markup, tmp_path / "approvals.pem")


def test_a_signature_of_a_part_is_not_one_of_the_certificate(tmp_path):
    """The signed part is kept, and unsigned values are put around it."""
    from cryptography.hazmat.primitives import serialization
    from lxml import etree
    from signxml import XMLSigner
    from signxml.algorithms import SignatureMethod

    key_files(tmp_path)
    key = serialization.load_pem_private_key((tmp_path / "approvals.key").read_bytes(), None)
    root = etree.fromstring((ROOT / "config/certificates/meter.xml").read_bytes())
    part = root.find("{https://ptb.de/dcc}measurementResults")
    part.set("Id", "part")
    made = XMLSigner(signature_algorithm=SignatureMethod.ECDSA_SHA256).sign(
        root, key=key, cert=(tmp_path / "approvals.pem").read_text(), reference_uri="#part"
    )
    (tmp_path / "part.xml").write_bytes(etree.tostring(made))
    with pytest.raises(InputError, match="does not cover the whole certificate"):
        verified(read_certificate(tmp_path / "part.xml").markup)


def test_a_signed_certificate_inside_another_one_is_not_its_signature(tmp_path):
    """The whole certificate is signed by its id, and then hidden in one with other values."""
    from cryptography.hazmat.primitives import serialization
    from lxml import etree
    from signxml import XMLSigner
    from signxml.algorithms import SignatureMethod

    key_files(tmp_path)
    key = serialization.load_pem_private_key((tmp_path / "approvals.key").read_bytes(), None)
    content = (ROOT / "config/certificates/meter.xml").read_bytes()
    root = etree.fromstring(content)
    root.set("Id", "whole")
    signer = XMLSigner(signature_algorithm=SignatureMethod.ECDSA_SHA256)
    made = signer.sign(root, key=key, cert=(tmp_path / "approvals.pem").read_text(), reference_uri="#whole")
    outer = etree.fromstring(content.replace(b"8e-6", b"1e-9"))
    etree.SubElement(outer, "{https://ptb.de/dcc}comment").append(made)
    (tmp_path / "outer.xml").write_bytes(etree.tostring(outer))
    with pytest.raises(InputError, match="does not cover the whole certificate"):
        verified(read_certificate(tmp_path / "outer.xml").markup, tmp_path / "approvals.pem")


def test_a_bench_takes_a_signed_certificate_and_refuses_a_changed_one(signed, tmp_path):
    """An example, signed by its laboratory; then with a smaller uncertainty."""
    from lxml import etree

    from bench.certificates.markup import read_markup
    from bench.certificates.signature import Key
    from bench.certificates.signature import signed as sign
    from bench.station.signoff.loaded_key import loaded_key

    shutil.copytree(ROOT / "config", tmp_path, dirs_exist_ok=True)
    key = key_files(tmp_path)
    meter, bench = tmp_path / "certificates/meter.xml", tmp_path / "certificates.yaml"
    root = read_markup(meter).root
    place = etree.SubElement(root, "{https://ptb.de/dcc}comment")
    meter.write_bytes(etree.tostring(sign(root, place, Key(*loaded_key(key))), encoding="UTF-8"))
    bench.write_text(bench.read_text("utf-8").replace("meter.xml}", "meter.xml, signed_by: approvals.pem}"), "utf-8")
    found = load_bench(bench).bench.devices["dvm"].calibration
    assert found.U.gain == 8e-6
    assert "CN=Approvals" in found.dcc.signature
    meter.write_bytes(meter.read_bytes().replace(b"8e-6", b"1e-6"))
    with pytest.raises(InputError, match=r"meter.xml:\d+: has an invalid signature"):
        load_bench(bench)


def test_the_command_signs_with_the_key_of_a_station_and_reads_it_back(smoke_copy, bench_here, tmp_path):
    """The chain: the certificate of a unit, signed, read by the program that takes those of instruments."""
    approve(smoke_copy)
    key_files(tmp_path)
    station = {
        "schema": "itb-station/1", "benches": {"demo": {"file": "simulated"}},
        "signature": {"key": "approvals.key", "certificate": "approvals.pem"},
    }  # fmt: skip
    (tmp_path / "station.yaml").write_text(yaml.safe_dump(station))
    out = tmp_path / "made.xml"
    told = ("report", smoke_copy.name, "--runs", str(smoke_copy.parent), "--format", "dcc", "--out", str(out))
    done = bench_here(*told, "--sign", str(tmp_path / "station.yaml"))
    assert done.returncode == 0, done.stderr
    done = bench_here("certificate", str(out), "--signed-by", str(tmp_path / "approvals.pem"))
    assert done.returncode == 0, done.stderr
    assert "as expected; unchanged since" in done.stdout
    assert "NOT VALID: This is no calibration certificate" in done.stdout
    del station["signature"]
    (tmp_path / "station.yaml").write_text(yaml.safe_dump(station))
    done = bench_here(*told, "--sign", str(tmp_path / "station.yaml"))
    assert (done.returncode, "has no signature" in done.stderr) == (2, True)


def test_a_station_issues_it_with_the_report_and_binds_both(smoke_copy, tmp_path):
    database, key = Database(tmp_path), key_files(tmp_path)
    found = approved(SignOff(database, "L3", LABORATORY), smoke_copy, ISSUE._replace(key=key, dcc="3.1.2"))
    database.close()
    report, made = (smoke_copy / issued_name(found.report, form) for form in ("html", "xml"))
    assert {report.name, made.name} <= set(found.binds)
    assert found.binds[made.name] == file_hash(made)
    assert intact(smoke_copy) == []
    assert verified(read_certificate(made).markup, tmp_path / "approvals.pem").is_expected
    assert document(parsed(made.read_bytes())) == (report.name, "text/html", report.read_bytes())


def test_a_station_approves_what_can_have_no_certificate(smoke_copy, tmp_path):
    """A run without the laboratory that a certificate needs."""
    database = Database(tmp_path)
    found = approved(SignOff(database, "L3", None), smoke_copy, ISSUE._replace(laboratory=None, dcc="3.1.2"))
    database.close()
    assert issued_name(found.report, "html") in found.binds
    assert issued_name(found.report, "xml") not in found.binds


def test_a_key_that_xml_has_no_method_for_is_refused(tmp_path):
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    from bench.certificates.markup import read_markup
    from bench.certificates.signature import Key
    from bench.certificates.signature import signed as sign

    root = read_markup(ROOT / "config/certificates/head.xml").root
    with pytest.raises(InputError, match="RSA or elliptic curves"):
        sign(root, root, Key(Ed25519PrivateKey.generate(), []))
