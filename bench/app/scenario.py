"""Reading of scenarios, and checks of faults against the simulators."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from bench.app.laboratory import simulator_of
from bench.config.bench import LoadedBench, fault_misfits
from bench.config.document import Document, Place, Problem, read_document
from bench.config.load import load
from bench.config.models import BenchFile
from bench.config.scenario import ScenarioFile
from bench.config.simulation import FaultSimulation
from bench.errors import InputError
from bench.sequence.plan.plan import Plan
from drivers.description import DriverDescription
from drivers.schema.suggest import did_you_mean
from simulators.faults.instrument_faults import LINE_FAULTS, fault_effects_of
from simulators.instruments.axes.operator_head import HandTurnedHead
from simulators.instruments.can_nodes.can_node import CanNode

IN_BENCH: Place = ("simulation", "faults")
IN_SCENARIO: Place = ("faults",)


def with_scenario(loaded: LoadedBench, path: Path | None, plan: Plan | None) -> tuple[LoadedBench, Document | None]:
    """Add the faults of a scenario to those of the bench; return both. Raises InputError for faults that do not fit.

    Without a plan the instruments are only served, and no fault can follow a step.
    """
    if plan is None or loaded.bench.needs_simulators:
        own = loaded.bench.simulation.faults
        if found := loaded.document.located(_misfits(own, loaded.bench, plan, IN_BENCH)):
            raise InputError(*found)
    if path is None:
        return loaded, None
    if plan is not None and not loaded.bench.is_simulated:
        raise InputError(
            f"--scenario {path}: this bench has real connections; faults can be injected only into simulators"
        )
    document = read_document(path)
    scripted = load(document, ScenarioFile).faults
    if found := document.located(
        [*fault_misfits(scripted, loaded.bench, IN_SCENARIO), *_misfits(scripted, loaded.bench, plan, IN_SCENARIO)]
    ):
        raise InputError(*found)
    return loaded._replace(bench=with_faults(loaded.bench, scripted)), document


def with_faults(bench: BenchFile, faults: Sequence[FaultSimulation]) -> BenchFile:
    """Return the bench with additional faults."""
    simulation = bench.simulation.model_copy(update={"faults": (*bench.simulation.faults, *faults)})
    return bench.model_copy(update={"simulation": simulation})


def known_faults(driver: DriverDescription) -> tuple[str, ...]:
    """Return the faults that the simulator of a driver supports: line faults first; empty without a simulator."""
    simulator = simulator_of(driver)
    if simulator is None:
        return ()
    if issubclass(simulator, HandTurnedHead):  # no wire to cut; the person may be absent
        return ("silent", *fault_effects_of(simulator))
    lines = () if issubclass(simulator, CanNode) else LINE_FAULTS
    return ("silent", "cut", *lines, *fault_effects_of(simulator))


def _misfits(faults: Sequence[FaultSimulation], bench: BenchFile, plan: Plan | None, where: Place) -> Iterator[Problem]:
    """Yield unsupported kinds of faults, and steps that the plan does not have."""
    for index, fault in enumerate(faults):
        if fault.device is not None and fault.device in bench.devices:
            entry = bench.devices[fault.device]
            if fault.kind not in (known := known_faults(entry.description)):
                yield (
                    (*where, index, fault.kind_key),
                    f"'{fault.device}', a simulated {entry.driver}, has no fault {fault.kind}; it has "
                    f"{', '.join(known) or 'none'}",
                )
        if fault.after is None:
            continue
        if plan is None:
            yield (*where, index, "after"), "after: no sequence runs here; give a time with at instead"
        elif fault.after not in (steps := [planned.id for planned in plan]):
            yield (*where, index, "after"), f"the plan has no step '{fault.after}'{did_you_mean(fault.after, steps)}"
