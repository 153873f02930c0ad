"""Signature of a PDF by the key of the laboratory: PAdES, by pyHanko. Signing needs no network."""

from __future__ import annotations

import io

from asn1crypto import keys, x509
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509 import Certificate
from pyhanko.pdf_utils.incremental_writer import IncrementalPdfFileWriter
from pyhanko.sign import signers
from pyhanko.sign.fields import MDPPerm, SigSeedSubFilter
from pyhanko_certvalidator.registry import SimpleCertificateStore

from bench.station.signoff.key import KeyFiles
from bench.station.signoff.loaded_key import loaded_key

FIELD = "Approval"


class Signer:
    """Key that signs reports. Raises InputError if its files are missing, not private, or do not fit together."""

    def __init__(self, files: KeyFiles) -> None:
        key, certificates = loaded_key(files)
        self._certificate = certificates[0]
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


def _as_asn1(certificate: Certificate) -> x509.Certificate:
    return x509.Certificate.load(certificate.public_bytes(Encoding.DER))
