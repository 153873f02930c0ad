"""The names and units in a DBC text, read without cantools and numpy: enough to check a bench file."""

from __future__ import annotations

import re

# How a DBC spells what we write otherwise. It is ASCII, or has a degree sign in an encoding of its own, which is
# replaced when the file is read.
UNITS = {"degC": "°C", "DegC": "°C", "deg C": "°C", "\N{REPLACEMENT CHARACTER}C": "°C"}
_MESSAGE = re.compile(r"^\s*BO_\s+\d+\s+(\w+)\s*:", re.ASCII)
_SIGNAL = re.compile(r'^\s*SG_\s+(\w+)\s*:[^"]*"([^"]*)"', re.ASCII)


def outline(text: str) -> dict[str, str]:
    """`Message.Signal` → unit for every signal that is not multiplexed."""
    found: dict[str, str] = {}
    message = ""
    for line in text.splitlines():
        if match := _MESSAGE.match(line):
            message = match[1]
        elif (match := _SIGNAL.match(line)) and message:
            found[f"{message}.{match[1]}"] = UNITS.get(match[2], match[2])
    return found
