"""The dialects of chambers that speak Modbus, for the tests that all chambers pass."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tests.support.chambers import Dialect

SERIAL, SERVER = "serial:///dev/ttyUSB0?baud=9600", "socket://127.0.0.1:4001"


def writes(*registers: int) -> Callable[[bytes], bool]:
    """Whether a frame on a serial line writes one of these registers; any without."""

    def is_one(request: bytes) -> bool:
        return request[1] in (6, 16) and (not registers or int.from_bytes(request[2:4], "big") in registers)

    return is_one


def _written(*settings: tuple[int, int]) -> Callable[[Any], None]:
    """Somebody writes words to registers."""

    def write(instrument: Any) -> None:
        for register, word in settings:
            instrument.write(register, (word,))

    return write


def _f4(address: str) -> Dialect:
    return Dialect(
        driver="watlow_f4", address=address, options={"power_event": 2}, commands=writes(300),
        set_point=lambda f4, value_c: f4.write(300, (round(10 * value_c) & 0xFFFF,)),
        take_over=lambda f4: f4.start_profile(), switch_off=_written((2010, 0)),
        stranger=_written((602, -600 & 0xFFFF), (603, 1500)), limits=_written((602, -401 & 0xFFFF), (603, 801)),
        within_c=0.5,
    )  # fmt: skip


MODBUS_DIALECTS = [_f4(SERIAL), _f4(SERVER)]
