"""Exchanges of instruments, and second masters, drawn from a seed; every message has an intended receiver."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from typing import NamedTuple

import numpy as np

from bench.app.proposals import pinned
from bench.loop import AS_FAST_AS_POSSIBLE, run
from campaigns.swaps.kinds import KINDS, Kind
from campaigns.swaps.panel import Panel
from drivers.capabilities import Device
from drivers.description import IdentityPin
from drivers.errors import DriverError, InstrumentFault, WrongIdentity
from drivers.transport.address import Address
from tests.support.handling import ramp

BEFORE, AT_REST, AT_WORK = "before it was opened", "at rest", "at work"
RECONNECTS_WITHIN_S = 35.0  # the longest pause between two attempts, and what an attempt takes
DOING_LIMIT_S = 60.0
DOINGS = 7


@dataclass
class Tally:
    """Outcomes of the trials; `unexpected` are sentences that should not be there."""

    outcomes: Counter[str] = field(default_factory=Counter)
    unexpected: list[str] = field(default_factory=list)

    @property
    def trials(self) -> int:
        return sum(self.outcomes.values())


@dataclass(frozen=True)
class Seat:
    """A device of the bench in a trial."""

    role: str
    kind: Kind
    address: Address
    device: Device


def swaps(trials: int, seed: int = 1) -> Tally:
    """So many pairs of instruments that exchange their ports, before or after they were opened, at rest or at work."""
    tally = Tally()
    for trial in range(trials):
        draw = np.random.default_rng([seed, trial])
        run(_swap(trial, _drawn(trial, draw), draw, tally), AS_FAST_AS_POSSIBLE)
    return tally


@cache
def pin(kind: Kind, number: int) -> IdentityPin | None:
    """Identity that a bench file pins: all that the instrument reports; None if its driver refuses it."""

    async def told() -> IdentityPin | None:
        panel, address = Panel(), Address.parse(kind.address)
        panel.put("one", kind.instrument(number), address)
        try:
            async with kind.driver_on(panel, "one", address, IdentityPin()) as device:
                return IdentityPin(**pinned(await device.identify()))
        except WrongIdentity:
            return None

    return run(told(), AS_FAST_AS_POSSIBLE)


class Pair(NamedTuple):
    """Two instruments that are swapped, what a bench file pins of each, and when it happens."""

    kinds: tuple[Kind, Kind]
    pins: tuple[IdentityPin | None, IdentityPin | None]
    when: str

    @property
    def alike(self) -> bool:
        return self.kinds[0] is self.kinds[1]


def _drawn(trial: int, draw: np.random.Generator) -> Pair:
    """Every kind in its turn, with another one of it, or with one of another driver.

    Two of a kind where the wire tells them apart: by what a bench file pins, or else, once they were opened, by what
    the wire told then.
    """
    first = KINDS[trial % len(KINDS)]
    when = (BEFORE, AT_REST, AT_WORK)[int(draw.integers(3))]
    pins = pin(first, 0), pin(first, 1)
    if draw.random() < 0.5 and pins[1] is not None:
        return Pair((first, first), pins, AT_WORK if when == BEFORE and pins[0] == pins[1] else when)
    others = [kind for kind in KINDS if kind.driver != first.driver]
    second = others[int(draw.integers(len(others)))]
    return Pair((first, second), (pins[0], pin(second, 0)), when)


async def _swap(trial: int, pair: Pair, draw: np.random.Generator, tally: Tally) -> None:
    panel, when = Panel(), pair.when
    seats = [_seat(panel, number, pair) for number in (0, 1)]
    where = f"trial {trial}, {pair.kinds[0].name} and {pair.kinds[1].name} swapped {when}"
    if when == BEFORE:
        panel.swap()
    for seat in seats:
        if await _opened(seat) is (when == BEFORE):
            tally.unexpected.append(f"{where}: {seat.role} was opened, or was not, and should not have been so")
    working = []
    if when == AT_WORK:
        working = [asyncio.create_task(seat.kind.act(seat.device, float(draw.random()))) for seat in seats]
        await asyncio.sleep(float(draw.uniform(0.02, 20.0)))
    if when != BEFORE:
        panel.swap()
    for seat in seats:
        tally.unexpected += [f"{where}: {each}" for each in _judged(seat, pair, await _refusals(seat, draw.random()))]
    ended = await asyncio.gather(*working, return_exceptions=True)
    tally.unexpected += [f"{where}: {each!r}" for each in ended if _is_other(each)]
    tally.unexpected += [f"{where}: {each}" for each in _wrongly_told(panel, seats)]
    if when != BEFORE:
        panel.swap()
        tally.unexpected += [f"{where}: {each}" for each in await _not_found_again(seats)]
    tally.outcomes[when] += 1


def _is_other(ended: object) -> bool:
    """Return whether a piece of work ended by something else than a refusal, or in peace."""
    return isinstance(ended, BaseException) and not isinstance(ended, DriverError)


async def _opened(seat: Seat) -> bool:
    with suppress(DriverError):
        await seat.device.__aenter__()
        await seat.device.identify()
        return True
    return False


def _seat(panel: Panel, number: int, pair: Pair) -> Seat:
    role, kind = "ab"[number], pair.kinds[number]
    address = Address.parse(kind.address)
    if str(address) in panel.patched:
        other = kind.address.replace("127.0.0.1", "127.0.0.2").replace("serial:///", "serial:///b/")
        address = Address.parse(other)
    panel.put(role, kind.instrument(number if pair.alike else 0), address)
    return Seat(role, kind, address, kind.driver_on(panel, role, address, pair.pins[number] or IdentityPin()))


async def _refusals(seat: Seat, draw: float) -> list[DriverError]:
    """Errors of a driver in all steps of a run while another instrument is in its place."""
    found: list[DriverError] = []
    doings: list[Callable[[], Awaitable[object]]] = [
        seat.device.poll, lambda: seat.kind.act(seat.device, draw), seat.device.make_safe, seat.device.identify,
        seat.device.poll, lambda: seat.kind.act(seat.device, draw), seat.device.make_safe,
    ]  # fmt: skip
    for number, doing in enumerate(doings, 1):
        try:
            async with asyncio.timeout(DOING_LIMIT_S):
                await doing()
        except DriverError as problem:
            found.append(problem)
        except TimeoutError:  # it goes on as if nothing were wrong
            pass
        if number == 4:
            await asyncio.sleep(RECONNECTS_WITHIN_S)
    return found


def _judged(seat: Seat, pair: Pair, refusals: list[DriverError]) -> Iterator[str]:
    """Problems in the errors of a driver."""
    if len(refusals) < DOINGS:
        yield f"{seat.role} took {DOINGS - len(refusals)} of {DOINGS} things for done: {refusals}"
    if pair.alike and not any(isinstance(problem, WrongIdentity) for problem in refusals):
        yield f"{seat.role} never said that it is another: {refusals}"


def _wrongly_told(panel: Panel, seats: list[Seat]) -> Iterator[str]:
    """Commands that reached another instrument than the one they were meant for."""
    asks = {seat.role: seat.kind.asks for seat in seats}
    for heard in panel.heard:
        if heard.owner != heard.speaker and not asks[heard.speaker](heard.data):
            yield f"{heard.speaker} told {heard.owner} {heard.data!r}"


async def _not_found_again(seats: list[Seat]) -> list[str]:
    """Drivers that do not reconnect once the instruments are in their own places; the connections are closed then."""
    await asyncio.sleep(RECONNECTS_WITHIN_S)
    missing = []
    for seat in seats:
        with suppress(DriverError):  # the lost connection may be told first
            await seat.device.identify()
        await asyncio.sleep(RECONNECTS_WITHIN_S)
        try:
            await seat.device.identify()
        except DriverError as problem:
            missing.append(f"{seat.role} is not found again: {problem}")
        await seat.device.__aexit__(None, None, None)
    return missing


# Second masters


def second_masters(trials: int, seed: int = 1) -> Tally:
    """So many instruments that somebody else sets otherwise; the next look of the driver that set them must say so."""
    tally = Tally()
    for trial in range(trials):
        draw = np.random.default_rng([seed, trial])
        kind = KINDS[trial % len(KINDS)]
        run(_foreign(kind, f"trial {trial}, {kind.name}", draw, tally), AS_FAST_AS_POSSIBLE)
    return tally


async def _foreign(kind: Kind, where: str, draw: np.random.Generator, tally: Tally) -> None:
    panel, address = Panel(), Address.parse(kind.address)
    panel.put("mine", kind.instrument(0), address)
    mine = kind.driver_on(panel, "mine", address, IdentityPin())
    async with mine:
        work = asyncio.create_task(kind.act(mine, 0.0))
        if kind.act is not ramp or draw.random() < 0.5:  # every chamber may be met on its way as well
            await work
        await asyncio.sleep(float(draw.uniform(4.0, 18.0)))  # it has been commanded, and is perhaps on its way
        await panel.quiet()
        kind.meddle(panel.instruments["mine"], float(draw.random()))
        await asyncio.sleep(float(draw.uniform(2.0, 10.0)))  # the next look at a device that no reading comes from
        try:
            await mine.poll()
            tally.unexpected.append(f"{where}: nobody saw it")
        except InstrumentFault:
            tally.outcomes["found"] += 1
        except DriverError as problem:
            tally.unexpected.append(f"{where}: {problem}")
        work.cancel()
        await asyncio.gather(work, return_exceptions=True)
