"""Bad lines, bad buses, other instruments and other masters; each trial is a part of a campaign of its own."""

from __future__ import annotations

import asyncio
import math
import struct

import numpy as np

from bench.loop import AS_FAST_AS_POSSIBLE, run
from campaigns.can_faults import campaign as can
from campaigns.line_faults import campaign as line
from campaigns.line_faults.cases import CASES
from campaigns.line_faults.orders import ORDERS, play_orders
from campaigns.reliability.scorecard import LINES
from campaigns.swaps import campaign as swapped
from drivers.errors import DriverError
from tests.support.chambers import F4T_DIALECTS, Rig


def line_faults(number: int) -> str:
    """Readings, or orders, over one dialect after the other."""
    names = [*CASES, *(f"orders to {name}" for name in ORDERS)]
    name, count = names[number % len(names)], LINES["S1"].of
    seed = 1 + number // len(names)
    if name in CASES:
        return "; ".join(line.play(name, CASES[name], count, seed).unexpected)
    return "; ".join(play_orders(name.removeprefix("orders to "), count, seed).unexpected)


def can_faults(number: int) -> str:
    """Acquisitions of counters."""
    count = LINES["S2"].of
    return "; ".join(can.play(range(number * count, (number + 1) * count), 1).unexpected)


def swaps(number: int) -> str:
    """Instruments that exchange their ports, and somebody else who sets them."""
    count = LINES["S4"].of // 2
    tallies = swapped.swaps(count, number + 1), swapped.second_masters(count, number + 1)
    return "; ".join(each for tally in tallies for each in tally.unexpected)


def not_a_number(number: int) -> str:
    """Any 32 bits in the register of the air: the temperature that they are, or a DriverError."""
    draw, wrong = np.random.default_rng([3, number]), list[str]()

    async def main() -> None:
        rig = Rig(F4T_DIALECTS[0])
        async with rig.driver() as driver:
            for _ in range(LINES["S3"].of):
                bits = _bits(draw)
                (value,) = struct.unpack(">f", struct.pack(">I", bits))
                rig.instrument.measured_c = lambda value=value: value
                try:
                    found = (await driver.state()).process_value_c
                except DriverError:
                    continue
                if not math.isfinite(value) or found != value:
                    wrong.append(f"{bits:08x} is {value}, taken for {found}")
                await asyncio.sleep(0.1)

    run(main(), AS_FAST_AS_POSSIBLE)
    return "; ".join(wrong)


def _bits(draw: np.random.Generator) -> int:
    """Any; temperatures; infinities, not-a-numbers and zeros, and what is next to them."""
    kind = draw.integers(3)
    if kind == 0:
        return int(draw.integers(2**32))
    if kind == 1:
        return int.from_bytes(struct.pack(">f", draw.uniform(-60.0, 120.0)), "big")
    return (int(draw.choice([0x7F800000, 0xFF800000, 0x7FC00000, 0x7F7FFFFF, 0])) + int(draw.integers(-3, 4))) % 2**32
