"""Many trials on a bad line: a reading while one answer suffers, held against what the instrument really reads."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from bench.app.laboratory import BenchWires, Laboratory, make_laboratory, unit_files
from bench.config.devices import DeviceEntry
from bench.config.models import BenchFile
from bench.loop import AS_FAST_AS_POSSIBLE, run
from campaigns.line_faults.cases import Case, Link
from drivers.can.options import FRAME_SCHEMES
from drivers.capabilities import Device
from drivers.description import Setup, ignore_note, make_driver
from drivers.errors import DriverError
from simulators.faults.line_faults import HARMLESS, FaultyLine, Injected, LineFault
from tests.support.instruments import bench_named

RECOVERS_IN = 4  # readings
TOLERANCE = 1e-6
ALTERING = frozenset({LineFault.FLIP, LineFault.GARBAGE, LineFault.CUT, LineFault.ECHO})
GRAMMATICAL = "wrong, but grammatical"
LOSING = frozenset({
    LineFault.SILENCE, LineFault.CUT, LineFault.RESET, LineFault.HALF_OPEN, LineFault.SLOW_CLOSE, LineFault.GARBAGE,
})  # fmt: skip
"""Nobody can bear one of these without noticing: it is reported, or the driver tells that it asked again."""


@dataclass
class Tally:
    """Outcomes of the faults on one dialect; `unexpected` are sentences that should not be there."""

    outcomes: Counter[str] = field(default_factory=Counter)
    unexpected: list[str] = field(default_factory=list)
    longest_s: float = 0.0

    @property
    def trials(self) -> int:
        return sum(self.outcomes.values())


class Chooser:
    """Gives one fault: to the answer with a number, or to the first one to what `aims` says is to suffer."""

    def __init__(self) -> None:
        self.at, self.fault = -1, LineFault.SILENCE
        self.aims: Callable[[], object] = lambda: False

    def __call__(self, number: int) -> LineFault | None:
        if number != self.at and not self.aims():
            return None
        self.disarm()
        return self.fault

    def disarm(self) -> None:
        """Let all answers pass."""
        self.at, self.aims = -1, lambda: False


@dataclass
class Stand:
    """One instrument with two drivers: a twin on a good line, and the one that is tried. `told` are its notes."""

    case: Case
    laboratory: Laboratory
    twin: Device
    driver: Device
    bad: FaultyLine
    chooser: Chooser
    told: list[str]
    tally: Tally


def play(name: str, case: Case, trials: int, seed: int, kinds: Iterable[LineFault] = tuple(LineFault)) -> Tally:
    """So many trials on one dialect, every kind of fault in turn; which answer of a reading suffers is drawn."""
    at_a_port = case.entry.connection.scheme == "serial"
    faults = [kind for kind in kinds if not (at_a_port and kind is LineFault.HALF_OPEN)]  # a port has no other end

    async def main() -> Tally:
        stand = a_stand(case, seed)
        draw = np.random.default_rng(seed)
        async with stand.twin, stand.driver:
            for trial in range(trials):
                truth, answers = await quiet(stand, trial)
                fault, at = faults[trial % len(faults)], int(draw.integers(answers))
                stand.chooser.fault, stand.chooser.at = fault, stand.bad.answers + at
                await one(stand, truth, fault, f"{name}, seed {seed}, trial {trial}, {fault} at {at} of {answers}")
        return stand.tally

    return run(main(), AS_FAST_AS_POSSIBLE)


async def quiet(stand: Stand, trial: int) -> tuple[dict[str, float], int]:
    """Give the instrument something new to read: what it then reads, and in how many answers the driver reads it."""
    stand.chooser.disarm()
    await stand.case.line.vary(stand.laboratory, stand.twin, stand.driver, trial)
    await asyncio.sleep(stand.case.instrument.settles_s)
    began = stand.bad.answers
    await stand.driver.poll()
    answers = stand.bad.answers - began
    stand.told.clear()
    return await read(stand.twin), answers


async def one(stand: Stand, truth: dict[str, float], fault: LineFault, where: str) -> None:
    """One reading while an answer suffers, and readings until all is well again."""
    case, bad, tally = stand.case, stand.bad, stand.tally
    reported = 0
    for attempt in range(RECOVERS_IN):
        began_s, began = asyncio.get_running_loop().time(), len(bad.injected)
        try:
            found = await read(stand.driver)
        except DriverError:
            found = None
        took_s = asyncio.get_running_loop().time() - began_s
        tally.longest_s = max(tally.longest_s, took_s)
        if took_s > (most_s := case.line.call_s):
            tally.unexpected.append(f"{where}: a reading took {took_s:.1f} s, at most {most_s:g} s are allowed")
        if found is None or (found.keys() != truth.keys() and stand.told):  # no reading, and it says why
            reported += 1
            continue
        if not alike(found, truth, case.instrument.moving):
            altered = attempt == 0 and fault in ALTERING and len(bad.injected) > began
            if altered and case.link is not Link.CHECKSUM:
                tally.outcomes[GRAMMATICAL] += 1
                return
            tally.outcomes["wrong"] += 1
            tally.unexpected.append(f"{where}: read {found}, true is {truth}; on the wire {bad.injected[-1]}")
            return
        if attempt > 0 or fault is not LineFault.DUPLICATE:
            break
    else:
        tally.outcomes["not recovered"] += 1
        tally.unexpected.append(f"{where}: no reading in {RECOVERS_IN}")
        return
    outcome = "reported" if reported else "asked again" if stand.told else "borne"
    tally.outcomes[outcome] += 1
    if outcome == "reported" and fault in HARMLESS:
        tally.unexpected.append(f"{where}: reported, though it is harmless")
    if outcome == "borne" and fault in LOSING and case.instrument.tells_each and spoilt(bad.injected[-1]):
        tally.unexpected.append(f"{where}: nobody told of it; on the wire {bad.injected[-1]}")


def spoilt(injected: Injected) -> bool:
    """Return whether more than spaces came before an answer, which may be there in any case."""
    return injected.altered.lstrip(b" ") != injected.answer.lstrip(b" ")


def a_stand(case: Case, seed: int) -> Stand:
    """The laboratory of a case, in the running loop, its instrument on a line that is still good."""
    bench = bench_named(case.instrument.bench)
    bench = bench.model_copy(update={"devices": asked(bench) | {case.instrument.role: case.entry}})
    still = bench.simulation.chamber.model_copy(update={"limit_cycle": 0.0})
    bench = bench.model_copy(update={"simulation": bench.simulation.model_copy(update={"chamber": still})})
    laboratory = make_laboratory(bench, unit_files(bench, None), seed, asyncio.get_running_loop().time)
    chooser, told = Chooser(), list[str]()
    bad = FaultyLine(seed, chooser, case.instrument.client_timeout_s)
    twin, driver = a_driver(bench, case, laboratory), a_driver(bench, case, laboratory, bad, told.append)
    return Stand(case, laboratory, twin, driver, bad, chooser, told, Tally())


def asked(bench: BenchFile) -> dict[str, DeviceEntry]:
    """The devices that answer; to simulate those that send frames by themselves takes ten times as long."""
    return {role: entry for role, entry in bench.devices.items() if entry.connection.scheme not in FRAME_SCHEMES}


def a_driver(
    bench: BenchFile, case: Case, laboratory: Laboratory, bad: FaultyLine | None = None,
    note: Callable[[str], object] = ignore_note,
) -> Device:  # fmt: skip
    """A driver of the instrument; on a bad line, where one is given."""
    role = case.instrument.role
    entry = bench.devices[role]
    address = entry.connection
    if bad is None and address.scheme == "tcp":  # a port of its own, which leads to the same instrument
        address = replace(address, port=address.port + 10_000)
    moved = bench.model_copy(update={"devices": {role: entry.model_copy(update={"connection": address})}})
    wires = BenchWires(moved, laboratory, {} if bad is None else {role: bad})
    setup = Setup(role, address, wires, entry.options, entry.limits, entry.safe, entry.identity, note)
    return make_driver(entry.description, setup)


async def read(driver: Device) -> dict[str, float]:
    """The last value of every channel."""
    return {channel: readings[-1].value for channel, readings in (await driver.poll()).items() if readings}


def alike(found: dict[str, float], truth: dict[str, float], moving: frozenset[str]) -> bool:
    """Return whether every value is the true one."""
    return found.keys() == truth.keys() and all(
        abs(found[key] - truth[key]) <= TOLERANCE * max(1.0, abs(truth[key])) for key in truth.keys() - moving
    )
