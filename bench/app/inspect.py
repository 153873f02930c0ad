"""Identify and read the instruments of a bench, without a run."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

from bench.app.devices import open_devices
from bench.app.faults import laboratory_of
from bench.app.request import load_bench_named
from bench.config.models import BenchFile
from bench.loop import AS_FAST_AS_POSSIBLE, REAL_TIME
from bench.loop import run as run_loop
from bench.runner.held import address_lock, real_addresses
from drivers.capabilities import Device
from drivers.errors import DriverError

LOOK_S = 30.0


@dataclass(frozen=True)
class Look:
    """Identity and readings of one instrument, or its error."""

    role: str
    driver: str
    connection: str
    text: str
    problem: bool

    def line(self) -> str:
        """Line for a terminal."""
        return f"{self.role:<10} {self.driver:<18} {self.connection:<44} {self.text}"


def inspect_devices(name: str | None, *, simulate: bool = False) -> list[Look]:
    """Connect to every instrument of a bench, identify it and read it once; errors are in the results.

    Raises InUseError while another program talks to one of them.
    """
    bench = load_bench_named(name, simulate=simulate).bench

    async def main() -> list[Look]:
        devices = open_devices(bench, laboratory_of(bench))
        return list(await asyncio.gather(*(_look(bench, role, device) for role, device in devices.items())))

    with address_lock(real_addresses(bench).values(), "a look at the devices"):
        return run_loop(main(), AS_FAST_AS_POSSIBLE if bench.is_simulated else REAL_TIME)


async def _look(bench: BenchFile, role: str, device: Device) -> Look:
    entry = bench.devices[role]
    problem = False
    try:
        async with asyncio.timeout(LOOK_S), device:
            identity = await device.identify()
            await asyncio.sleep(1.5 * entry.description.reports_every_s)
            readings = await device.poll()
        stated = "" if identity.verified else f" (serial stated, not verified; {identity.fingerprint})"
        units = entry.channels
        values = ", ".join(
            f"{key} {found[-1].value:.5g} {units.get(key, '')}".rstrip() for key, found in readings.items() if found
        )
        text = f"{identity.words}{stated}; {values}" if values else f"{identity.words}{stated}"
    except DriverError as error:
        text, problem = str(error), True
    except TimeoutError:
        text, problem = f"no answer within {LOOK_S:g} s", True
    return Look(role, entry.driver, str(entry.connection), text, problem)
