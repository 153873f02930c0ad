"""Signatures of certificates: XAdES by signxml. They cover the whole certificate; nothing needs a network."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.hazmat.primitives.asymmetric.types import PrivateKeyTypes
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.x509 import Certificate, load_der_x509_certificate, load_pem_x509_certificates
from lxml import etree

from bench.certificates.markup import DS, ROOT, Element, Markup
from bench.errors import InputError
from drivers.schema.bounded import UnfitFileError, read_bounded

PLACEHOLDER = f"{{{DS}}}Signature"
SIGNING_TIME = ".//{http://uri.etsi.org/01903/v1.3.2#}SigningTime"
_PEM_BYTES = 2**20


class Key(NamedTuple):
    """Private key, and its certificate with those that issued it, its own first."""

    private: PrivateKeyTypes
    certificates: Sequence[Certificate]


class Signature(NamedTuple):
    """Valid signature of a certificate: subject and SHA-256 of the certificate of its key.

    `is_expected` is true if that is one of those stated.
    """

    subject: str
    fingerprint: str
    is_expected: bool


def signed(root: Element, place: Element, key: Key) -> Element:
    """Return a certificate with a signature in `place`, an element of it.

    Raises InputError for a key that no method of XML signatures has.
    """
    from signxml.algorithms import SignatureMethod
    from signxml.xades.xades import XAdESSigner

    if isinstance(key.private, ec.EllipticCurvePrivateKey):
        method = SignatureMethod.ECDSA_SHA256
    elif isinstance(key.private, rsa.RSAPrivateKey):
        method = SignatureMethod.RSA_SHA256
    else:
        raise InputError("signature: XML is signed with RSA or elliptic curves (ECDSA); configure such a key")
    etree.SubElement(place, PLACEHOLDER, Id="placeholder")
    made: Element = XAdESSigner(signature_algorithm=method).sign(root, key=key.private, cert=list(key.certificates))
    return made


def verified(markup: Markup, expected: Path | None = None) -> Signature | None:
    """Return the valid signature of a certificate, or None if it has none.

    `expected` is a PEM file of certificates, by one of which it must be signed. The validity of the certificate is that
    at the time stated in the signature. Raises InputError for an invalid signature, and for a missing or other one than
    expected.
    """
    known = _certificates(expected) if expected is not None else []
    found = markup.all("//ds:Signature")
    if not found:
        if expected is not None:
            raise markup.problem(f"is not signed, and signed_by wants a signature by {expected.name}")
        return None
    if len(found) > 1:
        raise markup.problem(f"has {len(found)} signatures; certificates with one are read", found[1])
    certificate = _embedded(markup, found[0])
    _verify(markup, found[0], certificate)
    is_expected = certificate in known
    if expected is not None and not is_expected:
        raise markup.problem(
            f"is signed by {certificate.subject.rfc4514_string()}, whose certificate is not in {expected.name}",
            found[0],
        )
    return Signature(certificate.subject.rfc4514_string(), certificate.fingerprint(SHA256()).hex(), is_expected)


def _embedded(markup: Markup, signature: Element) -> Certificate:
    """Certificate of the key in a signature: the first one, as the schema of XAdES orders them."""
    text = markup.text("ds:KeyInfo/ds:X509Data/ds:X509Certificate", signature)
    try:
        return load_der_x509_certificate(base64.b64decode(text))
    except ValueError:
        raise markup.problem("has a signature without a readable X.509 certificate of its key", signature) from None


def _verify(markup: Markup, signature: Element, certificate: Certificate) -> None:
    from cryptography.exceptions import InvalidSignature as WrongSignature
    from signxml.exceptions import InvalidInput, SignXMLException
    from signxml.verifier import SignatureConfiguration, XMLVerifier

    stated = signature.find(SIGNING_TIME)
    config = SignatureConfiguration(expect_references=False, verification_time=_instant(stated))
    try:
        results = XMLVerifier().verify(markup.content, x509_cert=certificate, expect_config=config)
    except InvalidInput as problem:
        raise markup.problem(f"has a signature that cannot be verified ({problem})", signature) from None
    except (SignXMLException, WrongSignature, ValueError, etree.LxmlError) as problem:
        raise markup.problem(
            f"has an invalid signature ({problem}): it was changed after it was signed", signature
        ) from None
    parts = results if isinstance(results, list) else [results]
    # the reference by an empty URI is to the document, those by an id could be to a copy of another one inside
    is_whole = bool(markup.all("ds:SignedInfo/ds:Reference[@URI = '']", signature))
    if not (is_whole and any(part.signed_xml is not None and part.signed_xml.tag == ROOT for part in parts)):
        raise markup.problem("has a signature that does not cover the whole certificate", signature)


def _instant(stated: Element | None) -> datetime | None:
    try:
        found = datetime.fromisoformat(stated.text or "") if stated is not None else None
    except ValueError:
        return None
    return found.replace(tzinfo=UTC) if found is not None and found.tzinfo is None else found


def _certificates(path: Path) -> list[Certificate]:
    try:
        return load_pem_x509_certificates(read_bounded(path, _PEM_BYTES))
    except UnfitFileError as problem:
        raise InputError(f"{path}: {problem}") from None
    except ValueError:
        raise InputError(f"{path}: contains no certificate in PEM") from None
