"""Key of a station with its certificates, read from its files."""

from __future__ import annotations

from datetime import datetime

from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.types import PrivateKeyTypes
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat, pkcs12
from cryptography.x509 import Certificate, ExtensionNotFound, KeyUsage, load_pem_x509_certificates

from bench.clock import wall_utc
from bench.errors import InputError
from bench.station.signoff.key import KeyFiles, passphrase_of, read_secret


def loaded_key(files: KeyFiles) -> tuple[PrivateKeyTypes, list[Certificate]]:
    """Return the key, and its certificate with those that issued it.

    Raises InputError if files are missing, not private or do not fit together, or if the certificate is not valid now.
    """
    key, certificates = _read(files)
    _expect_fit(key, certificates[0], files, wall_utc())
    return key, certificates


def _read(files: KeyFiles) -> tuple[PrivateKeyTypes, list[Certificate]]:
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
