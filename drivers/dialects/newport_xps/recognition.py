"""Recognition of an XPS by its firmware version."""

from __future__ import annotations

from drivers.dialects.newport_xps import wire
from drivers.discovery.recognition import Blocks, Found, Language, Port, Recognition
from drivers.kinds.head.recognition import HEAD_STARTER
from drivers.values import Identity

GROUP = "Group1"  # default after delivery
STARTER: Blocks = {**HEAD_STARTER, "options": {"group": GROUP, **HEAD_STARTER["options"]}}


async def recognise(port: Port) -> Found:
    """Recognise a controller; its group names cannot be queried and are left open."""
    answer = await port.query(wire.FIRMWARE_QUERY.encode())
    if not answer.endswith(wire.END):
        raise ValueError("no EndOfAPI at the end")
    reply = wire.read_reply(answer.removesuffix(wire.END))
    if reply.code != wire.SUCCESS or not reply.text.isprintable():
        raise ValueError("no version of a firmware")
    identity = Identity(maker="Newport", model=wire.read_model(reply.text), firmware=reply.text, verified=False)
    return Found(identity)


RECOGNITION = Recognition(Language("xps"), recognise, starter=STARTER)
