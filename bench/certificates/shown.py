"""Content of a certificate for people, and as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from bench.certificates.certificate import Certificate, not_valid
from bench.certificates.quantities import Value
from bench.certificates.signature import Signature


def to_json(certificate: Certificate, signature: Signature | None) -> dict[str, Any]:
    """Return all that is read of a certificate; numbers are in the units of the certificate."""
    return {
        "number": certificate.number,
        "laboratory": certificate.laboratory,
        "date": str(certificate.date),
        "due": None if certificate.due is None else str(certificate.due),
        "not_valid": not_valid(certificate),
        "items": list(certificate.items),
        "serials": list(certificate.serials),
        "signature": None if signature is None else signature._asdict(),
        "quantities": [
            {"names": sorted(each.names), "name": each.title, "values": [_value(value) for value in each.values]}
            for each in certificate.quantities
        ],
    }


def _value(value: Value) -> dict[str, Any]:
    return {
        "label": value.label,
        "value": float(value.number),
        "unit": value.written,
        "expanded": None if value.expanded is None else float(value.expanded),
        "k": None if value.k is None else float(value.k),
    }


def in_words(certificate: Certificate, signature: Signature | None) -> Iterator[str]:
    """Yield the lines for a person: the certificate, then its quantities with their names."""
    due = "not stated" if certificate.due is None else str(certificate.due)
    yield f"{certificate.number} of {certificate.laboratory}, calibrated {certificate.date}, due {due}"
    if words := not_valid(certificate):
        yield f"NOT VALID: {words}"
    yield f"of {', '.join(filter(None, certificate.items)) or 'no item'}: {', '.join(certificate.serials)}"
    yield _signed(signature)
    for each in certificate.quantities:
        names = ", ".join(sorted(each.names - {each.title}))
        yield f"  {each.title or 'without a name'}{f' [{names}]' if names else ''}"
        yield from (f"    {_number(value)}" for value in each.values)


def _signed(signature: Signature | None) -> str:
    if signature is None:
        return "not signed"
    known = "as expected" if signature.is_expected else "whose certificate was not compared with any"
    return f"signed by {signature.subject} (SHA-256 {signature.fingerprint}), {known}; unchanged since"


def _number(value: Value) -> str:
    text = f"{float(value.number):.12g} {value.written}"
    if value.expanded is None or value.k is None:
        return f"{text}, without uncertainty"
    return f"{text} ± {float(value.expanded):.6g} (k = {float(value.k):.6g})"
