"""Making instruments safe with new drivers, each in its own lane, so that none delays another.

A lane connects, identifies, makes safe and closes. Nothing is sent to an instrument with another identity.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from typing import Literal, NamedTuple

from bench.rig import CLOSE_S, GRACE_S, make_safe_or_hold
from drivers.capabilities import Device, Source, ThermalChamber
from drivers.errors import BadAnswer, CannotConnect, DriverError, InstrumentFault, LinkLost, NoAnswer
from drivers.timing.awake import Deadline, fair_timeout

CONNECT_S = 10.0
STAYS_S = 1.0  # after which an output is read once more
AGAIN_S = 0.5  # an instrument with one client may hold a half-open connection for a while

State = Literal["safe", "held", "unsafe", "not reached"]


class Lane(NamedTuple):
    """Result of a lane: state, reason `why` if not safe, duration, and air temperature `air_c` of a chamber."""

    role: str
    state: State
    why: str
    took_s: float
    air_c: float | None = None


def longest_lane_s(limits_s: Mapping[str, float]) -> float:
    """Return the time in s within which every lane has ended."""
    return 2 * CONNECT_S + max(limits_s.values(), default=0.0) + 2 * STAYS_S + CLOSE_S + GRACE_S


async def make_safe_in_lanes(
    devices: Mapping[str, Device], limits_s: Mapping[str, float], ended: Callable[[Lane], object],
    *, only_off: bool = False, hold: Collection[str] = (),
) -> list[Lane]:  # fmt: skip
    """Make every device safe, in parallel; `ended` receives each lane as it ends.

    `limits_s` are the time limits of making safe, by role; no lane takes longer than `longest_lane_s`. With `only_off`
    outputs are switched off and everything else is stopped where it is. Chambers in `hold` stay at their set point.
    """
    longest_s = longest_lane_s(limits_s)

    async def one(role: str, device: Device) -> Lane:
        lane = await _lane(role, device, limits_s[role], only_off=only_off, hold=role in hold)
        ended(lane)
        return lane

    lanes = {role: asyncio.create_task(one(role, device), name=f"lane {role}") for role, device in devices.items()}
    if lanes:
        await asyncio.wait(lanes.values(), timeout=longest_s)
    for role, task in lanes.items():
        if not task.done():
            task.cancel()
            ended(_abandoned(role, longest_s))
    return [task.result() if task.done() else _abandoned(role, longest_s) for role, task in lanes.items()]


def _abandoned(role: str, longest_s: float) -> Lane:
    return Lane(role, "unsafe", f"{role}: not finished within {longest_s:g} s, and its driver does not end", longest_s)


async def _lane(role: str, device: Device, limit_s: float, *, only_off: bool, hold: bool) -> Lane:
    begun_s = asyncio.get_running_loop().time()

    def lane(state: State, why: str = "") -> Lane:
        return Lane(role, state, why, asyncio.get_running_loop().time() - begun_s)

    try:
        await _connect(device)
    except Exception as problem:  # noqa: BLE001  the lane reports any error
        return lane("not reached", _in_words(role, problem, CONNECT_S))
    try:
        async with fair_timeout(limit_s):
            held = await make_safe_or_hold(device, only_off=only_off, hold=hold)
        if on_again := await _on_again(device):
            return lane("unsafe", f"{role}: {on_again}")
    except Exception as problem:  # noqa: BLE001  the lane reports any error
        return lane("unsafe", _in_words(role, problem, limit_s))
    else:
        return lane("held" if held else "safe")._replace(air_c=await _air_c(device))
    finally:
        await _close(device)


async def _air_c(device: Device) -> float | None:
    """Return the air temperature of a chamber in °C; None for other devices and for one that does not answer."""
    if isinstance(device, ThermalChamber):
        with suppress(DriverError, TimeoutError):
            async with fair_timeout(STAYS_S):
                return (await device.state()).process_value_c
    return None


async def _on_again(device: Device) -> str:
    """Return the problem of an output that is on again shortly after it was switched off; "" otherwise."""
    if not isinstance(device, Source):
        return ""
    await asyncio.sleep(STAYS_S)
    with suppress(DriverError, TimeoutError):
        async with fair_timeout(STAYS_S):
            if (await device.read()).output:
                return "was switched on again after it was made safe. Look for the program or the person that does it."
    return ""


async def _connect(device: Device) -> None:
    """Connect and identify, repeatedly for CONNECT_S; raises the last DriverError, or TimeoutError."""
    limit = Deadline(CONNECT_S)
    async with fair_timeout(CONNECT_S):
        while True:
            try:
                await device.__aenter__()
            except (CannotConnect, LinkLost, NoAnswer):
                if limit.left_s <= AGAIN_S:
                    raise
                await asyncio.sleep(AGAIN_S)
            else:
                break
    try:
        await _identify(device)
    except BaseException:
        await _close(device)
        raise


async def _identify(device: Device) -> None:
    """Identify a device. Raises WrongIdentity; one that does not answer may be made safe all the same."""
    with suppress(NoAnswer, BadAnswer, LinkLost, InstrumentFault, TimeoutError):
        async with fair_timeout(CONNECT_S):
            await device.identify()


async def _close(device: Device) -> None:
    """Close the connection; errors are ignored, since they do not affect whether the instrument is safe."""
    with suppress(Exception):
        async with fair_timeout(CLOSE_S):
            await device.__aexit__(None, None, None)


def _in_words(role: str, problem: Exception, limit_s: float) -> str:
    if isinstance(problem, DriverError):
        return str(problem)
    if isinstance(problem, TimeoutError):
        return f"{role}: not finished within {limit_s:g} s"
    return f"{role}: {type(problem).__name__}: {problem}"
