"""Recognition of a 3458A by ID?, after its output has stopped."""

from __future__ import annotations

from drivers.dialects.keysight_3458a import wire
from drivers.discovery.recognition import Found, Language, Port, Recognition, clear_errors, text_of


async def recognise(port: Port) -> Found:
    """Recognise the voltmeter, and leave it waiting for a trigger, as the driver does.

    Errors caused by queries in other languages are cleared from its register.
    """
    identity = wire.read_identity(text_of(await port.query(wire.IDENTITY_QUERY + wire.END)).encode())
    revision = wire.read_numbers(text_of(await port.query(wire.REVISION_QUERY + wire.END)).encode())
    await clear_errors(port, wire.ERROR_QUERY + wire.END)
    return Found(identity._replace(firmware=",".join(f"{number:g}" for number in revision)))


def is_query(line: str) -> bool:
    """Return whether every command of a line is a query."""
    return all(command.strip().endswith("?") for command in line.split(";"))


RECOGNITION = Recognition(Language("3458a", 2, is_query), recognise, starter={"options": {"range": "10 V"}})
