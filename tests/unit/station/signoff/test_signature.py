"""Signature of an approved PDF: what is refused before it signs, and what validators find in the file."""

import io
import os
import shutil
import subprocess

import pytest

from bench.errors import InputError
from bench.station.signoff.decisions import SignOff
from bench.station.signoff.files import usable_key
from bench.station.signoff.key import CREDENTIALS, KeyFiles, SignatureEntry, key_files
from bench.station.storage.database import Database
from bench.store.seal import file_hash
from tests.support.paper import pdf_of
from tests.support.signing import ISSUE, LABORATORY, approved
from tests.support.signing import key_files as new_key


def validated(content, certificate):
    """Return the status of the only signature of a PDF, with a certificate as the only trust root."""
    from pyhanko.keys import load_cert_from_pemder
    from pyhanko.pdf_utils.reader import PdfFileReader
    from pyhanko.sign.validation import validate_pdf_signature
    from pyhanko_certvalidator import ValidationContext

    (signature,) = PdfFileReader(io.BytesIO(content)).embedded_signatures
    return validate_pdf_signature(signature, ValidationContext(trust_roots=[load_cert_from_pemder(certificate)]))


@pytest.fixture(scope="module")
def signed(tmp_path_factory, shared_runs):
    """An approved run with a signed PDF: its decision, the file, and the key."""
    folder = tmp_path_factory.mktemp("signed")
    run = folder / "runs" / shared_runs.smoke().path.name
    shutil.copytree(shared_runs.smoke().path, run)
    key = new_key(folder, b"open sesame")
    database = Database(folder)
    found = approved(SignOff(database, "L3", LABORATORY), run, ISSUE._replace(form="pdf", key=key))
    database.close()
    return found, run / f"report.{found.report}.pdf", folder / "approvals.pem"


@pytest.mark.lengthy
def test_the_signed_file_is_the_one_that_is_bound_and_a_changed_byte_or_another_certificate_is_found(signed, tmp_path):
    found, file, certificate = signed
    assert found.binds[file.name] == file_hash(file)
    content = file.read_bytes()
    status = validated(content, certificate)
    assert status.bottom_line, status.pretty_print_details()
    assert status.coverage.name == "ENTIRE_FILE"
    assert status.docmdp_ok
    for place in (len(content) // 3, len(content) // 2):
        changed = bytearray(content)
        changed[place] ^= 1
        assert not validated(bytes(changed), certificate).bottom_line
    new_key(tmp_path)
    assert not validated(content, tmp_path / "approvals.pem").bottom_line


@pytest.mark.slow
@pytest.mark.peer("pdfsig", "pdftotext")
def test_pdfsig_finds_the_signature_valid_and_a_changed_byte(signed, tmp_path):
    _, file, _ = signed
    good = subprocess.run(["pdfsig", "-nocert", file], capture_output=True, text=True, check=True).stdout
    assert "Signature is Valid." in good
    assert "Total document signed" in good
    text = subprocess.run(["pdftotext", "-layout", file, "-"], capture_output=True, text=True, check=True).stdout
    assert "electronic, in this PDF" in text
    assert "CN=Approvals" in text
    content = bytearray(file.read_bytes())
    content[len(content) // 3] ^= 1
    (tmp_path / "changed.pdf").write_bytes(content)
    bad = subprocess.run(["pdfsig", "-nocert", tmp_path / "changed.pdf"], capture_output=True, text=True).stdout
    assert "Signature is Valid." not in bad
    assert "Digest Mismatch" in bad


def test_a_key_in_pkcs_12_signs_too(tmp_path):
    from bench.station.signoff.signature import Signer

    signer = Signer(new_key(tmp_path, b"open sesame", pkcs12=True))
    content = signer.signed(pdf_of("<p>Report</p>"), by="boris", report="L3-2026-00001-ABCDE")
    assert validated(content, tmp_path / "approvals.pem").bottom_line


def readable(files, folder):
    files.key.chmod(0o640)
    return files


def readable_passphrase(files, folder):
    files.passphrase.chmod(0o644)
    return files


def wrong_passphrase(files, folder):
    files.passphrase.write_bytes(b"open barley")
    return files


def of_another_key(files, folder):
    (folder / "other").mkdir()
    return files._replace(certificate=new_key(folder / "other").certificate)


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (readable, "can be read by others; chmod 600"),
        (readable_passphrase, "can be read by others; chmod 600"),
        (wrong_passphrase, "passphrase is wrong"),
        (of_another_key, "of another key"),
        (lambda files, folder: files._replace(key=folder / "missing.key"), "No such file"),
        (lambda files, folder: files._replace(passphrase=None), "passphrase"),
        (lambda files, folder: new_key(folder, days=9), "is valid from"),
        (lambda files, folder: KeyFiles(files.key, files.key), "cannot be read"),
        (lambda files, folder: files._replace(passphrase=None, credential="itb-sign"), "LoadCredential=itb-sign"),
    ],
)
def test_a_key_that_cannot_sign_is_refused_with_the_reason(tmp_path, monkeypatch, spoil, why):
    monkeypatch.delenv(CREDENTIALS, raising=False)
    files = new_key(tmp_path, b"open sesame")
    usable_key(files)
    with pytest.raises(InputError, match=why) as problem:
        usable_key(spoil(files, tmp_path))
    assert "sesame" not in str(problem.value)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives a file to another user")
def test_a_key_of_another_user_is_refused(tmp_path):
    files = new_key(tmp_path)
    os.chown(files.key, 12345, 12345)
    with pytest.raises(InputError, match="another user"):
        usable_key(files)


def test_a_passphrase_may_be_a_credential_of_systemd(tmp_path, monkeypatch):
    files = new_key(tmp_path, b"open sesame")
    monkeypatch.setenv(CREDENTIALS, str(tmp_path))
    usable_key(files._replace(passphrase=None, credential="passphrase"))


@pytest.mark.parametrize(
    "entry",
    [{"key": "a.key"}, {"key": "a.p12", "certificate": "a.pem"},
     {"key": "a.p12", "passphrase_file": "a", "passphrase_credential": "b"}, {"key": ""}],
)  # fmt: skip
def test_settings_that_do_not_fit_together_are_refused(entry):
    with pytest.raises(ValueError, match=r"certificate|passphrase|key"):
        SignatureEntry.model_validate(entry)


def test_files_of_a_key_are_beside_the_settings(tmp_path):
    entry = SignatureEntry(key="a.key", certificate="/etc/a.pem", passphrase_file="a.pass")
    found = key_files(entry, tmp_path)
    assert [str(each) for each in found[:3]] == [f"{tmp_path}/a.key", "/etc/a.pem", f"{tmp_path}/a.pass"]
