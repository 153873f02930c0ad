"""Runs a plan on devices, with the record beside it; what a signal does."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bench.config.models import BenchFile
from bench.engine.engine import Engine, Observer, Outcome
from bench.engine.interlocks import Interlocks
from bench.engine.monitor import Monitor
from bench.errors import InputError
from bench.rig import OpenError, Rig
from bench.runner.control import Handlers, control_socket
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
) -> tuple[Outcome, Mapping[str, Identity]]:
    """Opens the devices, runs the plan, makes everything safe, closes; how it ended, and who the devices were.

    SIGINT: the step ends and teardown runs; a second one, or SIGTERM, drops the teardown. `teardown_s` is its estimated
    duration, to be told. While it runs a control socket takes commands; it is named in `folder`.
    """
    rig = Rig(devices)
    try:
        async with rig:
            for role, identity in rig.identities.items():
                writer.event("identified", device=role, **_facts(identity))
            interlocks = Interlocks({**bench.interlocks, **plan.sequence.interlocks}, bench)
            monitor = Monitor(rig, bench, interlocks, writer, on_reading)
            engine = Engine(plan, bench, rig, monitor, writer, observer)
            with _signals(engine, observer, teardown_s), control_socket(folder, _commands(engine, can_pause)):
                return await engine.run(), rig.identities
    except OpenError as problem:
        writer.event("problem", text=str(problem))
        return Outcome("error", [str(problem)]), rig.identities


def _commands(engine: Engine, can_pause: bool) -> Handlers:
    """What the control socket takes, each as a function that does it and says so."""

    def pause() -> str:
        if not can_pause:
            raise InputError("in virtual time at full speed nothing can be paused; run it with --speed 60, say")
        if engine.in_teardown:
            raise InputError("the teardown is under way, which is not paused")
        engine.pause()
        return "it pauses before its next step"

    def resume() -> str:
        engine.resume()
        return "it goes on"

    def stop() -> str:
        engine.stop()
        return "the step under way ends, teardown runs"

    def stop_after_step() -> str:
        engine.stop_after_step()
        return "teardown runs after the step under way"

    def abort() -> str:
        engine.abort()
        return "the teardown is dropped, all devices are made safe"

    return {"pause": pause, "resume": resume, "stop": stop, "stop_after_step": stop_after_step, "abort": abort}


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
