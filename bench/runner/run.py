"""Runs a plan on devices, with the record beside it; what a signal does."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bench.config.models import BenchFile
from bench.engine.engine import Engine, Observer, Outcome
from bench.engine.interlocks import Interlocks
from bench.engine.monitor import Monitor
from bench.engine.people import People
from bench.engine.questions import Desk
from bench.rig import OpenError, Rig
from bench.runner.commands import commands_of
from bench.runner.control import control_socket
from bench.runner.terminal import answers_from_terminal
from bench.sequence.plan import Plan
from bench.store.writer import RunWriter
from drivers.capabilities import Device
from drivers.values import Identity, Reading


async def run_plan(
    plan: Plan,
    bench: BenchFile,
    devices: Mapping[str, Device],
    writer: RunWriter,
    observer: Observer,
    on_reading: Callable[[str, Reading], None],
    teardown_s: float,
    *,
    folder: Path,
    can_pause: bool,
    on_desk: Callable[[Desk], object] | None = None,
    places: Collection[str] | None = None,
    people: People | None = None,
) -> tuple[Outcome, Mapping[str, Identity]]:
    """Opens the devices, runs the plan, makes everything safe, closes; how it ended, and who the devices were.

    SIGINT: the step ends and teardown runs; a second one, or SIGTERM, drops the teardown. `teardown_s` is its estimated
    duration, to be told. While it runs a control socket takes commands; it is named in `folder`. `on_desk` is given the
    desk at which questions are asked, before the first one. `places` are those with a unit in them; None for all.
    `people` are whom the devices ask.
    """
    rig = Rig(devices)
    try:
        async with rig:
            for role, identity in rig.identities.items():
                writer.event("identified", device=role, **_facts(identity))
            interlocks = Interlocks({**bench.interlocks, **plan.sequence.interlocks}, bench)
            monitor = Monitor(rig, bench, interlocks, writer, on_reading, places)
            in_use = bench.with_units_in(bench.places if places is None else places)
            engine = Engine(plan, in_use, rig, monitor, writer, observer)
            if people is not None:
                people.meet(engine.desk, engine.journal, observer.notice)
            if on_desk is not None:
                on_desk(engine.desk)
            commands = commands_of(engine, monitor, can_pause=can_pause)
            with (
                _signals(engine, observer, teardown_s),
                control_socket(folder, commands),
                answers_from_terminal(engine.desk, observer, can_wait=can_pause),
            ):
                return await engine.run(), rig.identities
    except OpenError as problem:
        writer.event("problem", text=str(problem))
        return Outcome("error", [str(problem)]), rig.identities


def _facts(identity: Identity) -> dict[str, Any]:
    return {
        "maker": identity.maker,
        "model": identity.model,
        "serial": identity.serial,
        "firmware": identity.firmware,
        "serial_verified": identity.verified,
        "fingerprint": identity.fingerprint,
    }


@contextmanager
def _signals(engine: Engine, observer: Observer, teardown_s: float) -> Iterator[None]:
    """While inside, SIGINT stops, then aborts; SIGTERM aborts. Outside the main thread signals are not ours."""
    loop = asyncio.get_running_loop()
    pressed = False

    def interrupt() -> None:
        nonlocal pressed
        if pressed or engine.in_teardown:
            observer.notice("Aborting: the teardown is dropped, all devices are made safe.")
            engine.abort()
            return
        pressed = True
        observer.notice(
            f"Stopping: teardown runs now and takes about {teardown_s / 60:.0f} min. Ctrl-C again drops it and makes "
            "the devices safe at once."
        )
        engine.stop()

    def terminate() -> None:
        observer.notice("Terminated: the teardown is dropped, all devices are made safe.")
        engine.abort()

    try:
        loop.add_signal_handler(signal.SIGINT, interrupt)
        loop.add_signal_handler(signal.SIGTERM, terminate)
    except (RuntimeError, ValueError):
        yield
        return
    try:
        yield
    finally:
        loop.remove_signal_handler(signal.SIGINT)
        loop.remove_signal_handler(signal.SIGTERM)
