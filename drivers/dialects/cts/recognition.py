"""Recognition of a CTS chamber by a frame with its status, and its versions."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from drivers.dialects.cts import wire
from drivers.discovery.recognition import Found, Language, Port, Recognition
from drivers.kinds.chamber.recognition import CHAMBER_STARTER
from drivers.values import Identity

T = TypeVar("T")


async def recognise(port: Port) -> Found:
    """Recognise the chamber at the address given by the unit number."""
    await _query(port, wire.STATUS_QUERY, wire.read_status)
    options: dict[str, object] = {"address": port.unit_id}
    versions = ""
    try:
        versions = await _query(port, wire.VERSIONS_QUERY, wire.read_versions)
    except ValueError:
        options["versions"] = False
    return Found(Identity(maker="CTS", firmware=versions, verified=False), {"options": options})


async def _query(port: Port, question: str, read: Callable[[str], T]) -> T:
    answer = await port.query(wire.frame(port.unit_id, question.encode()))
    return wire.of_address(port.unit_id, read)(answer.removesuffix(bytes([wire.ETX])))


def is_query(line: str) -> bool:
    """Return whether a line is a query: it begins with a capital letter."""
    return line[:1].isupper()


RECOGNITION = Recognition(
    Language("cts", 2, is_query, numbered=True), recognise, starter=CHAMBER_STARTER, lines=("baud=19200&parity=O",)
)
