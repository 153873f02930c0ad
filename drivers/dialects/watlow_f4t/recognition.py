"""Recognition of a Watlow F4T by its display unit and plausible set-point limits."""

from __future__ import annotations

from typing import get_args

from drivers.dialects.watlow_f4t.wire import DISPLAY_UNIT, DISPLAY_UNIT_SERIAL, DisplayUnit, LoopFormat, LoopRegister
from drivers.discovery.recognition import MODBUS, Found, Port, Recognition
from drivers.kinds.chamber.recognition import CHAMBER_STARTER
from drivers.kinds.chamber.words import WordOrder
from drivers.values import Identity

_COLDEST, _HOTTEST, _NARROWEST = -460.0, 4000.0, 1.0  # °C or °F


async def recognise(port: Port) -> Found:
    """Recognise a controller, and the word order of its floats."""
    (unit,) = await port.registers(DISPLAY_UNIT_SERIAL if port.is_serial_line else DISPLAY_UNIT, 1)
    limits = await port.registers(LoopRegister.SET_POINT_MIN, 4)
    if unit not in list(DisplayUnit):
        raise ValueError("no display unit of an F4T")
    orders: tuple[WordOrder, ...] = get_args(WordOrder)
    for order in orders:
        form = LoopFormat(word_order=order)
        low, high = form.value(limits[:2]), form.value(limits[2:])
        if _COLDEST <= low <= high - _NARROWEST <= high <= _HOTTEST:
            options: dict[str, object] = {"unit_id": port.unit_id, "word_order": order}
            return Found(Identity(maker="Watlow", model="F4T", verified=False), {"options": options})
    raise ValueError("implausible set-point limits")


RECOGNITION = Recognition(MODBUS, recognise, starter=CHAMBER_STARTER, lines=("baud=9600", "baud=19200"))
