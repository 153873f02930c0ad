"""Recognition of a Binder controller by temperatures, and a mode, in the registers of an MB1 or an MB2."""

from __future__ import annotations

from collections.abc import Mapping
from typing import get_args

from drivers.dialects.binder.wire import LINES, MODE, Kind, Mode, registers_of, value_c
from drivers.discovery.recognition import MODBUS, Blocks, Found, Port, Recognition
from drivers.kinds.chamber.recognition import CHAMBER_STARTER
from drivers.values import Identity

_BESIDES: Mapping[Kind, int] = {"mb1": MODE, "mb2": LINES}
STARTER: Blocks = {**CHAMBER_STARTER, "options": {"range": {"min": "-40 °C", "max": "180 °C"}}}


async def recognise(port: Port) -> Found:
    """Recognise a controller of either kind."""
    kinds: tuple[Kind, ...] = get_args(Kind)
    for kind in kinds:
        try:
            await _is(port, kind)
        except ValueError:
            continue
        identity = Identity(maker="Binder", model=kind.upper(), verified=False)
        return Found(identity, {"options": {"controller": kind, "unit_id": port.unit_id}})
    raise ValueError("neither an MB1 nor an MB2")


async def _is(port: Port, kind: Kind) -> None:
    """Raise ValueError unless the controller is of this kind."""
    at = registers_of(kind, "manual", swapped=False)
    for address in (at.process_value, at.set_point):
        words = await port.registers(address, 2)
        if value_c(words) == 0:  # unused registers read as 0
            raise ValueError("exactly 0 °C")
    (besides,) = await port.registers(_BESIDES[kind], 1)
    if kind == "mb1" and besides not in list(Mode):
        raise ValueError("no mode of an MB1")


RECOGNITION = Recognition(MODBUS, recognise, starter=STARTER, lines=("baud=9600", "baud=19200"))
