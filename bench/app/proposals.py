"""Proposed bench file entries for instruments found by a scan."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from bench.app.scan import AddressScan, Candidate
from drivers.description import IdentityPin
from drivers.values import Identity

ROLES: Mapping[str, str] = {
    "rate_table": "table", "positioner": "head", "thermal_chamber": "chamber", "power_supply": "supply",
    "current_source": "source", "voltmeter": "voltmeter", "thermometer": "scanner",
}  # fmt: skip
_PLAIN = re.compile(r"[A-Za-z/][\w ./+°-]*", re.ASCII)
_OTHERWISE = {"true", "false", "null", "yes", "no", "on", "off"}  # words that some YAML parsers read as values
_CAREFUL = "options, limits and safe hold conservative values: replace them by what your bench and its units allow"


def entries(places: Sequence[AddressScan]) -> dict[str, Mapping[str, Any]]:
    """Return the entries of instruments that exactly one driver recognises, by a suitable role."""
    return {role: entry for role, entry, doubt in _all(places) if not doubt}


def proposal(places: Sequence[AddressScan]) -> str:
    """Return a `devices:` block for a bench file; entries that need a decision are comments."""
    lines = [f"# {_CAREFUL}", "devices:"]
    for role, entry, doubt in _all(places):
        if doubt:
            lines.append(f"  # {doubt}:")
        mark = "  # " if doubt else "  "
        lines.append(f"{mark}{role}:")
        lines += [f"{mark}  {key}: {_spelled(value)}" for key, value in entry.items()]
    return "\n".join(lines) + "\n"


def _all(places: Sequence[AddressScan]) -> Iterator[tuple[str, Mapping[str, Any], str]]:
    """Yield role, entry and doubt of every candidate."""
    taken: set[str] = set()
    for place in places:
        numbers = [candidate.unit_id for candidate in place.candidates]
        for candidate in place.candidates:
            role = _role(candidate, taken)
            taken.add(role)
            one_of = numbers.count(candidate.unit_id) > 1
            shared = "one of several drivers that recognise the instrument" if one_of else ""
            doubt = candidate.found.missing or shared
            yield role, _entry(candidate), doubt


def _role(candidate: Candidate, taken: set[str]) -> str:
    capabilities = candidate.driver.capabilities
    name = next((role for capability, role in ROLES.items() if capability in capabilities), candidate.driver.name)
    return next(role for role in (name, *(f"{name}_{n}" for n in range(2, 1000))) if role not in taken)


def _entry(candidate: Candidate) -> Mapping[str, Any]:
    found, starter = candidate.found, candidate.recognition.starter
    blocks = {name: {**starter.get(name, {}), **found.blocks.get(name, {})} for name in ("options", "limits", "safe")}
    entry: dict[str, Any] = {"driver": candidate.driver.name, "connection": str(candidate.address)}
    entry |= {"options": blocks["options"], "identity": pinned(found.identity)}
    return {key: value for key, value in (entry | blocks).items() if value}


def pinned(identity: Identity) -> dict[str, str]:
    """Return the `identity` block of a bench file: everything the instrument reports about itself."""
    fields = identity._asdict()
    return {name: fields[name] for name in IdentityPin.model_fields if fields[name]}


def _spelled(value: object) -> str:
    """Return a value as YAML in one line; text from an instrument is always quoted."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_spelled(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, str):
        is_plain = _PLAIN.fullmatch(value) is not None and value.lower() not in _OTHERWISE and value == value.strip()
        return value if is_plain or "://" in value else json.dumps(value, ensure_ascii=False)
    return json.dumps(value)
