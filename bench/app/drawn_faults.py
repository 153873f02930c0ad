"""Random faults of a rehearsal, drawn from their own seed."""

from __future__ import annotations

from bench.app.request import PreparedRun
from bench.app.scenario import with_faults
from bench.config.devices import DeviceEntry
from bench.config.models import BenchFile
from bench.config.simulation import FaultSimulation
from simulators.units.unit_file import stream

MOST_FAULTS = 3
# faults of each kind of instrument; others cannot err silently or restart unnoticed
_OF_A_COUNTER, _OF_A_SOURCE = ("silent", "cut", "frozen", "restart"), ("silent", "cut", "stuck")
_OF_OTHERS, _OF_A_PERSON = ("silent", "cut", "frozen", "stuck"), ("silent", "stuck")


def with_drawn_faults(prepared: PreparedRun, seed: int) -> PreparedRun:
    """Add drawn faults to a run, and to its request for a resumption."""
    bench = prepared.loaded.bench
    drawn = draw_faults(bench, prepared.expected.total_s, seed)
    loaded = prepared.loaded._replace(bench=with_faults(bench, drawn))
    return prepared._replace(loaded=loaded, request=prepared.request._replace(fault_seed=seed))


def draw_faults(bench: BenchFile, planned_s: float, seed: int) -> tuple[FaultSimulation, ...]:
    """Draw one to three faults of devices of the bench, at times within the plan; reproducible by the seed."""
    draw = stream(seed, "rehearsal", "faults")
    roles = draw.permutation(sorted(bench.devices))[: draw.integers(1, MOST_FAULTS + 1)]
    drawn = [
        FaultSimulation.model_validate({
            "device": str(role), "kind": str(draw.choice(_kinds(bench.devices[role]))),
            "at": f"{draw.uniform(0, planned_s):.1f} s",
        })
        for role in roles
    ]  # fmt: skip
    return tuple(sorted(drawn, key=lambda fault: fault.at))


def _kinds(entry: DeviceEntry) -> tuple[str, ...]:
    if entry.connection.is_person:
        return _OF_A_PERSON
    if entry.description.capabilities & {"pulse_counter", "telemetry"}:
        return _OF_A_COUNTER
    return _OF_A_SOURCE if "current_source" in entry.description.capabilities else _OF_OTHERS
