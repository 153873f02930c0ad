"""Recognition of a generic power supply: it answers *IDN?, and has level, current limit and output switch."""

from __future__ import annotations

from contextlib import suppress

from drivers.discovery.recognition import IDN, SCPI, Found, Port, Recognition, clear_errors, text_of
from drivers.protocols import scpi

SETTINGS_QUERY = b":VOLT?;:CURR?;:OUTP?\n"
ERROR_QUERIES = (b":SYST:ERR?\n", b":STAT:ERR?\n")


async def recognise(port: Port) -> Found:
    """Recognise a supply; else raise ValueError, and clear errors that the queries caused in another instrument."""
    identity = scpi.identity(text_of(await port.query(IDN)).encode())
    try:
        level, limit, output = scpi.answers(text_of(await port.query(SETTINGS_QUERY)).encode(), 3)
        scpi.number(level), scpi.number(limit), scpi.boolean(output)
    finally:
        for question in ERROR_QUERIES:
            with suppress(ValueError):  # the queue contains an error of an unknown query
                await clear_errors(port, question)
                break
    return Found(identity)


RECOGNITION = Recognition(
    SCPI, recognise, starter={"limits": {"voltage": {"max": "5 V"}, "current": {"max": "100 mA"}}}, generic=True
)
