"""Runs that are aborted at any moment of virtual time while one device is broken."""

from __future__ import annotations

import asyncio
import tempfile
from pathlib import Path

import numpy as np

from bench.app.execute import RunResult, execute
from bench.app.request import RunRequest, prepare
from bench.app.scenario import with_faults
from bench.clock import Clock
from bench.config.simulation import FaultSimulation
from bench.engine.ending import EndRequest
from bench.rig import limits_to_make_safe
from bench.runner.quiet import Quiet
from bench.runner.signals import EndSignal, Signals
from bench.sequence.estimate.estimate import Estimate
from bench.store.reader import RunReader
from tests.support.runs import ROOT

RUNS = {
    "smoke": "simulated", "gyro_range": "gyro", "tumble_static": "simulated", "channel_full": "channel",
    "indexing_static": "indexing", "gyro_response": "gyro",
}  # fmt: skip
QUICK = ("tumble_static", "channel_full", "gyro_range", "gyro_response", "indexing_static")
BROKEN = ("silent", "cut", "stuck")
ABORT = EndSignal("trial", EndRequest("trial", "aborted by a trial"))
BEYOND_S = 30.0  # for the step to end, and what is written


class _Aborting(Quiet):
    """Aborts the run at an instant of bench time."""

    def __init__(self, signals: Signals, share: float) -> None:
        super().__init__()
        self._signals, self._share = signals, share

    def run_begins(self, path: Path, expected: Estimate, clock: Clock) -> None:
        loop = asyncio.get_running_loop()
        loop.call_at(loop.time() + self._share * expected.total_s, self._signals.request_end, ABORT)


def aborted(number: int) -> str:
    """All but the broken one are safe, within the longest lane of the bench."""
    draw = np.random.default_rng([6, number])
    sequence = list(RUNS)[number % len(RUNS)]
    with tempfile.TemporaryDirectory() as folder:
        bench = str(ROOT / "config" / f"{RUNS[sequence]}.yaml")
        preset = "quick" if sequence in QUICK else None
        prepared = prepare(RunRequest(sequence, bench=bench, preset=preset, runs=Path(folder)))
        at_s, total_s = (share := float(draw.random())) * prepared.expected.total_s, prepared.expected.total_s
        file = prepared.loaded.bench
        role = str(draw.choice([role for role, entry in file.devices.items() if entry.safe_state.words]))
        begin_s = max(0.0, at_s - float(draw.choice([0.0, 0.5, 3.0])))
        kind = str(draw.choice(BROKEN))
        fault = FaultSimulation.model_validate({"device": role, "kind": kind, "at": f"{begin_s:.3f} s"})
        prepared = prepared._replace(loaded=prepared.loaded._replace(bench=with_faults(file, (fault,))))
        signals = Signals()
        result = execute(prepared, _Aborting(signals, share), signals)
        found = _wrong_with(result, role, max(limits_to_make_safe(file).values()))
    return f"{sequence} at {at_s:.1f} s of {total_s:.1f} s, {role} {kind}: {found}" if found else ""


def _wrong_with(result: RunResult, broken: str, limit_s: float) -> str:
    unsafe = set(result.outcome.unsafe) - {broken}
    if unsafe:
        return f"not safe: {sorted(unsafe)}"
    with RunReader(result.path) as reader:
        events = list(reader.events("end_requested", "made_safe"))
    asked = [event.at_s for event in events if event.kind == "end_requested"]
    safe = [event.at_s for event in events if event.kind == "made_safe"]
    if not safe:
        return "" if not result.path else "no entry of what was made safe"
    if asked and safe[0] - asked[0] > 2 * limit_s + BEYOND_S:
        return f"safe only after {safe[0] - asked[0]:.1f} s"
    return ""
