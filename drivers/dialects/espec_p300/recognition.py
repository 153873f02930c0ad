"""Recognition of an ESPEC P300 by its type and ROM version."""

from __future__ import annotations

from drivers.dialects.espec_p300 import wire
from drivers.discovery.recognition import Found, Language, Port, Recognition, text_of
from drivers.kinds.chamber.recognition import CHAMBER_STARTER
from drivers.values import Identity


async def recognise(port: Port) -> Found:
    """Recognise a controller without an address, as on RS-232 and TCP."""
    kind = wire.read_type(text_of(await port.query(wire.TYPE_QUERY.encode() + wire.END)))
    programs = wire.read_rom(text_of(await port.query(wire.ROM_QUERY.encode() + wire.END)))
    return Found(Identity(maker="ESPEC", model=kind, firmware=programs, verified=False))


def is_query(line: str) -> bool:
    """Return whether a line is a query."""
    return line.endswith("?")


RECOGNITION = Recognition(Language("espec", is_query=is_query), recognise, starter=CHAMBER_STARTER)
