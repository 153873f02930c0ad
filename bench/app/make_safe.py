"""Manual make-safe of a bench, also while a program holds it or instruments are missing."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from bench.app.arrival import MadeSafe, run_of
from bench.app.devices import open_devices
from bench.app.faults import laboratory_of
from bench.app.request import load_bench_named
from bench.clock import wall_utc
from bench.config.bench import LoadedBench
from bench.errors import InputError, InUseError, StoreError
from bench.lanes import Lane, longest_lane_s, make_safe_in_lanes
from bench.loop import AS_FAST_AS_POSSIBLE, REAL_TIME
from bench.loop import run as run_loop
from bench.rig import OWN_LIMIT_S, limits_to_make_safe
from bench.runner.held import (
    Kind,
    address_lock,
    energising_addresses,
    is_followed,
    owners,
    real_addresses,
    why_locked_out,
)
from bench.runner.takeover import END_BEYOND_S, take_over
from bench.store.energised import Energised, energised, note_safe, record_made_safe
from bench.store.machine_state import printable, problem_to_write
from bench.store.runs import summary
from drivers.safe_state import LONGEST_S
from drivers.timing.awake import succeeded_within
from drivers.transport.address import Address

_pause = threading.Event().wait
Notice = Callable[[str], object]
Made = Callable[[MadeSafe], object]


def make_safe(
    name: str | None, notice: Notice, ended: Callable[[Lane], object], made: Made = lambda _: None,
    *, if_left_on: bool = False,
) -> Iterator[Lane]:  # fmt: skip
    """Make the bench of a name or path safe; without one, every bench that a run may have left energised.

    Programs that hold the bench are ended. `notice` receives messages for a person, `ended` each lane as it ends, and
    `made` each bench; a registered bench whose file cannot be used is one lane. With `if_left_on` a bench is left as it
    is unless a finished run may have left an instrument of it on, and no guardian makes it safe or ends its hold.
    Raises InputError when there is nothing to make safe.
    """
    if name is not None:
        loaded = load_bench_named(name)
        if if_left_on and loaded.document.path.absolute() not in map(Path, _registered(notice, over=True)):
            notice(f"{loaded.document.path}: no run that is over has left an instrument on")
            return
        yield from _of_bench(loaded, notice, ended, made)
        return
    found = _registered(notice, over=if_left_on)
    if not found and not if_left_on:
        raise InputError("no run is on record that may have left instruments on; name the bench: --bench FILE")
    for path in found:
        try:
            loaded = load_bench_named(path)
        except InputError as problem:
            ended(lane := Lane(printable(path), "not reached", printable(str(problem)), 0.0))
            yield lane
        else:
            yield from _of_bench(loaded, notice, ended, made)


def _registered(notice: Notice, *, over: bool) -> list[str]:
    """Return the bench files of runs that may have left instruments on; with `over`, of finished runs only."""
    found: dict[str, None] = {}
    if over:
        _let_guardians_finish(notice)
    for each in energised(lambda problem: notice(str(problem))):
        if over and not _is_over(each):
            continue
        if over and all(map(is_followed, each.connections.values())):
            notice(printable(f"{each.name}: {', '.join(each.connections)} held; its guardian ends that"))
            continue
        notice(printable(f"{each.name}, started {each.since}: {', '.join(each.connections)} not known to be safe"))
        found[each.bench] = None
    return list(found)


def _is_over(left: Energised) -> bool:
    """Return True if a run has ended and nobody has its instruments; runs of other users may be unreadable."""
    return summary(Path(left.run)).state != "running" and not owners(_addresses(left))


def _addresses(left: Energised) -> list[Address]:
    """Return the valid addresses of an entry; other users may have edited it."""
    addresses = []
    for text in left.connections.values():
        with suppress(ValueError):
            addresses.append(Address.parse(text))
    return addresses


def _let_guardians_finish(notice: Notice) -> None:
    """Wait until no guardian is making a bench safe, at most for the time that this may take."""
    addresses = [address for found in energised(lambda _: None) for address in _addresses(found)]

    def is_released(limit_s: float) -> bool:
        busy = [owner for owner in owners(addresses) if owner.kind is Kind.RESCUE]
        return not busy or bool(_pause(limit_s))

    if not succeeded_within(is_released, longest_lane_s({"": LONGEST_S + OWN_LIMIT_S})):
        notice("A guardian has not made a bench safe in time.")


def _of_bench(loaded: LoadedBench, notice: Notice, ended: Callable[[Lane], object], made: Made) -> list[Lane]:
    bench, addresses = loaded.bench, list(real_addresses(loaded.bench).values())
    limits_s, why = limits_to_make_safe(bench), why_locked_out(bench)
    if addresses and (problem := problem_to_write()):
        notice(f"{problem}. Other users do not see that this bench is made safe.")
    if why:
        notice(f"{why}. Outputs are switched off, everything else is stopped where it is.")
    notice(f"{loaded.document.path}: {len(bench.devices)} instruments, at most {longest_lane_s(limits_s):g} s")

    async def main() -> list[Lane]:
        return await make_safe_in_lanes(open_devices(bench, laboratory_of(bench)), limits_s, ended, only_off=bool(why))

    with _uninterrupted(), ExitStack() as in_use:
        take_over(addresses, notice, max(limits_s.values(), default=0.0) + END_BEYOND_S)
        try:
            in_use.enter_context(address_lock(addresses, "bench make-safe"))
        except (InUseError, StoreError) as problem:  # a lock never prevents making safe
            notice(f"{problem}. The bench is made safe all the same.")
        lanes = run_loop(main(), AS_FAST_AS_POSSIBLE if bench.is_simulated else REAL_TIME)
        safe, run = {lane.role for lane in lanes if lane.state == "safe"}, run_of(loaded)
        _record(loaded, lanes, notice)
        made(MadeSafe(loaded, tuple(role for role in energising_addresses(bench) if role in safe), run))
        return lanes


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Ignore all signals but SIGKILL during the block; its duration is bounded."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
    before = {number: signal.signal(number, signal.SIG_IGN) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _record(loaded: LoadedBench, lanes: list[Lane], notice: Notice) -> None:
    """Record the outcome of the lanes, and remove safe instruments from the register."""
    connections = {role: str(address) for role, address in real_addresses(loaded.bench).items()}
    try:
        record_made_safe(loaded.document.path, wall_utc(), [lane._asdict() for lane in lanes])
        note_safe({connections[lane.role] for lane in lanes if lane.state == "safe" and lane.role in connections})
    except StoreError as problem:
        notice(str(problem))
