"""Approvals without a server, keys of laboratories, and approvals that die after each step on the disk.

As a program: an approval of a run, again and again, each time killed at a later change of a file.
"""

from __future__ import annotations

import itertools
import os
import shutil
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import yaml

from bench.config.laboratory import CertificateFields, LaboratoryFile
from bench.errors import InputError
from bench.station.signoff.decisions import Signed, SignOff
from bench.station.signoff.files import Issue, settle, write_staged
from bench.station.signoff.key import KeyFiles
from bench.station.storage.database import Database
from bench.store.runs import summary
from tests.support.how_to import FOLDER, blocks
from tests.support.how_to import LABORATORY as HOW_TO_LABORATORY

(_TEXT,) = (text for _, text in blocks(FOLDER / "station.md") if text.startswith(HOW_TO_LABORATORY))
LABORATORY = LaboratoryFile.model_validate(yaml.safe_load(_TEXT))
ISSUE = Issue(LABORATORY, CertificateFields(customer="Mole & Sons <b>"), "html")
KILLED = 137


def approved(sign_off: SignOff, run: Path, issue: Issue = ISSUE, by: str = "boris", replaces: str = "") -> Signed:
    """Approve a run as the API does."""
    begun = sign_off.begin(summary(run), by, "looked at", replaces)
    try:
        binds = write_staged(run, begun.signed, issue)
    except InputError:
        sign_off.drop(begun)
        raise
    decided = sign_off.decide(begun, binds)
    settle(run, decided)
    sign_off.done(decided)
    return decided.signed


def settle_all(sign_off: SignOff, runs: Path) -> None:
    """Settle what is pending, as a station does when it starts."""
    for each in sign_off.pending():
        settle(runs / each.signed.run, each)
        sign_off.done(each)


def key_files(
    folder: Path, passphrase: bytes = b"", days: int = 365, name: str = "Approvals", pkcs12: bool = False
) -> KeyFiles:
    """Write a key with a certificate that it has issued itself, valid from ten days ago, and return its files."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.hazmat.primitives.serialization import pkcs12 as bundle
    from cryptography.x509.oid import NameOID

    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "Approvals")])
    begins = datetime.now(UTC) - timedelta(days=10)
    usage = dict.fromkeys(
        ("key_encipherment", "data_encipherment", "key_agreement", "key_cert_sign", "crl_sign", "encipher_only",
         "decipher_only"), False,
    )  # fmt: skip
    certificate = (
        x509.CertificateBuilder().subject_name(subject).issuer_name(subject).public_key(key.public_key())
        .serial_number(x509.random_serial_number()).not_valid_before(begins)
        .not_valid_after(begins + timedelta(days=days))
        .add_extension(x509.KeyUsage(digital_signature=True, content_commitment=True, **usage), critical=True)
        .sign(key, hashes.SHA256())
    )  # fmt: skip
    secret: Any = serialization.BestAvailableEncryption(passphrase) if passphrase else serialization.NoEncryption()
    form = (serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, secret)
    files = KeyFiles(folder / "approvals.p12" if pkcs12 else folder / "approvals.key", folder / "approvals.pem")
    content = bundle.serialize_key_and_certificates(None, key, certificate, None, secret)
    files.key.write_bytes(content if pkcs12 else key.private_bytes(*form))
    files.key.chmod(0o600)
    (folder / "approvals.pem").write_bytes(certificate.public_bytes(serialization.Encoding.PEM))
    if passphrase:
        files = files._replace(passphrase=folder / "passphrase")
        (folder / "passphrase").write_bytes(passphrase + b"\n")
        (folder / "passphrase").chmod(0o600)
    return files._replace(certificate=None) if pkcs12 else files


def die_at(number: int, folder: Path) -> None:
    """End this process, without another instruction, at the given change of a file in a folder."""
    count = itertools.count(1)

    def changes(event: str, arguments: tuple[Any, ...]) -> bool:
        return event in ("os.rename", "os.remove") or (event == "open" and bool(arguments[2] & os.O_ACCMODE))

    def watch(event: str, arguments: tuple[Any, ...]) -> None:
        if changes(event, arguments) and str(arguments[0]).startswith(str(folder)) and next(count) == number:
            os._exit(KILLED)

    sys.addaudithook(watch)


def main(run: Path, folder: Path) -> None:
    """Approve copies of a run that was approved before, in `folder/1`, `folder/2`, … until one is not killed."""
    for number in itertools.count(1):
        here = folder / str(number)
        copy = Path(shutil.copytree(run, here / "runs" / run.name))
        database = Database(here)
        first = approved(SignOff(database, "L3", LABORATORY), copy)
        database.close()
        if (child := os.fork()) == 0:
            database = Database(here)
            sign_off = SignOff(database, "L3", LABORATORY)
            die_at(number, copy)
            approved(sign_off, copy, replaces=first.report)
            os._exit(0)
        if os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0:
            return


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
