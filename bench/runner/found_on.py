"""Detection of energised instruments before the first command; nothing is changed."""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import NamedTuple

from bench.rig import Rig
from drivers.capabilities import Device, Positioner, RateTable, Source, ThermalChamber
from drivers.errors import DriverError
from drivers.timing.awake import fair_timeout

LOOKED_AT_WITHIN_S = 5.0
LOOKS_APART_S = 0.5  # readings of an axis: a swinging one is at rest for a moment
AWAY_C = 10.0  # a chamber set to room temperature does not count as left on
AT_REST_DPS = 0.05  # slower motion looks like encoder noise or a stiff position loop


class LeftOn(NamedTuple):
    """Devices that earlier runs have left on: the runs by device, and chambers held by a guardian until now."""

    by: Mapping[str, str] = MappingProxyType({})
    held: Collection[str] = ()


NOTHING = LeftOn()


class Found(NamedTuple):
    """Instrument found energised, as text and numbers (V, A, °/s, °C).

    `is_output` is True if its output is on, it moves, or it does not report its state; a chamber only heats or cools.
    """

    text: str
    values: Mapping[str, float]
    is_output: bool = True


async def found_energised(rig: Rig, roles: Collection[str]) -> dict[str, Found]:
    """Return devices with output on, in motion, or with a set point far from the safe one.

    One that does not report its state counts as energised.
    """
    devices = {role: device for role, device in rig.devices.items() if role in roles}
    found = await asyncio.gather(*(_look(device) for device in devices.values()))
    return {role: what for role, what in zip(devices, found, strict=True) if what is not None}


async def _look(device: Device) -> Found | None:
    try:
        async with fair_timeout(LOOKED_AT_WITHIN_S):
            if isinstance(device, Source):
                return await _output(device)
            if isinstance(device, ThermalChamber):
                return await _temperature(device)
            if isinstance(device, Positioner | RateTable):
                return await _motion(device)
    except DriverError as problem:
        return Found(f"does not report its state ({problem})", {})
    except TimeoutError:
        return Found(f"does not report its state within {LOOKED_AT_WITHIN_S:g} s", {})
    return None


async def _output(source: Source) -> Found | None:
    read = await source.read()
    if not read.output:
        return None
    values = {"current_a": read.current_a} | ({} if read.voltage_v is None else {"voltage_v": read.voltage_v})
    volts = "" if read.voltage_v is None else f"{read.voltage_v:.4g} V, "
    return Found(f"output on, {volts}{read.current_a:.4g} A", values)


async def _temperature(chamber: ThermalChamber) -> Found | None:
    state = await chamber.state()
    if state.from_safe_c is None or state.from_safe_c < AWAY_C:
        return None
    values = {"set_point_c": state.target_c, "process_value_c": state.process_value_c}
    text = f"set point {state.target_c:g} °C, air {state.process_value_c:.4g} °C"
    return Found(text, values, is_output=False)


async def _motion(axis: Positioner | RateTable) -> Found | None:
    before = await axis.angle()
    await asyncio.sleep(LOOKS_APART_S)
    now = await axis.angle()
    rates_dps = [(now.value - before.value) / (now.at_s - before.at_s)]
    if isinstance(axis, RateTable):
        rates_dps.append((await axis.rate()).value)
    fastest_dps = max(rates_dps, key=abs)
    if abs(fastest_dps) <= AT_REST_DPS:
        return None
    return Found(f"moves at {fastest_dps:.3g} °/s", {"rate_dps": fastest_dps})
