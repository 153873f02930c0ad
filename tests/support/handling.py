"""Actions on instruments in tests: new values to read, commands of a driver, and messages of a second master."""

from __future__ import annotations

import math
import re
from collections.abc import Awaitable, Callable
from typing import Any

from bench.app.laboratory import Laboratory
from simulators.faults.instrument_faults import FaultPlan

Vary = Callable[[Laboratory, Any, Any, int], Awaitable[object]]
"""Given the laboratory, a second driver of the instrument on a good line, the one that is tried, and which trial."""
Act = Callable[[Any, float], Awaitable[object]]
"""Makes a driver command its instrument, with a setting that depends on a number from 0 to 1."""
Meddle = Callable[[Any, float], None]
"""Sends a message of a second master, with a setting that depends on a number from 0 to 1."""

# Something new to read


async def other_air(laboratory: Laboratory, _twin: Any, _driver: Any, trial: int) -> None:
    laboratory.world.ramp(20.0 + 0.37 * (trial % 50), math.inf)


async def other_volts(_laboratory: Laboratory, twin: Any, _driver: Any, trial: int) -> None:
    await set_volts(twin, trial)


async def other_amperes(_laboratory: Laboratory, twin: Any, _driver: Any, trial: int) -> None:
    await set_amperes(twin, trial)


async def standing_at_another(_laboratory: Laboratory, _twin: Any, driver: Any, trial: int) -> None:
    """The axis stands where the driver has sent it, so that it knows the angle to be one that does not change."""
    await move(driver, trial)


async def other_angle(laboratory: Laboratory, twin: Any, _driver: Any, trial: int) -> None:
    role = twin.name if twin.name in laboratory.world.axes else None
    laboratory.world.move(3.7 * (trial % 90), 1e6, 1e9, role)


async def other_reading(laboratory: Laboratory, twin: Any, driver: Any, trial: int) -> None:
    """A reading that stays, since no two of a real one are alike."""
    meter = laboratory.instruments[twin.name]
    meter.faults = FaultPlan(now_s=laboratory.world.now)
    await other_angle(laboratory, twin, driver, trial)
    await twin.poll()
    meter.faults.begin("frozen")


# Orders, and the value that is then read


async def set_volts(driver: Any, trial: int) -> float:
    """Another level of a supply, V."""
    level_v = 1.0 + 0.013 * (trial % 97)
    await driver.set(level_v, limit=0.15, output=True)
    return level_v


async def set_amperes(driver: Any, trial: int) -> float:
    """Another level of a current source, A."""
    level_a = 1e-3 + 7e-6 * (trial % 97)
    await driver.set(level_a, limit=10.0, output=True)
    return level_a


async def move(driver: Any, trial: int) -> float:
    """Another angle of an axis, °."""
    angle_deg = 3.7 * (1 + trial % 90)
    await driver.move_to(angle_deg, approach="direct", settle_s=0.0)
    return angle_deg


async def hold(driver: Any, _trial: int) -> None:
    await driver.hold()


# What a driver, or somebody else, tells one of two instruments


async def ramp(driver: Any, draw: float) -> None:
    await driver.ramp_to(25.0 + round(10 * draw), 1.0)


async def give_amperes(driver: Any, draw: float) -> None:
    await driver.set(1e-3 * (1 + round(5 * draw)), limit=10.0, output=True)


async def give_volts(driver: Any, draw: float) -> None:
    await driver.set(5.0 + round(5 * draw), limit=0.1, output=True)


async def turn(driver: Any, draw: float) -> None:
    await driver.rotate_at(10.0 + round(20 * draw), acceleration_dps2=20.0)


async def go(driver: Any, draw: float) -> None:
    await driver.move_to(90.0 + round(90 * draw), approach="direct", settle_s=0.5)


def told(*messages: str) -> Meddle:
    """Send messages on a separate connection, with a number from 2 to 6 in them."""

    def tell(instrument: Any, draw: float) -> None:
        session = instrument.session()
        for message in messages:
            session.feed(message.format(2 + round(4 * draw, 2)).encode())

    return tell


def framed(controller: Any, name: str, **values: float) -> None:
    """A frame from another interface of the controller."""
    shape = controller.profile.shape(name)
    forms = {key: controller.profile.number(getattr(shape, key)) for key in values}
    frame = controller.profile.format(name).build((forms[key], forms[key].raw(value)) for key, value in values.items())
    controller.carry_out(name, frame)


def turned_by_frame(controller: Any, draw: float) -> None:
    framed(controller, "rate", rate=2 + round(4 * draw, 2), acceleration=20.0)


# What is a question, judged by the bytes


def is_scpi_query(request: bytes) -> bool:
    return all(b"?" in part for part in re.split(rb"[;\r\n]", request) if part.strip())


def is_modbus_query(request: bytes) -> bool:
    """Of a frame on a serial line."""
    return request[1] not in (6, 16)


def is_modbus_tcp_query(request: bytes) -> bool:
    return request[7] not in (6, 16)


def is_cts_query(request: bytes) -> bool:
    return chr(request[2] & 0x7F).isupper()


def asks_by(pattern: bytes) -> Callable[[bytes], bool]:
    """Return a test for messages with this beginning."""
    return lambda request: re.match(pattern, request) is not None
