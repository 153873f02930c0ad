"""Many trials on a bad line: an order that moves or energises while one answer suffers, and how often it was sent."""

from __future__ import annotations

import asyncio
import math
from collections import Counter
from collections.abc import Iterable, Mapping
from contextlib import suppress

import numpy as np

from bench.loop import AS_FAST_AS_POSSIBLE, run
from campaigns.line_faults.campaign import RECOVERS_IN, Stand, Tally, a_stand, read
from campaigns.line_faults.cases import CASES
from drivers.errors import DriverError
from simulators.faults.line_faults import LineFault
from tests.support.instruments import Order, tried

ANSWERS = 8
_TRIED = tried("orders")
ORDERS: Mapping[str, Order] = {
    name: case.line.order for name, case in CASES.items() if case.driver in _TRIED and case.line.order is not None
}


def play_orders(name: str, trials: int, seed: int, kinds: Iterable[LineFault] = tuple(LineFault)) -> Tally:
    """So many orders to one dialect: each is done or raises, and none is sent twice.

    In turn its own answer suffers, and one of the first that it takes.
    """
    case, order = CASES[name], ORDERS[name]
    at_a_port = case.entry.connection.scheme == "serial"
    faults = [kind for kind in kinds if not (at_a_port and kind is LineFault.HALF_OPEN)]

    async def main() -> Tally:
        stand = a_stand(case, seed)
        draw = np.random.default_rng(seed)
        async with stand.twin, stand.driver:
            for trial in range(trials):
                stand.chooser.disarm()
                await recover(stand)
                stand.chooser.fault = fault = faults[trial // 2 % len(faults)]
                where = f"{name}, seed {seed}, order {trial}, {fault}"
                if trial % 2:
                    at = int(draw.integers(ANSWERS))
                    stand.chooser.at = stand.bad.answers + at
                    where += f" at answer {at}"
                else:
                    stand.chooser.aims = lambda: order.heard.search(stand.bad.received_data[-1])
                await one(stand, order, trial, where)
        return stand.tally

    return run(main(), AS_FAST_AS_POSSIBLE)


async def one(stand: Stand, order: Order, trial: int, where: str) -> None:
    """One order while an answer suffers."""
    stand.bad.received_data.clear()
    stand.told.clear()
    try:
        given = await order.give(stand.driver, trial)
    except DriverError:
        outcome = "reported"
    else:
        outcome = "done"
        if given is not None and not is_there(found := (await read(stand.twin))[order.reading], given):
            outcome = "done otherwise"
            stand.tally.unexpected.append(f"{where}: said to be done, but {found} is there and not {given}")
    stand.tally.outcomes[outcome] += 1
    sent = Counter(found for data in stand.bad.received_data for found in order.heard.findall(data))
    stand.tally.unexpected += [f"{where}: {what!r} was sent {times} times" for what, times in sent.items() if times > 1]


def is_there(found: float, given: float) -> bool:
    """Return whether a reading is what was ordered, but for what instruments round, and whole turns that nobody
    watched."""
    return abs(math.remainder(found - given, 360.0)) <= 1e-3 * abs(given)


async def recover(stand: Stand) -> None:
    """Look until the driver has found its instrument again; what became of an order that failed is a fault to it."""
    await asyncio.sleep(40.0)  # longer than between two attempts to connect
    for _ in range(RECOVERS_IN):
        with suppress(DriverError):
            await stand.driver.poll()
