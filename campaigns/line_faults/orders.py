"""Many trials on a bad line: an order that moves or energises while one answer suffers, and how often it was sent."""

from __future__ import annotations

import asyncio
import math
import re
from collections import Counter
from collections.abc import Awaitable, Callable, Iterable, Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from bench.loop import AS_FAST_AS_POSSIBLE, run
from campaigns.line_faults.campaign import RECOVERS_IN, Stand, Tally, a_stand, read
from campaigns.line_faults.cases import CASES, move, set_amperes, set_volts
from drivers.errors import DriverError
from simulators.faults.line_faults import LineFault


class Order(NamedTuple):
    """How one is given, what of it is heard on the wire, and the reading that then has the value it was given."""

    give: Callable[[Any, int], Awaitable[float | None]]
    heard: re.Pattern[bytes]
    reading: str = ""


async def _hold(driver: Any, _trial: int) -> None:
    await driver.hold()


ANSWERS = 8
_WRITE_TCP = re.compile(rb"(?s)^.{7}[\x06\x10].*")  # function 6 or 16
_WRITE_RTU = re.compile(rb"(?s)^.[\x06\x10].*")
_SET = re.compile(rb"(?:VOLT|CURR|LEV|OUTP) [^;]*")
ORDERS: Mapping[str, Order] = {
    "watlow_f4t, TCP": Order(_hold, _WRITE_TCP),
    "watlow_f4t, RTU": Order(_hold, _WRITE_RTU),
    "watlow_f4": Order(_hold, _WRITE_RTU),
    "binder": Order(_hold, _WRITE_RTU),
    "modbus_chamber, TCP": Order(_hold, _WRITE_TCP),
    "modbus_chamber, RTU": Order(_hold, _WRITE_RTU),
    "espec_p300": Order(_hold, re.compile(rb"TEMP, S.*")),
    "simserv": Order(_hold, re.compile(rb"11001.*")),
    "cts": Order(_hold, re.compile(rb"\xe1\xb0\xa0.*")),  # "a0 " with bit 7 set
    "aerotech_ensemble": Order(move, re.compile(rb"MOVEABS.*"), "angle"),
    "aerotech_ensemble, serial": Order(move, re.compile(rb"MOVEABS.*"), "angle"),
    "newport_xps": Order(move, re.compile(rb"GroupMoveAbsolute.*"), "angle"),
    "acutronic_acl": Order(move, re.compile(rb":DEM:POS.*"), "angle"),
    "framed_table, TCP": Order(move, re.compile(rb"(?s)\xaa\x55\x24.{12}"), "angle"),
    "framed_table, serial": Order(move, re.compile(rb"(?s)\xaa\x55\x24.{12}"), "angle"),
    "scpi_supply": Order(set_volts, _SET, "voltage"),
    "scpi_supply, serial": Order(set_volts, _SET, "voltage"),
    "keithley_6220": Order(set_amperes, _SET, "current"),
    "yokogawa_gs200": Order(set_amperes, _SET, "current"),
    "fluke_5700a": Order(set_amperes, re.compile(rb"OUT [^\r]*|OPER"), "current"),
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
                    stand.chooser.aims = lambda: order.heard.search(stand.bad.heard[-1])
                await one(stand, order, trial, where)
        return stand.tally

    return run(main(), AS_FAST_AS_POSSIBLE)


async def one(stand: Stand, order: Order, trial: int, where: str) -> None:
    """One order while an answer suffers."""
    stand.bad.heard.clear()
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
    sent = Counter(found for data in stand.bad.heard for found in order.heard.findall(data))
    stand.tally.unexpected += [f"{where}: {what!r} was sent {times} times" for what, times in sent.items() if times > 1]


def is_there(found: float, given: float) -> bool:
    """Whether a reading is what was ordered, but for what instruments round, and whole turns that nobody watched."""
    return abs(math.remainder(found - given, 360.0)) <= 1e-3 * abs(given)


async def recover(stand: Stand) -> None:
    """Looks until the driver has found its instrument again; what became of an order that failed is a fault to it."""
    await asyncio.sleep(40.0)  # longer than between two attempts to connect
    for _ in range(RECOVERS_IN):
        with suppress(DriverError):
            await stand.driver.poll()
