"""Numbers with units and multipliers as accepted by a Fluke 5700A.

Source: its operators manual, 5-9 "Parameter Syntax Rules": `M` is milli before A, V and other units, but mega in MOHM
and MHZ; mega is `MA` before a unit, so that MA alone is milliamperes and MAV megavolts.
"""

from __future__ import annotations

import re

from drivers.protocols.scpi import number

_QUANTITY = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:E[+-]?\d+)?)\s*([A-Z]+)", re.ASCII)
_UNITS = ("HZ", "V", "A", "OHM", "DB", "DBM", "PCT", "PPM")
_MULTIPLIERS = {"": 1.0, "K": 1e3, "M": 1e-3, "U": 1e-6, "MA": 1e6}
_MEGA = {"MOHM": "OHM", "MHZ": "HZ"}


def quantity(text: str) -> tuple[float, str]:
    """Parse a value in a unit with multiplier, from capitals like `10V`, `1.2 MA` or `1KHZ`; ValueError."""
    match = _QUANTITY.fullmatch(text)
    if match is None:
        raise ValueError(f"'{text}' is not a number with a unit")
    value, word = number(match[1]), match[2]
    if word in _MEGA:
        return 1e6 * value, _MEGA[word]
    for multiplier, factor in _MULTIPLIERS.items():
        if word.startswith(multiplier) and word[len(multiplier) :] in _UNITS:
            return factor * value, word[len(multiplier) :]
    raise ValueError(f"'{word}' is no unit")
