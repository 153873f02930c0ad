"""Recognition of an Acutrol3000 by *IDN?, whose answer has two numbers in front."""

from __future__ import annotations

from contextlib import suppress
from typing import get_args

from drivers.dialects.acutronic_acl import wire
from drivers.dialects.acutronic_acl.wire import ByteOrder
from drivers.discovery.recognition import IDN, SCPI, Blocks, Found, Port, Recognition

STARTER: Blocks = {
    "options": {"rate": "2 °/s", "acceleration": "5 °/s²", "settle": {"band": "10 arcsec", "hold": "1 s"}},
    "limits": {
        "angle": {"min": "-5°", "max": "5°"}, "rate": {"max": "2 °/s"}, "acceleration": {"max": "5 °/s²"},
        "frequency": {"max": "1 Hz"},
    },
}  # fmt: skip


async def recognise(port: Port) -> Found:
    """Recognise a controller, and the byte order of its length prefix."""
    answer = await port.query(IDN)
    orders: tuple[ByteOrder, ...] = get_args(ByteOrder)
    for order in orders:
        with suppress(ValueError):
            identity = wire.read_identity(wire.read_reply(answer, order).text)
            return Found(identity, {"options": {"byte_order": order}})
    raise ValueError("no length prefix")


RECOGNITION = Recognition(SCPI, recognise, starter=STARTER)
