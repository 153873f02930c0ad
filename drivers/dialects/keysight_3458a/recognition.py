"""How a 3458A is known: by ID?, once it is quiet."""

from __future__ import annotations

from drivers.dialects.keysight_3458a import wire
from drivers.discovery.recognition import Found, Language, Port, Recognition, forget_errors, text_of


async def ask(port: Port) -> Found:
    """The voltmeter, which then waits for a trigger, as it does for its driver.

    The errors that questions in other languages have left in its register are forgotten.
    """
    identity = wire.read_identity(text_of(await port.ask(wire.IDENTITY_QUESTION + wire.END)).encode())
    revision = wire.read_numbers(text_of(await port.ask(wire.REVISION_QUESTION + wire.END)).encode())
    await forget_errors(port, wire.ERROR_QUESTION + wire.END)
    return Found(identity._replace(firmware=",".join(f"{number:g}" for number in revision)))


def asks(line: str) -> bool:
    """Whether every command of a line is a question."""
    return all(command.strip().endswith("?") for command in line.split(";"))


RECOGNITION = Recognition(Language("3458a", 2, asks), ask, starter={"options": {"range": "10 V"}})
