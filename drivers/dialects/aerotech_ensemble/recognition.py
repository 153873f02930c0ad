"""Recognition of an Ensemble by the status of its axis X: a number behind a percent sign."""

from __future__ import annotations

from drivers.dialects.aerotech_ensemble import wire
from drivers.dialects.aerotech_ensemble.wire import Outcome
from drivers.discovery.recognition import Found, Language, Port, Recognition, text_of
from drivers.kinds.head.recognition import HEAD_STARTER
from drivers.values import Identity

AXIS = "X"  # the default name of an axis


async def recognise(port: Port) -> Found:
    """Recognise a controller that has an axis X."""
    reply = wire.read_reply(text_of(await port.query(f"{wire.STATUS_QUERY.format(AXIS)}\n".encode())).encode())
    if reply.outcome is not Outcome.DONE:
        raise ValueError("no status of an axis")
    wire.read_status(reply.data)
    return Found(Identity(maker="Aerotech", model="Ensemble", verified=False), {"options": {"axis": AXIS}})


RECOGNITION = Recognition(Language("ensemble"), recognise, starter=HEAD_STARTER)
