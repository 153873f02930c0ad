"""A prepared run from the first directory to the last line of its report."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import ExitStack, nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bench.app.devices import open_devices
from bench.app.faults import Cue, FaultPlayer, as_journalled
from bench.app.laboratory import Laboratory, make_laboratory, unit_files
from bench.app.relay import RunObserver
from bench.app.request import PreparedRun
from bench.app.technician import Technician
from bench.app.tracing import Keep, recording
from bench.app.truth import truth_of
from bench.clock import Clock, Stopwatch, wall_utc
from bench.config.simulation import FaultSimulation
from bench.engine.engine import Outcome
from bench.engine.people import People
from bench.engine.questions import Desk
from bench.errors import StoreError, in_words
from bench.loop import AS_FAST_AS_POSSIBLE
from bench.loop import run as run_loop
from bench.report.calibration import calibration_files
from bench.report.findings import Results
from bench.report.stored import BENCH_COPY, SEQUENCE_COPY, StoredRun, released_copy
from bench.runner import manifest
from bench.runner.held import holding, real_addresses
from bench.runner.run import run_plan
from bench.store.reader import RunReader, digest_of
from bench.store.runs import RunDirectory
from bench.store.writer import RunWriter
from drivers.can_counter.description import CounterOptions
from drivers.can_options import text_of
from drivers.can_telemetry.description import TelemetryOptions
from drivers.fields import DocumentFile

SCENARIO_COPY = "scenario.yaml"
HEALTHY_BLOCK_S = 60.0  # how long frames are left together where nothing is to break
CALLED = "called"  # the folder of sequences that the one of a run calls


@dataclass(frozen=True)
class RunResult:
    """How a run ended: its directory, why it did not get to its end, and what was found."""

    path: Path
    outcome: Outcome
    results: Results | None
    bench_s: float
    wall_s: float

    @property
    def problems(self) -> list[str]:
        """Everything a person must know, the reason first."""
        return [
            *self.outcome.problems,
            *(f"{device} COULD NOT BE MADE SAFE: {why}" for device, why in self.outcome.unsafe.items()),
        ]


def execute(prepared: PreparedRun, observer: RunObserver) -> RunResult:
    """Runs it; everything that goes wrong is in the result.

    But StoreError when there is no directory to run in, and InUseError when another program uses the bench.
    """
    with holding(real_addresses(prepared.loaded.bench).values(), f"a run of {prepared.plan.name}"):
        return _execute(prepared, observer)


def _execute(prepared: PreparedRun, observer: RunObserver) -> RunResult:
    bench = prepared.loaded.bench
    units = unit_files(bench, prepared.request.uut_model, prepared.serials) if bench.needs_simulators else {}
    started, watch = wall_utc(), Stopwatch()
    directory = RunDirectory.create(
        prepared.request.runs, started, prepared.plan.name, "+".join(prepared.serials.values())
    )
    try:
        record = manifest.opening(
            directory.path.name,
            prepared.plan,
            bench,
            prepared.serials,
            prepared.seed,
            prepared.request.operator,
            started,
        )
        record |= {"order": prepared.request.order, "procedure": prepared.request.procedure}
        record["released"] = {place: released.to_json() for place, released in prepared.released.items()}
        record["hashes"] = _keep_inputs(prepared, directory.path)
        directory.write_json("manifest.json", record)

        async def main() -> _Run:
            laboratory = None
            if bench.needs_simulators:
                laboratory = make_laboratory(bench, units, prepared.seed, asyncio.get_running_loop().time)
                if not bench.simulation.faults:
                    laboratory.leave_frames(HEALTHY_BLOCK_S)
            return await _run(prepared, directory.path, laboratory, observer, keep)

        trace = prepared.request.trace
        with nullcontext() if trace is None else recording(trace) as keep:
            ran = run_loop(main(), prepared.speed)
        return _finish(directory, record, ran, watch)
    finally:
        directory.release()


@dataclass(frozen=True)
class _Run:
    outcome: Outcome
    instruments: dict[str, Any]
    laboratory: Laboratory | None
    bench_s: float
    digest: str  # of the data; "" when they could not be written


async def _run(
    prepared: PreparedRun, folder: Path, laboratory: Laboratory | None, observer: RunObserver, keep: Keep | None
) -> _Run:
    bench = prepared.loaded.bench
    clock = Clock(bench.simulation.start if bench.is_simulated else None)
    began_s = clock.monotonic()
    writer, digest = RunWriter(folder), ""
    try:
        writer.event("run_begins", utc=clock.utc().isoformat(), title=prepared.plan.sequence.title, seed=prepared.seed)
        observer.run_begins(folder, prepared.expected, clock)

        def note(device: str, text: str) -> None:
            with suppress(StoreError):  # the step that it stops tells it
                writer.event("device_note", device=device, text=text)

        def tell(kind: str, fault: FaultSimulation) -> None:
            with suppress(StoreError):
                writer.event(kind, **as_journalled(fault))

        if laboratory is not None and bench.simulation.faults:
            observer = Cue(observer, FaultPlayer(laboratory, bench.simulation.faults, tell))
        people = People()
        devices = open_devices(bench, laboratory, keep, note, people)
        outcome, identities = await run_plan(
            prepared.plan,
            bench,
            devices,
            writer,
            observer,
            observer.reading,
            prepared.expected.of_phase("teardown"),
            folder=folder,
            can_pause=prepared.speed < AS_FAST_AS_POSSIBLE,
            on_desk=_technician(prepared, laboratory, observer),
            places=tuple(prepared.serials),
            people=people,
        )
        writer.event("run_ended", how=outcome.how)
    except StoreError as problem:
        outcome, identities = Outcome("error", [str(problem)]), {}
    finally:
        try:
            writer.close()
            digest = writer.digest()
        except StoreError as problem:
            outcome.how = "error"
            if str(problem) not in outcome.problems:
                outcome.problems.append(str(problem))
    return _Run(outcome, manifest.instruments(bench, identities), laboratory, clock.monotonic() - began_s, digest)


def _technician(
    prepared: PreparedRun, laboratory: Laboratory | None, observer: RunObserver
) -> Callable[[Desk], object] | None:
    """Who answers in a simulated run: a script, or at full speed somebody who does what he is asked; else people."""
    bench, script = prepared.loaded.bench, prepared.script
    if script is None and prepared.speed >= AS_FAST_AS_POSSIBLE:
        script = {}
    if script is None and (laboratory is None or not laboratory.by_hand):
        return None
    return lambda desk: Technician(desk, script, bench, laboratory, observer.notice)


def _keep_inputs(prepared: PreparedRun, folder: Path) -> dict[str, str]:
    """Copies what the run depends on into its directory, with hashes."""
    copies = {SEQUENCE_COPY: prepared.plan.document.text, BENCH_COPY: prepared.loaded.document.text}
    copies |= {released_copy(place): released.text for place, released in prepared.released.items()}
    called = prepared.plan.document.all_included()
    if prepared.scenario is not None:
        copies[SCENARIO_COPY] = prepared.scenario.text
    copies |= {f"{CALLED}/{document.path.name}": document.text for document in called}
    for role, entry in prepared.loaded.bench.devices.items():
        if isinstance(entry.options, CounterOptions | TelemetryOptions):
            copies[entry.options.dbc.name] = text_of(entry.options.dbc)
        for document in (each for each in vars(entry.options).values() if isinstance(each, DocumentFile)):
            name, text = document.path.name, document.path.read_text("utf-8")
            copies[name if copies.get(name, text) == text else f"{role}_{name}"] = text
    if called:
        (folder / CALLED).mkdir()
    for name, text in copies.items():
        (folder / name).write_text(text, encoding="utf-8")
    return {name: manifest.file_hash(folder / name) for name in copies}


def _finish(directory: RunDirectory, record: dict[str, Any], ran: _Run, watch: Stopwatch) -> RunResult:
    """Reduces, writes results and truth, then the manifest, and at last the report of it all."""
    outcome, path = ran.outcome, directory.path
    directory.use_reserve()
    stored, results = None, None
    record |= {"state": outcome.how, "instruments": ran.instruments, "bench_s": ran.bench_s}
    with ExitStack() as stack:
        try:
            record["digest"] = ran.digest or digest_of(path)
            stored = StoredRun(path, record, stack.enter_context(RunReader(path)))
            results = stored.evaluate()
            record["verdict"] = results.verdict
            if ran.laboratory is not None:
                directory.write_json("truth.json", truth_of(stored, ran.laboratory))
                record["hashes"]["truth.json"] = manifest.file_hash(path / "truth.json")
            directory.write_json("results.json", results.to_json())
            record["hashes"]["results.json"] = manifest.file_hash(path / "results.json")
            for name, content in calibration_files(results.units, record, stored.bench):
                directory.write_json(name, content)
                record["hashes"][name] = manifest.file_hash(path / name)
        except Exception as problem:  # noqa: BLE001  what was measured is on the disk; the run says how it ended
            outcome.problems.append(in_words(problem))
            outcome.how = record["state"] = "error"
            record["verdict"] = "ERROR"
            results = None if results is None else replace(results, verdict="ERROR")
        record |= {
            "problems": outcome.problems,
            "unsafe": outcome.unsafe,
            "ended": wall_utc().isoformat(timespec="seconds"),
            "wall_s": watch.elapsed_s(),
        }
        directory.write_json("manifest.json", record)
        if stored is not None:
            _report(stored, outcome)
    return RunResult(path, outcome, results, ran.bench_s, watch.elapsed_s())


def _report(stored: StoredRun, outcome: Outcome) -> None:
    """Writes the report; what stands in its way is told, and takes nothing else away."""
    try:
        from bench.report.write import write_report  # and matplotlib with it, which a run needs only here

        write_report(stored)
    except Exception as problem:  # noqa: BLE001  the run is over, and its results are on the disk
        outcome.problems.append(f"no report could be written ({problem}); 'bench report {stored.folder}' tries again")
