"""Recognition of a controller that needs a profile: any answer in Modbus."""

from __future__ import annotations

from contextlib import suppress

from drivers.discovery.recognition import MODBUS, Found, NoSuchRegister, Port, Recognition
from drivers.kinds.chamber.recognition import CHAMBER_STARTER
from drivers.values import Identity


async def recognise(port: Port) -> Found:
    """Recognise anything that answers a register request, even with an exception."""
    with suppress(NoSuchRegister):
        await port.registers(0, 1)
    return Found(
        Identity(verified=False), {"options": {"profile": "profile.yaml", "unit_id": port.unit_id}},
        missing="an unknown instrument answers in Modbus; if it is a chamber, write its profile first",
    )  # fmt: skip


RECOGNITION = Recognition(MODBUS, recognise, starter=CHAMBER_STARTER, lines=("baud=9600", "baud=19200"), generic=True)
