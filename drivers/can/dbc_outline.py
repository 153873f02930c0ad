"""Names, units and lengths of the signals of a DBC text, parsed without cantools and numpy, to check bench files."""

from __future__ import annotations

import re
from collections.abc import Iterator

# Unit spellings of a DBC that differ from ours. It is ASCII, or has a degree sign in an encoding of its own, which is
# replaced when the file is read.
READINGS = ("°C", "Hz")
"""Units of the signals that are readings of a node."""
UNITS = {"degC": "°C", "DegC": "°C", "deg C": "°C", "\N{REPLACEMENT CHARACTER}C": "°C"}
_MESSAGE = re.compile(r"^\s*BO_\s+\d+\s+(\w+)\s*:", re.ASCII)
_FRAME = re.compile(r"^\s*BO_\s+(\d{1,10})\s+(\w+)\s*:\s*(\d{1,2})\b", re.ASCII)
_SIGNAL = re.compile(r'^\s*SG_\s+(\w+)\s*:([^"]*)"([^"]*)"', re.ASCII)
EXTENDED = 1 << 31  # set in the id of a message with a 29-bit identifier
_LENGTH = re.compile(r"\|(\d{1,2})@", re.ASCII)


def outline(text: str) -> dict[str, str]:
    """`Message.Signal` → unit for every signal that is not multiplexed."""
    return {name: UNITS.get(unit, unit) for name, _, unit in _signals(text)}


def lengths_bits(text: str) -> dict[str, int]:
    """`Message.Signal` → length in bits, as far as the text defines it."""
    return {name: int(found[1]) for name, layout, _ in _signals(text) if (found := _LENGTH.search(layout))}


def frames_bits(text: str) -> dict[str, int]:
    """Maximum length of a frame of each message on the bus in bits, with stuff bits and interframe space.

    R. I. Davis, A. Burns, R. J. Bril, J. J. Lukkien, Controller Area Network (CAN) schedulability analysis, Real-Time
    Systems 35 (2007) 239, equation (1): g + 8 s + 13 + (g + 8 s - 1) // 4 for s bytes, g = 34, or 54 with 29-bit ids.
    """
    found = {}
    for line in text.splitlines():
        if match := _FRAME.match(line):
            stuffed = (54 if int(match[1]) & EXTENDED else 34) + 8 * int(match[3])
            found[match[2]] = stuffed + 13 + (stuffed - 1) // 4
    return found


def _signals(text: str) -> Iterator[tuple[str, str, str]]:
    """Name, layout and unit of each signal, as text."""
    message = ""
    for line in text.splitlines():
        if match := _MESSAGE.match(line):
            message = match[1]
        elif (match := _SIGNAL.match(line)) and message:
            yield f"{message}.{match[1]}", match[2], match[3]
