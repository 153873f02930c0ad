"""Recognition of a Watlow F4 by its model code."""

from __future__ import annotations

from drivers.dialects.watlow_f4.wire import MODEL_F4, Register
from drivers.discovery.recognition import MODBUS, Found, Port, Recognition
from drivers.kinds.chamber.recognition import CHAMBER_STARTER
from drivers.values import Identity


async def recognise(port: Port) -> Found:
    """Recognise a controller; its serial number is left out, because the format of its registers is undocumented."""
    model, _, _, software, revision = await port.registers(Register.MODEL, 5)
    if model != MODEL_F4:
        raise ValueError("another model")
    identity = Identity(
        maker="Watlow", model="F4", firmware=f"{software} revision {revision / 100:.2f}", verified=False
    )
    return Found(identity, {"options": {"unit_id": port.unit_id}})


RECOGNITION = Recognition(MODBUS, recognise, starter=CHAMBER_STARTER, lines=("baud=9600", "baud=19200"))
