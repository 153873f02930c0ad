"""Messages of the thermometer ⇄ values, both directions; no I/O.

Source: its manual, which is the table in README.md.
"""

from __future__ import annotations

from drivers.protocols import scpi

# A header for the simulator: capitals may stand alone
TEMPERATURE = "MEASure:TEMPerature"

TEMPERATURE_QUERY = b"MEAS:TEMP?"
OPEN = "9.9E37"  # SCPI's answer without a reading


def read_temperature(line: bytes) -> float | None:
    """Decode `23.412` in °C, None for an open sensor; ValueError."""
    (answer,) = scpi.answers(line, 1)
    return None if answer == OPEN else scpi.number(answer)


def spelled(temperature_c: float | None) -> str:
    """Encode a temperature."""
    return OPEN if temperature_c is None else f"{temperature_c:.3f}"
