"""The names, units and lengths in a DBC text, read without cantools and numpy: enough to check a bench file."""

from __future__ import annotations

import re
from collections.abc import Iterator

# How a DBC spells what we write otherwise. It is ASCII, or has a degree sign in an encoding of its own, which is
# replaced when the file is read.
UNITS = {"degC": "°C", "DegC": "°C", "deg C": "°C", "\N{REPLACEMENT CHARACTER}C": "°C"}
_MESSAGE = re.compile(r"^\s*BO_\s+\d+\s+(\w+)\s*:", re.ASCII)
_SIGNAL = re.compile(r'^\s*SG_\s+(\w+)\s*:([^"]*)"([^"]*)"', re.ASCII)
_LENGTH = re.compile(r"\|(\d{1,2})@", re.ASCII)


def outline(text: str) -> dict[str, str]:
    """`Message.Signal` → unit for every signal that is not multiplexed."""
    return {name: UNITS.get(unit, unit) for name, _, unit in _signals(text)}


def lengths_bits(text: str) -> dict[str, int]:
    """`Message.Signal` → length in bits, as far as the text tells it."""
    return {name: int(found[1]) for name, layout, _ in _signals(text) if (found := _LENGTH.search(layout))}


def _signals(text: str) -> Iterator[tuple[str, str, str]]:
    """Name, layout and unit of each signal, as they are written."""
    message = ""
    for line in text.splitlines():
        if match := _MESSAGE.match(line):
            message = match[1]
        elif (match := _SIGNAL.match(line)) and message:
            yield f"{message}.{match[1]}", match[2], match[3]
