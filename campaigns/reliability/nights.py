"""A night in virtual time with faults drawn: how it ends, and whether it says why."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import numpy as np

from bench.app.rehearse import Rehearsal, rehearse
from bench.app.request import PreparedRun, RunRequest, prepare
from bench.app.scenario import known_faults, with_faults
from bench.config.models import BenchFile
from bench.config.simulation import FaultSimulation
from bench.runner.quiet import Quiet
from bench.store.reader import RunReader, digest_of

BENCH, SEQUENCE, PRESET = "simulated", "tumble_static", "quick"
OF_THE_CHAMBER = (
    "heater_dead", "cooling_dead", "runaway", "detached_sensor", "frozen", "stuck", "open_sensor", "restart",
)  # fmt: skip
TWICE_IN = 20  # of so many nights one is played twice, and must be the same
LONGEST_S = 14400.0


def night(number: int) -> str:
    """One to three faults of any kind that the simulators know, for a time or for good."""
    draw = np.random.default_rng([16, number])
    played = [_played(_faults(_bench(), draw, number))]
    if number % TWICE_IN == 0:
        again = _played(_faults(_bench(), np.random.default_rng([16, number]), number))
        if again[1] != played[0][1]:
            return "played again it is another run"
    return "; ".join(played[0][0].wrong)


def thermal(number: int) -> str:
    """A fault of the chamber, for good; every fourth night has none."""
    draw = np.random.default_rng([5, number])
    if number % 4 == 0:
        rehearsal, *_ = _played(())
        verdict = rehearsal.result.results.verdict if rehearsal.result.results is not None else "none"
        return "" if verdict == "PASS" else f"without a fault: {verdict} {rehearsal.result.problems}"
    kinds = [kind for kind in OF_THE_CHAMBER if kind in known_faults(_bench().devices["chamber"].description)]
    fault = {
        "device": "chamber",
        "kind": kinds[number % len(kinds)],
        "at": f"{draw.uniform(0, 0.8 * _night_s()):.1f} s",
    }
    rehearsal, _, commanded_s = _played((FaultSimulation.model_validate(fault),))
    results = rehearsal.result.results
    if rehearsal.began_s == (None,) or rehearsal.result.outcome.how != "completed":
        return "; ".join(rehearsal.wrong)
    if results is not None and results.verdict != "PASS":
        return ""
    if fault["kind"] == "restart" and rehearsal.began_s[0] < commanded_s:
        return ""  # the set point that the chamber has lost was none of the run's
    return f"{fault}: nothing was noticed"


def _commanded_s(run: Path) -> float:
    """Bench time of a run's first command to the chamber, in s."""
    with RunReader(run) as reader:
        begun = [event.at_s for event in reader.events("step_begins") if event.data.get("device") == "chamber"]
    return min(begun, default=math.inf)


def _bench() -> BenchFile:
    return _prepared(Path()).loaded.bench


def _night_s() -> float:
    return _prepared(Path()).expected.total_s


def _prepared(runs: Path) -> PreparedRun:
    return prepare(RunRequest(SEQUENCE, bench=BENCH, preset=PRESET, runs=runs))


def _faults(bench: BenchFile, draw: np.random.Generator, number: int) -> tuple[FaultSimulation, ...]:
    roles = draw.permutation(sorted(bench.devices))[: int(draw.integers(1, 4))]
    night_s, drawn = _night_s(), []
    for role in map(str, roles):
        fault = {
            "device": role,
            "kind": str(draw.choice(known_faults(bench.devices[role].description))),
            "at": f"{draw.uniform(0, night_s):.1f} s",
        }
        if draw.random() < 0.5:
            fault["for"] = f"{np.exp(draw.uniform(0, np.log(LONGEST_S))):.1f} s"
        drawn.append(FaultSimulation.model_validate(fault))
    return tuple(sorted(drawn, key=lambda fault: fault.at))


def _played(faults: tuple[FaultSimulation, ...]) -> tuple[Rehearsal, str, float]:
    """The rehearsal, the digest of its record, and when it first commanded the chamber, in s."""
    with tempfile.TemporaryDirectory() as folder:
        prepared = _prepared(Path(folder))
        loaded = prepared.loaded
        prepared = prepared._replace(loaded=loaded._replace(bench=with_faults(loaded.bench, faults)))
        rehearsal = rehearse(prepared, Quiet())
        return rehearsal, digest_of(rehearsal.result.path), _commanded_s(rehearsal.result.path)
