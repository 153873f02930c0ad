"""Many trials on a bad line: a reading while one answer suffers, held against what the instrument really reads."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from bench.app.laboratory import BenchWires, Laboratory, make_laboratory, unit_files
from bench.app.request import load_bench_named
from bench.config.models import BenchFile
from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.capabilities import Device
from drivers.description import Setup, make_driver
from drivers.errors import DriverError
from simulators.line_faults import HARMLESS, BadLine, LineFault
from tests.line_faults.cases import Case

RECOVERS_IN = 4  # readings
TOLERANCE = 1e-6
ALTERING = frozenset({LineFault.FLIP, LineFault.GARBAGE, LineFault.CUT, LineFault.ECHO})


@dataclass
class Tally:
    """What became of the faults on one dialect; `unexpected` are sentences that should not be there."""

    outcomes: Counter[str] = field(default_factory=Counter)
    unexpected: list[str] = field(default_factory=list)
    longest_s: float = 0.0

    @property
    def trials(self) -> int:
        return sum(self.outcomes.values())


class Chooser:
    """Gives one fault, to one answer from when it was armed."""

    def __init__(self) -> None:
        self.at, self.fault = -1, LineFault.SILENCE

    def __call__(self, number: int) -> LineFault | None:
        return self.fault if number == self.at else None


def play(name: str, case: Case, trials: int, seed: int, kinds: Iterable[LineFault] = tuple(LineFault)) -> Tally:
    """So many trials on one dialect, every kind of fault in turn; which answer of a reading suffers is drawn."""
    tally = Tally()
    bench = load_bench_named(case.bench).bench
    entry = case.of(bench.devices[case.role])
    bench = bench.model_copy(update={"devices": {**bench.devices, case.role: entry}})
    at_a_port = bench.devices[case.role].connection.scheme == "serial"
    faults = [kind for kind in kinds if not (at_a_port and kind is LineFault.HALF_OPEN)]  # a port has no other end
    still = bench.simulation.chamber.model_copy(update={"limit_cycle": 0.0})
    bench = bench.model_copy(update={"simulation": bench.simulation.model_copy(update={"chamber": still})})

    async def main() -> None:
        loop = asyncio.get_running_loop()
        laboratory = make_laboratory(bench, unit_files(bench, None), seed, loop.time)
        chooser = Chooser()
        bad = BadLine(seed, chooser, case.patience_s)
        draw = np.random.default_rng(seed)
        async with a_driver(bench, case, laboratory) as twin, a_driver(bench, case, laboratory, bad) as driver:
            for trial in range(trials):
                await case.vary(laboratory, twin, trial)
                await asyncio.sleep(case.settles_s)
                chooser.at = -1
                began = bad.answers
                await driver.poll()
                chooser.fault, answers = faults[trial % len(faults)], bad.answers - began
                truth = await read(twin)
                chooser.at = bad.answers + int(draw.integers(answers))
                where = (
                    f"{name}, seed {seed}, trial {trial}, {chooser.fault} at {chooser.at - bad.answers} of {answers}"
                )
                await one(driver, case, truth, chooser.fault, bad, tally, where)

    run(main(), AS_FAST_AS_POSSIBLE)
    return tally


async def one(
    driver: Device, case: Case, truth: dict[str, float], fault: LineFault, bad: BadLine, tally: Tally, where: str
) -> None:
    """One reading while an answer suffers, and readings until all is well again."""
    reported = 0
    for attempt in range(RECOVERS_IN):
        began_s, began = asyncio.get_running_loop().time(), len(bad.injected)
        try:
            found = await read(driver)
        except DriverError:
            reported += 1
            found = None
        took_s = asyncio.get_running_loop().time() - began_s
        tally.longest_s = max(tally.longest_s, took_s)
        if took_s > case.call_s:
            tally.unexpected.append(f"{where}: a reading took {took_s:.1f} s, at most {case.call_s:g} s are allowed")
        if found is None:
            continue
        if not alike(found, truth, case.moving):
            if attempt == 0 and not case.checked and fault in ALTERING and len(bad.injected) > began:
                tally.outcomes["wrong, but grammatical"] += 1
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
    tally.outcomes["reported" if reported else "absorbed"] += 1
    if reported and fault in HARMLESS:
        tally.unexpected.append(f"{where}: reported, though it is harmless")


def a_driver(bench: BenchFile, case: Case, laboratory: Laboratory, bad: BadLine | None = None) -> Device:
    """A driver of the instrument; on a bad line, where one is given."""
    entry = bench.devices[case.role]
    address = entry.connection
    if bad is None and address.scheme == "tcp":  # a port of its own, which leads to the same instrument
        address = replace(address, port=address.port + 10_000)
    moved = bench.model_copy(update={"devices": {case.role: entry.model_copy(update={"connection": address})}})
    wires = BenchWires(moved, laboratory, {} if bad is None else {case.role: bad})
    setup = Setup(case.role, address, wires, entry.options, entry.limits, entry.safe, entry.identity)
    return make_driver(entry.description, setup)


async def read(driver: Device) -> dict[str, float]:
    """The last value of every channel."""
    return {channel: readings[-1].value for channel, readings in (await driver.poll()).items() if readings}


def alike(found: dict[str, float], truth: dict[str, float], moving: frozenset[str]) -> bool:
    """Whether every value is the true one."""
    return found.keys() == truth.keys() and all(
        abs(found[key] - truth[key]) <= TOLERANCE * max(1.0, abs(truth[key])) for key in truth.keys() - moving
    )
