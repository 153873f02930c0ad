"""Signature of a PDF by the key of the laboratory: PAdES, by pyHanko. Signing needs no network."""

from __future__ import annotations

import io
from datetime import datetime

from asn1crypto import keys, x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.types import PrivateKeyTypes
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat, PublicFormat, pkcs12
from cryptography.x509 import Certificate, ExtensionNotFound, KeyUsage, load_pem_x509_certificates
from pyhanko.pdf_utils.incremental_writer import IncrementalPdfFileWriter
from pyhanko.sign import signers
from pyhanko.sign.fields import MDPPerm, SigSeedSubFilter
from pyhanko_certvalidator.registry import SimpleCertificateStore

from bench.clock import wall_utc
from bench.errors import InputError
from bench.station.signoff.key import KeyFiles, passphrase_of, read_secret

FIELD = "Approval"


class Signer:
    """Key that signs reports. Raises InputError if its files are missing, not private, or do not fit together."""

    def __init__(self, files: KeyFiles) -> None:
        key, certificates = _loaded(files)
        self._certificate = certificates[0]
        _expect_fit(key, self._certificate, files, wall_utc())
        store = SimpleCertificateStore()  # type: ignore[no-untyped-call]
        store.register_multiple([_as_asn1(each) for each in certificates[1:]])
        self._signer = signers.SimpleSigner(
            signing_cert=_as_asn1(self._certificate),
            signing_key=keys.PrivateKeyInfo.load(key.private_bytes(Encoding.DER, PrivateFormat.PKCS8, NoEncryption())),
            cert_registry=store,
        )

    @property
    def subject(self) -> str:
        """Subject of the certificate."""
        return self._certificate.subject.rfc4514_string()

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the certificate."""
        return self._certificate.fingerprint(SHA256()).hex()

    def signed(self, pdf: bytes, *, by: str, report: str) -> bytes:
        """Return a PDF with a signature that permits no later change."""
        about = signers.PdfSignatureMetadata(
            field_name=FIELD, md_algorithm="sha256", subfilter=SigSeedSubFilter.PADES, certify=True,
            docmdp_permissions=MDPPerm.NO_CHANGES, name=by, reason=f"Approval of the report {report}",
        )  # fmt: skip
        content: bytes = signers.sign_pdf(
            IncrementalPdfFileWriter(io.BytesIO(pdf)), about, signer=self._signer
        ).getvalue()
        return content


def _loaded(files: KeyFiles) -> tuple[PrivateKeyTypes, list[Certificate]]:
    """Return the key, and its certificate with those that issued it."""
    passphrase, data = passphrase_of(files), read_secret(files.key)
    try:
        if files.is_pkcs12:
            key, own, others = pkcs12.load_key_and_certificates(data, passphrase)
            if key is None or own is None:
                raise InputError(f"signature: {files.key} contains no key with its certificate")
            return key, [own, *others]
        assert files.certificate is not None  # noqa: S101  the settings have it
        key = serialization.load_pem_private_key(data, passphrase)
        return key, load_pem_x509_certificates(files.certificate.read_bytes())
    except OSError as problem:
        raise InputError(f"signature: {problem.filename} cannot be read ({problem.strerror})") from None
    except (ValueError, TypeError) as problem:
        where = f"{files.key} or {files.certificate}" if files.certificate is not None else f"{files.key}"
        raise InputError(f"signature: {where} cannot be read, or the passphrase is wrong ({problem})") from None


def _expect_fit(key: PrivateKeyTypes, certificate: Certificate, files: KeyFiles, now: datetime) -> None:
    if _public(key.public_key()) != _public(certificate.public_key()):
        raise InputError(f"signature: the certificate is of another key than {files.key}; state its own first")
    begins, ends = certificate.not_valid_before_utc, certificate.not_valid_after_utc
    if not begins <= now <= ends:
        raise InputError(
            f"signature: the certificate of {files.key} is valid from {begins:%Y-%m-%d} to {ends:%Y-%m-%d}, not "
            "now; configure a valid one, and check the clock of this computer"
        )
    try:
        usage = certificate.extensions.get_extension_for_class(KeyUsage).value
    except ExtensionNotFound:
        return
    if not (usage.digital_signature or usage.content_commitment):
        raise InputError(f"signature: the certificate of {files.key} is not for signatures (key usage)")


def _public(key: object) -> bytes:
    content: bytes = key.public_bytes(Encoding.DER, PublicFormat.SubjectPublicKeyInfo)  # type: ignore[attr-defined]
    return content


def _as_asn1(certificate: Certificate) -> x509.Certificate:
    return x509.Certificate.load(certificate.public_bytes(Encoding.DER))
