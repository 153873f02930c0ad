"""The dialects of chambers that speak Modbus, for the tests that all chambers pass."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from bench.config.load import load_file
from drivers.dialects.binder.wire import IDLE_LINE, LINES, MODE
from drivers.dialects.modbus_chamber.profile import ChamberProfile
from drivers.kinds.chamber.words import float32_words
from drivers.schema.fields import DocumentFile
from tests.support.chambers import Dialect
from tests.support.handling import is_modbus_query, is_modbus_tcp_query
from tests.support.runs import ROOT

SERIAL, SERVER = "serial:///dev/ttyUSB0?baud=9600", "socket://127.0.0.1:4001"


def writes(*registers: int) -> Callable[[bytes], bool]:
    """Return whether a frame on a serial line writes one of these registers; any without."""

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
        driver="watlow_f4", address=address, options={"power_event": 2}, commands=writes(300), asks=is_modbus_query,
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
        name=name, driver="binder", address=SERVER, commands=writes(register), asks=is_modbus_query,
        options={"controller": controller, "range": {"min": "-60 °C", "max": "180 °C"}, **options},
        set_point=set_point, take_over=lambda binder: binder.start_program(),
        switch_off=_written((MODE, 0)) if controller == "mb1" else _written((LINES, IDLE_LINE)),
        stranger=lambda binder: setattr(binder, "kind", "mb2" if controller == "mb1" else "mb1"), within_c=0.5,
    )  # fmt: skip


FICTIONAL = load_file(ROOT / "config/chambers/fictional.yaml", ChamberProfile)
PLAIN = ChamberProfile.model_validate({
    "schema": "itb-chamber/1", "maker": "Nobody", "model": "Plain", "source": "this test",
    "process_value": {"address": 7, "read": 4, "scale": 0.1}, "set_point": {"address": 7, "scale": 0.1, "write": 16},
    "range": {"min": "-60 °C", "max": "160 °C"},
    "must_be": [{"address": 1, "is": 3, "means": "it is a Plain"}],
    "mode": {"address": 8, "follows": [5, 6], "off": [0], "start": 5},
})  # fmt: skip
HOURLY = ChamberProfile.model_validate({
    "schema": "itb-chamber/1", "maker": "Nobody", "model": "Hourly", "source": "this test", "word_order": "high_first",
    "process_value": {"address": 0, "type": "int32", "scale": 0.001},
    "set_point": {"address": 2, "type": "int32", "scale": 0.001, "write": 16},
    "set_point_in_force": {"address": 4, "type": "float32", "word_order": "low_first"},
    "limits": {
        "min": {"address": 6, "type": "int32", "scale": 0.001}, "max": {"address": 8, "type": "int32", "scale": 0.001}
    },
    "mode": {"address": 10, "follows": [1], "off": [0], "other": {"a program runs": 2}},
    "ramp": {"rate": {"address": 12, "type": "uint32", "scale": 0.01, "write": 16}, "per": "hour"},
})  # fmt: skip


def _profile(name: str, profile: ChamberProfile, address: str, **more: Any) -> Dialect:
    is_tcp = address.startswith("tcp:")
    form, register, mode = profile.form(profile.set_point), profile.set_point.address, profile.mode
    assert mode is not None
    may_start, at_rest = mode.start is not None, mode.off[0]

    def strange(simulated: Any) -> None:
        simulated.limits_c = (-50.0, 120.0)
        simulated._expected = [0 for _ in simulated._expected]

    def limited(simulated: Any) -> None:
        simulated.limits_c = (-40.1, 80.1)

    return Dialect(
        name=name, driver="modbus_chamber", address=address,
        commands=lambda request: writes(register)(request[6:] if is_tcp else request),
        asks=is_modbus_tcp_query if is_tcp else is_modbus_query,
        options={"profile": DocumentFile(Path("a_profile.yaml"), profile)},
        set_point=lambda simulated, value_c: simulated.write(register, form.words(value_c)),
        take_over=lambda simulated: simulated.take_over(9),
        switch_off=lambda simulated: setattr(simulated, "mode", at_rest),
        stranger=strange, gives_back=may_start, switched_on=may_start,
        limits=limited if profile.limits is not None else None, within_c=0.5, **more,
    )  # fmt: skip


F4_DIALECTS = (_f4(SERIAL),)
BINDER_DIALECTS = (
    _binder("binder-mb1", "mb1", 0x1581),
    _binder("binder-mb1-swapped", "mb1", 0x1581, set_point="basic", swapped=True),
    _binder("binder-mb2", "mb2", 0x114C),
)
PROFILE_DIALECTS = (
    _profile("profile-fictional-tcp", FICTIONAL, "tcp://127.0.0.1:502"),
    _profile("profile-fictional-serial", FICTIONAL, SERIAL),
    _profile("profile-plain", PLAIN, SERVER),
    _profile("profile-hourly", HOURLY, SERVER),
)
