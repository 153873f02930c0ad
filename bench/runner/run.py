"""Execution of a plan on devices with its record, and handling of signals in each phase."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path

from bench.config.models import BenchFile
from bench.engine.ending import Outcome
from bench.engine.engine import Engine, Observer
from bench.engine.interlocks import Interlocks
from bench.engine.journal import Journal
from bench.engine.monitor import Monitor
from bench.engine.past import Past
from bench.engine.people import People
from bench.engine.pulse import Pulse
from bench.engine.questions import PromptQueue
from bench.engine.safety import finish
from bench.errors import StoreError, error_message
from bench.quality import Judged
from bench.rig import CLOSE_S, OpenError, Rig, limits_to_make_safe
from bench.runner.commands import commands_of
from bench.runner.control import Handlers, control_socket
from bench.runner.found_on import NOTHING, Found, LeftOn, found_energised
from bench.runner.held import energising_addresses, is_locked_out
from bench.runner.manifest import facts
from bench.runner.orders import orders_of
from bench.runner.power import Hold
from bench.runner.signals import EndSignal, Signals
from bench.runner.terminal import answers_from_terminal
from bench.sequence.plan.plan import Plan
from bench.sequence.plan.used import devices_used
from drivers.capabilities import Device
from drivers.values import Identity

POWER_FAILURE = "power failure"


async def run_plan(
    plan: Plan,
    bench: BenchFile,
    devices: Mapping[str, Device],
    journal: Journal,
    observer: Observer,
    on_reading: Callable[[str, Judged], None],
    teardown_s: float,
    *,
    folder: Path,
    can_pause: bool,
    signals: Signals,
    hold: Hold,
    on_prompts: Callable[[PromptQueue], object] | None = None,
    places: Collection[str] | None = None,
    people: People | None = None,
    past: Past | None = None,
    left_on: LeftOn = NOTHING,
    pulse: Pulse | None = None,
) -> tuple[Outcome, Mapping[str, Identity]]:
    """Open the devices, run the plan, make everything safe and close; return the outcome and the identities.

    All errors are in the outcome. Opened devices are made safe, also if others failed to open; those are named. A
    signal ends the opening, or the run as `_acting` says. `teardown_s` is the estimated duration of the teardown, for a
    message. A control socket, named in `folder`, takes commands during the run. `on_prompts` receives the desk that
    queues questions, before the first one. `hold` holds the run while its computer is on battery. `places` are those
    with a unit; None for all. `people` answer requests of the devices. `past` is the part done before an interruption.
    If other runs may have `left_on` devices, or a real instrument is found energised, everything but a held chamber is
    made safe before the first step. The guardian of the run reads `pulse`.
    """
    rig = Rig(devices, limits_to_make_safe(bench), partial(is_locked_out, bench))
    in_use = bench.with_units_in(bench.places if places is None else places)
    used = devices_used(plan, in_use)
    outcome: Outcome | None = None
    try:
        await _open(rig, used, signals)
        _report_identities(rig, journal, observer)
        found = await _energised_before(rig, bench, left_on, journal, observer, signals)
        if left_on.by or found:
            await _make_left_on_safe(rig, left_on, journal)
        if past is not None and past.credit is not None and signals.first is None:
            if names := ", ".join({**left_on.by, **found}):
                past.credit.rule_out(f"{names} was found energised")
            await past.credit.look(rig)
        if signals.first is None:
            interlocks = Interlocks({**bench.interlocks, **plan.sequence.interlocks}, bench)
            monitor = Monitor(rig, bench, interlocks, journal, on_reading, places, used)
            pulse = pulse or Pulse()
            engine = Engine(plan, in_use, rig, monitor, journal, observer, past, pulse.may_be_held)
            pulse.polls, pulse.may_hold = monitor.polls, lambda: engine.may_hold
            loop = asyncio.get_running_loop()

            def end_run(failure: StoreError) -> None:
                with suppress(RuntimeError):  # the loop is closed: the run has ended
                    loop.call_soon_threadsafe(monitor.report, failure)

            journal.writer.on_failure = end_run
            if people is not None:
                people.meet(engine.prompts, engine.journal, observer.notice)
            if on_prompts is not None:
                on_prompts(engine.prompts)
            with (
                signals.calling(_acting(engine, observer, teardown_s)),
                hold.calling(partial(engine.hold, POWER_FAILURE)),
                control_socket(folder, _handlers(engine, monitor, observer, can_pause=can_pause, pulse=pulse)),
                answers_from_terminal(engine.prompts, observer, can_wait=can_pause),
            ):
                outcome = await engine.run()
    except Exception as problem:  # noqa: BLE001  after any error opened devices must be made safe
        outcome = await _failed(problem, outcome, rig, journal, observer)
    if outcome is None:
        outcome = await _ended_while_opening(rig, journal, signals, observer)
    outcome.not_reached = rig.not_reached
    await _close(rig, outcome)
    return outcome, rig.identities


async def _open(rig: Rig, used: Collection[str], signals: Signals) -> None:
    """Open the needed devices, and the others if present; a signal ends it. Raises OpenError."""
    if signals.first is not None:
        return
    opening = asyncio.create_task(rig.open(used), name="opening")
    try:
        with signals.calling(lambda _: opening.cancel()):
            await asyncio.wait([opening])
    finally:
        opening.cancel()
    if not opening.cancelled():
        opening.result()


def _report_identities(rig: Rig, journal: Journal, observer: Observer) -> None:
    for role, identity in rig.identities.items():
        journal.write("identified", device=role, **facts(identity))
    for role, why in rig.not_reached.items():
        journal.try_to_write("not_reached", device=role, text=why, used=False)
        observer.notice(
            f"{why}\nThe run does not use {role} and goes on without it. Nothing was sent to it: check "
            "yourself that it is safe."
        )


async def _energised_before(
    rig: Rig, bench: BenchFile, left_on: LeftOn, journal: Journal, observer: Observer, signals: Signals
) -> dict[str, Found]:
    """Record the state of the real instruments before the first command; {} if a signal ends it."""
    roles = energising_addresses(bench).keys() - left_on.held
    if not roles or signals.first is not None:
        return {}
    found = await found_energised(rig, roles)
    devices: dict[str, dict[str, object]] = {}
    for role, what in found.items():
        run = left_on.by.get(role, "")
        observer.notice(
            f"{role} was found energised: {what.text}; "
            + (f"{run} has left it in this state" if run else "no run on record has left it in this state")
            + ". It is made safe before the first step."
        )
        devices[role] = {"text": what.text, **what.values} | ({"left_by": run} if run else {})
    if devices:
        journal.write("found_energised", devices=devices)
    return found


async def _make_left_on_safe(rig: Rig, left_on: LeftOn, journal: Journal) -> None:
    """Make safe all devices that were left on. Raises OpenError if one cannot be made safe."""
    unsafe = await finish(rig.make_safe(left_on.held), rig.safe_within_s + CLOSE_S)
    if left_on.by:
        journal.write("found_left_on", devices=dict(left_on.by), unsafe=unsafe)
    if unsafe:
        raise OpenError("\n".join(unsafe.values()))


async def _failed(
    problem: Exception, outcome: Outcome | None, rig: Rig, journal: Journal, observer: Observer
) -> Outcome:
    """Return the outcome of a run that an error outside of its steps has ended."""
    text = error_message(problem)
    journal.try_to_write("problem", text=text)
    observer.notice(text)
    if outcome is None:  # the engine has not started
        outcome = await _made_safe(rig, journal, observer)
    outcome.failed(text)
    outcome.problems.sort(key=lambda each: each != text)  # show the reason of the end first
    return outcome


async def _ended_while_opening(rig: Rig, journal: Journal, signals: Signals, observer: Observer) -> Outcome:
    outcome = await _made_safe(rig, journal, observer)
    if (request := signals.first) is not None:
        journal.try_to_write("end_requested", action="abort", by=request.by, text=request.text)
        outcome.ended(request)
    return outcome


async def _made_safe(rig: Rig, journal: Journal, observer: Observer) -> Outcome:
    """Make safe the opened devices of a bench on which no step has started: a crash may have left it on."""
    outcome = Outcome()
    outcome.unsafe = await finish(rig.make_safe(), rig.safe_within_s + CLOSE_S)
    for role, why in rig.not_reached.items():
        journal.try_to_write("not_reached", device=role, text=why, used=True)
    journal.try_to_write("made_safe", unsafe=outcome.unsafe)
    safe = [role for role in rig.devices if role not in outcome.unsafe]
    if safe:
        observer.notice(f"No step was started. Made safe: {', '.join(safe)}.")
    if rig.not_reached:
        names = ", ".join(rig.not_reached)
        observer.notice(f"NOT REACHED, so nothing was sent: {names}. Check yourself that each of them is safe.")
    for role, why in outcome.unsafe.items():
        outcome.failed(why)
        observer.notice(f"{role} COULD NOT BE MADE SAFE: {why}")
    return outcome


async def _close(rig: Rig, outcome: Outcome) -> None:
    try:
        await rig.close()
    except Exception as problem:  # noqa: BLE001  the outcome of the run must not be lost
        outcome.failed(error_message(problem))


def _handlers(
    engine: Engine, monitor: Monitor, observer: Observer, *, can_pause: bool, pulse: Pulse | None
) -> Handlers:
    commands = commands_of(engine, monitor, observer.notice, can_pause=can_pause, pulse=pulse)
    return {**commands, **orders_of(engine.manual, engine.journal, observer.notice)}


def _acting(engine: Engine, observer: Observer, teardown_s: float) -> Callable[[EndSignal], None]:
    """Return the reaction to signals during the plan: SIGINT stops; a second one, and any other signal, aborts."""
    stopping = False

    def act(sent: EndSignal) -> None:
        nonlocal stopping
        if sent.gentle and not stopping and not engine.in_teardown:
            stopping = True
            engine.stop(sent.request)
            observer.notice(
                f"Stopping: teardown runs now and takes about {teardown_s / 60:.0f} min. Ctrl-C again skips "
                "it and makes the devices safe at once."
            )
            return
        engine.abort(sent.request)
        observer.notice(f"Aborting: no teardown; all devices are made safe ({sent.request.text}).")

    return act
