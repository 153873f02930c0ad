"""Injection of faults into simulated instruments and units, at their times and for their durations."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress

from bench.app.laboratory import Laboratory, make_laboratory, unit_files
from bench.app.relay import Relay, RunObserver
from bench.config.models import BenchFile
from bench.config.simulation import FaultSimulation
from bench.engine.journal import Journal
from bench.errors import StoreError
from bench.sequence.plan.dwells import first_visit
from bench.sequence.plan.plan import PlannedStep
from simulators.faults import instrument_faults as faults
from simulators.faults.instrument_faults import Breakable

BEGINS, ENDS = "fault_begins", "fault_ends"  # kinds of journal entries
OnFault = Callable[[str, FaultSimulation], object]
"""Callback with BEGINS or ENDS, and the fault."""


class FaultPlayer:
    """Inject faults into a laboratory; those with `after` when that step has ended.

    Concurrency: timers of the running loop.
    """

    def __init__(self, laboratory: Laboratory, to_play: Sequence[FaultSimulation], on_fault: OnFault) -> None:
        self._laboratory, self._on_fault = laboratory, on_fault
        self._waiting = [fault for fault in to_play if fault.after is not None]
        for fault in to_play:
            if fault.after is None:
                _in(fault.at, self._begin, fault)

    def step_ended(self, step: str) -> None:
        """Start or schedule the faults that follow a step, on its first end."""
        ended = first_visit(step)
        due = [fault for fault in self._waiting if fault.after == ended]
        self._waiting = [fault for fault in self._waiting if fault.after != ended]
        for fault in due:
            _in(fault.at, self._begin, fault)

    def _begin(self, fault: FaultSimulation) -> None:
        self._laboratory.world.before_change()
        faults.begin(self._victim(fault), fault.kind)
        self._on_fault(BEGINS, fault)
        if fault.for_ is not None:
            _in(fault.for_, self._end, fault)

    def _end(self, fault: FaultSimulation) -> None:
        self._laboratory.world.before_change()
        faults.end(self._victim(fault), fault.kind)
        self._on_fault(ENDS, fault)

    def _victim(self, fault: FaultSimulation) -> Breakable:
        world = self._laboratory.world
        victims: dict[str, Breakable] = {
            **self._laboratory.instruments, **self._laboratory.nodes, **self._laboratory.by_hand,
        }  # fmt: skip
        if fault.unit is not None:
            victims = {**world.counted, **world.imus}
        return victims[fault.unit or fault.device or ""]


class Faults:
    """Faults of a simulated laboratory over all stretches of a run; they continue while the run is interrupted."""

    def __init__(self, laboratory: Laboratory, to_play: Sequence[FaultSimulation]) -> None:
        self._laboratory, self._to_play = laboratory, to_play
        self._player: FaultPlayer | None = None
        self._journal: Journal | None = None
        self._unwritten: list[tuple[str, FaultSimulation, float]] = []  # with the bench time

    @contextmanager
    def during(self, journal: Journal, observer: RunObserver) -> Iterator[RunObserver]:
        """Inject and journal the faults during a stretch of a run, after journalling those of the interruption."""
        self._journal = journal
        unwritten, self._unwritten = self._unwritten, []
        for kind, fault, at_s in unwritten:
            journal.write(kind, **as_journalled(fault), since_s=at_s)
        self._player = self._player or FaultPlayer(self._laboratory, self._to_play, self._on_fault)
        try:
            yield Cue(observer, self._player)
        finally:
            self._journal = None

    def _on_fault(self, kind: str, fault: FaultSimulation) -> None:
        if self._journal is None:
            self._unwritten.append((kind, fault, asyncio.get_running_loop().time()))
            return
        with suppress(StoreError):
            self._journal.write(kind, **as_journalled(fault))


def laboratory_of(bench: BenchFile) -> Laboratory | None:
    """Return the laboratory of a bench with its units, seed and faults, in the running loop; None for a real bench."""
    if not bench.needs_simulators:
        return None
    host_s = asyncio.get_running_loop().time
    laboratory = make_laboratory(bench, unit_files(bench, None), bench.simulation.seed, host_s)
    FaultPlayer(laboratory, bench.simulation.faults, lambda _kind, _fault: None)
    return laboratory


class Cue(Relay):
    """Forward everything to another observer, and ended steps to a FaultPlayer."""

    def __init__(self, observer: RunObserver, player: FaultPlayer) -> None:
        super().__init__(observer)
        self._player = player

    def step_ended(self, planned: PlannedStep, index: int) -> None:
        """Notify the player, and forward."""
        super().step_ended(planned, index)
        self._player.step_ended(planned.id)


def as_journalled(fault: FaultSimulation) -> dict[str, str]:
    """Journal entry of a fault that begins or ends."""
    return {"victim": fault.victim, "fault": fault.kind}


def _in(delay_s: float, act: Callable[[FaultSimulation], object], fault: FaultSimulation) -> None:
    if delay_s > 0:
        asyncio.get_running_loop().call_later(delay_s, act, fault)
    else:
        act(fault)
