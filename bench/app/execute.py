"""Execution of a prepared run, from the directory to the report."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from contextlib import ExitStack, nullcontext, suppress
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from bench.app.beginning import Register, instant, keep_inputs, write_beginning, write_manifest
from bench.app.clock_record import ClockRecord
from bench.app.credited import credit_of
from bench.app.devices import open_devices
from bench.app.drawn import AnyUnitFile
from bench.app.faults import Faults
from bench.app.finish import Finish
from bench.app.laboratory import Laboratory, make_laboratory, unit_files
from bench.app.rebuild import rebuild
from bench.app.relay import RunObserver
from bench.app.request import PreparedRun
from bench.app.resume import Resumption
from bench.app.technician import Technician
from bench.app.tracing import Keep, recording
from bench.clock import Clock, Stopwatch, wall_utc
from bench.config.models import BenchFile
from bench.engine.ending import Outcome
from bench.engine.journal import Journal
from bench.engine.past import Past
from bench.engine.people import People
from bench.engine.pulse import Pulse
from bench.engine.questions import PromptQueue
from bench.errors import InUseError, StoreError, error_message
from bench.loop import AS_FAST_AS_POSSIBLE
from bench.loop import run as run_loop
from bench.runner import manifest
from bench.runner.alert import alert
from bench.runner.found_on import NOTHING, LeftOn
from bench.runner.guard import guarded
from bench.runner.held import Kind, address_lock, real_addresses, why_locked_out
from bench.runner.power import Hold, power_watched
from bench.runner.quiet import Quiet
from bench.runner.run import run_plan
from bench.runner.signals import Signals
from bench.runner.takeover import end_supervision
from bench.store.runs import RunDirectory
from bench.store.unsafe import write_unsafe
from bench.store.writer import RunWriter
from drivers.values import Identity

if TYPE_CHECKING:  # a run starts without loading what only its results need
    from bench.reduce.evaluate import Results

HEALTHY_BLOCK_S = 60.0  # time for which frames stay with the nodes if no fault is planned


class RunResult(NamedTuple):
    """Outcome of a run: directory, problems, results, and report unless it failed or none was asked for."""

    path: Path
    outcome: Outcome
    results: Results | None
    bench_s: float
    wall_s: float
    report: Path | None = None
    no_report: bool = False

    @property
    def problems(self) -> list[str]:
        """All problems for a person, the reason of the end first."""
        return [
            *self.outcome.problems,
            *(f"{device} COULD NOT BE MADE SAFE: {why}" for device, why in self.outcome.unsafe.items()),
        ]


def execute(
    prepared: PreparedRun, observer: RunObserver, signals: Signals | None = None, resumption: Resumption | None = None
) -> RunResult:
    """Start or resume a run; all errors are in the result.

    Except StoreError if there is no directory for the run, and InUseError if another program uses the bench. The bench
    is free for others as soon as it is safe and closed, before the report is written. `signals` are the handlers of the
    caller; without them, handlers are installed until this returns.
    """
    with ExitStack() as in_use, nullcontext(signals) if signals is not None else Signals() as kept:
        bench = prepared.loaded.bench
        in_use.enter_context(address_lock(real_addresses(bench).values(), f"a run of {prepared.plan.name}", Kind.RUN))
        if why := why_locked_out(bench):
            raise InUseError(f"The bench is {why}. When the work is done: bench lockout --lift --bench FILE")
        return _execute(prepared, observer, kept, in_use.close, resumption)


def _execute(
    prepared: PreparedRun,
    observer: RunObserver,
    signals: Signals,
    let_go: Callable[[], None],
    resumption: Resumption | None,
) -> RunResult:
    bench = prepared.loaded.bench
    units = unit_files(bench, prepared.request.uut_model, prepared.serials) if bench.needs_simulators else {}
    now = wall_utc()
    if resumption is None:
        serials = "+".join(prepared.serials.values())
        directory, started = RunDirectory.create(prepared.request.runs, now, prepared.plan.name, serials), now
    else:
        directory = RunDirectory.reopen(resumption.path)
        started = datetime.fromisoformat(resumption.manifest["started"])
    watch = Stopwatch(0.0 if resumption is None else resumption.passed_s(now))
    try:
        record = write_manifest(prepared, directory, started) if resumption is None else dict(resumption.manifest)

        origin_s = 0.0
        trace = prepared.request.trace
        register = Register(prepared.loaded, directory.path, observer.notice)
        left_on = register.begin(now)
        end_supervision(list(real_addresses(bench).values()), observer.notice)
        if resumption is not None and not bench.is_simulated:
            origin_s = resumption.last_s + resumption.outage_s(now)
            resumption.past.credit = credit_of(resumption, prepared, left_on.held)
        with nullcontext() if trace is None else recording(trace, directory.path.name) as keep:
            execution = _Execution(prepared, directory.path, observer, signals, resumption, left_on, keep)
            ran = run_loop(execution.run(units), prepared.speed, origin_s)
        if ran.made_safe:
            register.end(ran.outcome)
        let_go()
        if ran.writer.folder != directory.path:
            _follow(prepared, directory, record, ran)
        record |= {"instruments": ran.instruments, "bench_s": ran.bench_s, "digest": ran.digest}
        if ran.clock_steps:
            record["clock_steps"] = ran.clock_steps
        finish = Finish(directory, record, ran.outcome, signals, watch)
        no_report = prepared.request.no_report
        results = finish.results(execution.laboratory, ran.writer.beginning, ran.writer.link, no_report=no_report)
        _alert(prepared, directory.path.name, ran.outcome, results, observer)
        elapsed_s = watch.elapsed_s()
        return RunResult(directory.path, ran.outcome, results, ran.bench_s, elapsed_s, finish.report, no_report)
    finally:
        directory.release()


class _Run(NamedTuple):
    """Outcome of an executed plan, with its closed record; `digest` is "" if its data could not be written."""

    outcome: Outcome
    made_safe: bool  # from the outcome; False if it ended before it could open an instrument
    instruments: dict[str, Any]
    bench_s: float
    digest: str
    clock_steps: list[dict[str, float]]
    writer: RunWriter  # with the location of the record; another one if the directory was moved or removed


@dataclass
class _Execution:
    """Execution of a plan in the running loop, on its devices and on the laboratory behind the simulated ones."""

    prepared: PreparedRun
    folder: Path
    observer: RunObserver
    signals: Signals
    resumption: Resumption | None
    left_on: LeftOn
    keep: Keep | None
    laboratory: Laboratory | None = None
    faults: Faults | None = None

    async def run(self, units: Mapping[str, AnyUnitFile]) -> _Run:
        """Execute the plan with these simulated units; the world of an interrupted run is rebuilt before."""
        prepared, resumption = self.prepared, self.resumption
        bench, host_s = prepared.loaded.bench, asyncio.get_running_loop().time
        if bench.needs_simulators:
            self.laboratory = make_laboratory(
                bench, units, prepared.seed, host_s, prepared.serials, prepared.expected.total_s
            )
            if bench.simulation.faults:
                self.faults = Faults(self.laboratory, bench.simulation.faults)
            else:
                self.laboratory.leave_frames(HEALTHY_BLOCK_S)
        if resumption is not None and bench.is_simulated:
            await rebuild(resumption, prepared.seed, self._go_through)
        return await self._recorded()

    async def _go_through(self, journal: Journal, signals: Signals, past: Past | None) -> None:
        """Run the plan on a simulated bench, without display."""
        again = replace(self, observer=Quiet(), keep=None, signals=signals, left_on=NOTHING)
        await again.with_devices(Hold(), journal, past)

    async def _recorded(self) -> _Run:
        """Run the plan with its record, its guardian and the watches on clock and power."""
        prepared, observer, resumption = self.prepared, self.observer, self.resumption
        bench = prepared.loaded.bench
        began_s = asyncio.get_running_loop().time() if resumption is None else resumption.began_s
        clock = Clock(instant(bench, resumption))
        writer, digest = RunWriter(self.folder, resumed=resumption is not None), ""
        past = None if resumption is None else resumption.past
        journal = Journal(writer, None if past is None else past.state)
        outcome, made_safe = Outcome(), False
        identities: Mapping[str, Identity] = {}
        wall = ClockRecord(journal, observer.notice)
        try:
            write_beginning(journal, clock, prepared, resumption)
            observer.run_begins(self.folder, prepared.expected, clock)
            power = None if bench.is_simulated else bench.power
            async with (
                wall.watched(),
                power_watched(power, self.signals, journal, observer.notice) as hold,
                guarded(prepared.loaded, self.folder, self.signals, writer) as guard,
            ):
                outcome, identities = await self.with_devices(hold, journal, past, guard.pulse)
                guard.leaves(outcome)
            made_safe = True
            _keep_unsafe(self.folder, bench, outcome, observer)
            if writer.ledger_problem:
                observer.notice(writer.ledger_problem)
                journal.write("warning", text=writer.ledger_problem)
            journal.write("run_ended", how=outcome.how)
        except Exception as problem:  # noqa: BLE001  the outcome must be kept, with the devices that are not safe
            outcome.failed(error_message(problem))
        try:
            writer.close()
            digest = writer.digest()
        except StoreError as problem:
            outcome.failed(str(problem))
        instruments, bench_s = manifest.instruments(bench, identities), clock.monotonic() - began_s
        return _Run(outcome, made_safe, instruments, bench_s, digest, wall.steps, writer)

    async def with_devices(
        self, hold: Hold, journal: Journal, past: Past | None, pulse: Pulse | None = None
    ) -> tuple[Outcome, Mapping[str, Identity]]:
        """Run the plan on the devices of the bench, with the faults of the bench file in simulated ones."""
        prepared, bench, observer = self.prepared, self.prepared.loaded.bench, self.observer

        def note(device: str, text: str) -> None:
            with suppress(StoreError):  # reported by the step that it stops
                journal.write("device_note", device=device, text=text)

        with nullcontext(observer) if self.faults is None else self.faults.during(journal, observer) as watching:
            people = People()
            return await run_plan(
                prepared.plan,
                bench,
                open_devices(bench, self.laboratory, self.keep, note, people),
                journal,
                watching,
                watching.reading,
                prepared.expected.of_phase("teardown"),
                folder=self.folder,
                can_pause=prepared.speed < AS_FAST_AS_POSSIBLE,
                signals=self.signals,
                hold=hold,
                on_prompts=_technician(prepared, self.laboratory, watching),
                places=tuple(prepared.serials),
                people=people,
                past=past,
                left_on=self.left_on,
                pulse=pulse,
            )


def _alert(prepared: PreparedRun, run: str, outcome: Outcome, results: Results | None, observer: RunObserver) -> None:
    """Alert a person to the end of an unattended run, or of one that is not a PASS or not safe."""
    entry, verdict = prepared.loaded.bench.alert, "no results" if results is None else results.verdict
    is_bad = outcome.unsafe or outcome.not_reached or verdict != "PASS"
    if entry is None or prepared.loaded.bench.is_simulated or not (is_bad or prepared.request.unattended):
        return
    unsafe = "NOT MADE SAFE: " + ", ".join({**outcome.unsafe, **outcome.not_reached})
    title = f"{run}: {unsafe if outcome.unsafe or outcome.not_reached else verdict}"
    if problem := alert(entry.exec, title, "\n".join([title, *outcome.problems, *outcome.unsafe.values()]) + "\n"):
        observer.notice(problem)


def _keep_unsafe(folder: Path, bench: BenchFile, outcome: Outcome, observer: RunObserver) -> None:
    """Record devices that could not be made safe outside the disk of the runs, which may be full or failing."""
    if not outcome.unsafe:
        return
    connections = {role: str(entry.connection) for role, entry in bench.devices.items()}
    try:
        path = write_unsafe(folder, wall_utc(), outcome.unsafe, connections)
    except StoreError as problem:
        outcome.failed(str(problem))
    else:
        observer.notice(f"What is not safe is recorded in {path}")


def _technician(
    prepared: PreparedRun, laboratory: Laboratory | None, observer: RunObserver
) -> Callable[[PromptQueue], object] | None:
    """Return the simulated technician: scripted, or at full speed a default one; None if people answer."""
    bench, script = prepared.loaded.bench, prepared.script
    if script is None and prepared.speed >= AS_FAST_AS_POSSIBLE:
        script = {}
    if script is None and (laboratory is None or not laboratory.by_hand):
        return None
    return lambda prompts: Technician(prompts, script, bench, laboratory, observer.notice)


def _follow(prepared: PreparedRun, directory: RunDirectory, record: dict[str, Any], ran: _Run) -> None:
    """Continue in the folder of the record; a rescued one gets inputs and manifest again."""
    directory.path = ran.writer.folder
    if (directory.path / "manifest.json").exists():
        return
    try:
        keep_inputs(prepared, directory)
        directory.write_json("manifest.json", record)
    except StoreError as problem:
        ran.outcome.failed(str(problem))
