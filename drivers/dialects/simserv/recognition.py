"""Recognition of a chamber with SIMSERV by its serial number and type."""

from __future__ import annotations

from drivers.dialects.simserv import wire
from drivers.dialects.simserv.wire import Function, Info
from drivers.discovery.recognition import Found, Language, Port, Recognition
from drivers.kinds.chamber.recognition import CHAMBER_STARTER
from drivers.kinds.chamber.refusal import Refusal
from drivers.values import Identity


async def recognise(port: Port) -> Found:
    """Read type and serial number."""
    serial, kind = await _query(port, Info.SERIAL), await _query(port, Info.TYPE)
    return Found(Identity(maker="Weiss Technik", model=kind, serial=serial))


async def _query(port: Port, what: Info) -> str:
    answer = await port.query(wire.message(Function.INFO, what).encode("latin-1") + wire.END)
    found = wire.unless_refused(wire.text)(answer.removesuffix(wire.ANSWER_END))
    if isinstance(found, Refusal) or not found.isprintable():
        raise ValueError("no name of a chamber")
    return found


RECOGNITION = Recognition(Language("simserv"), recognise, starter=CHAMBER_STARTER)
