"""The dialects of chambers that speak Modbus, for the tests that all chambers pass."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from drivers.binder.wire import IDLE_LINE, LINES, MODE
from drivers.chamber.words import float32_words
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


def _binder(name: str, controller: str, register: int, **options: object) -> Dialect:
    def set_point(binder: Any, value_c: float) -> None:
        binder.write(register, float32_words(value_c, "low_first"))
        if binder.kind == "mb1":
            binder.write(MODE, (binder._mode,))

    return Dialect(
        name=name, driver="binder", address=SERVER, commands=writes(register),
        options={"controller": controller, "range": {"min": "-60 °C", "max": "180 °C"}, **options},
        set_point=set_point, take_over=lambda binder: binder.start_program(),
        switch_off=_written((MODE, 0)) if controller == "mb1" else _written((LINES, IDLE_LINE)),
        stranger=lambda binder: setattr(binder, "kind", "mb2" if controller == "mb1" else "mb1"), within_c=0.5,
    )  # fmt: skip


MODBUS_DIALECTS = [
    _f4(SERIAL),
    _f4(SERVER),
    _binder("binder-mb1", "mb1", 0x1581),
    _binder("binder-mb1-swapped", "mb1", 0x1581, set_point="basic", swapped=True),
    _binder("binder-mb1-basic", "mb1", 0x156F, set_point="basic"),
    _binder("binder-mb2", "mb2", 0x114C),
]
