"""Rehearsal: a sequence on simulated instruments, compared with its plan; optionally with faults."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from bench.app.drawn_faults import with_drawn_faults
from bench.app.execute import RunResult, execute
from bench.app.faults import BEGINS, as_journalled
from bench.app.relay import Relay, RunObserver
from bench.app.request import PreparedRun
from bench.config.simulation import FaultSimulation
from bench.report.revision import verify
from bench.runner.signals import Signals
from bench.sequence.document.model import PHASES
from bench.sequence.estimate.estimate import Estimate
from bench.sequence.plan.plan import PlannedStep
from bench.store.database import FILE_NAME
from bench.store.reader import Event, RunReader

_ENDS = ("step_ended", "step_failed", "step_cut")


@dataclass(frozen=True)
class Compared:
    """Planned and actual duration in s."""

    name: str
    planned_s: float
    took_s: float

    @property
    def ratio(self) -> float | None:
        """Actual / planned duration; None if nothing was planned."""
        return self.took_s / self.planned_s if self.planned_s else None


@dataclass(frozen=True)
class Rehearsal:
    """Results of a rehearsal.

    `faults` are those of the bench, of the scenario and the drawn ones; `began_s` their start times, None for those
    that did not occur. `phases` are those that started, `steps` those that ended, in the order of the plan. `unsafe`
    maps devices that were not made safe to the reasons, including those broken by `faults`. `lost` lists acknowledged
    data that are not on the disk, and changed files.
    """

    result: RunResult
    expected: Estimate
    phases: tuple[Compared, ...]
    steps: tuple[Compared, ...]
    stored_bytes: int
    faults: tuple[FaultSimulation, ...]
    began_s: tuple[float | None, ...]
    unsafe: Mapping[str, str]
    lost: tuple[str, ...]

    @property
    def unsafe_without_fault(self) -> tuple[str, ...]:
        """Devices that were not made safe although no fault was injected; there should be none."""
        return tuple(set(self.unsafe) - {fault.device for fault in self.faults})

    @property
    def wrong(self) -> Iterator[str]:
        """What must not be, whatever the faults: a device not made safe, lost data, an end that names no cause."""
        faults = ", ".join(f"{fault.victim} {fault.kind}" for fault in self.faults) or "no fault"
        if self.unsafe_without_fault:
            yield f"{faults}: not made safe though not broken: {', '.join(sorted(self.unsafe_without_fault))}"
        if self.lost:
            yield f"{faults}: not on the disk: {'; '.join(self.lost[:3])}"
        told = " ".join(self.result.problems)
        if self.result.outcome.how != "completed" and not any(
            str(fault.device or fault.unit) in told for fault in self.faults
        ):
            yield f"{faults}: ended with {self.result.outcome.how}, which names no cause: {told[:300]}"

    def largest_deviations(self, count: int) -> list[Compared]:
        """Return the steps with the greatest deviation from the planned duration, greatest first."""
        return sorted(self.steps, key=lambda step: -abs(step.took_s - step.planned_s))[:count]


def rehearse(
    prepared: PreparedRun, observer: RunObserver, fault_seed: int | None = None, signals: Signals | None = None
) -> Rehearsal:
    """Run a prepared run with all instruments simulated, and with drawn faults if a seed is given."""
    expected = prepared.expected
    if fault_seed is not None:
        prepared = with_drawn_faults(prepared, fault_seed)
    faults = prepared.loaded.bench.simulation.faults
    witness = _AcknowledgedSteps(observer)
    result = execute(prepared, witness, signals)
    with RunReader(result.path) as reader:
        events = list(reader.events())
    return Rehearsal(
        result=result,
        expected=expected,
        phases=tuple(_phases(expected, events)),
        steps=tuple(_steps(expected, events)),
        stored_bytes=(result.path / FILE_NAME).stat().st_size,
        faults=faults,
        began_s=tuple(_start_times(faults, events)),
        unsafe=_unsafe(result, events),
        lost=(*witness.lost(events), *verify(result.path)),
    )


def _start_times(faults: Sequence[FaultSimulation], events: list[Event]) -> Iterator[float | None]:
    """Yield the start time of each fault from the journal, None if it did not occur."""
    left = [event for event in events if event.kind == BEGINS]
    for fault in faults:
        found = next((event for event in left if as_journalled(fault).items() <= event.data.items()), None)
        if found is not None:
            left.remove(found)
        yield found.data.get("since_s", found.at_s) if found is not None else None


def _phases(expected: Estimate, events: list[Event]) -> Iterator[Compared]:
    """Yield each phase, from the start of its first step to the end of its last."""
    for phase in PHASES:
        at_s = [event.at_s for event in events if event.step.startswith(f"{phase}/")]
        if at_s:
            yield Compared(phase, expected.of_phase(phase), at_s[-1] - at_s[0])


def _steps(expected: Estimate, events: list[Event]) -> Iterator[Compared]:
    """Yield the first execution of each planned step; later passes and attempts have other ids."""
    began_s = {event.step: event.at_s for event in events if event.kind == "step_begins"}
    ended_s = {event.step: event.at_s for event in events if event.kind in _ENDS}
    for span in expected.spans:
        step = span.step.id
        if step in began_s and step in ended_s:
            yield Compared(step, span.duration_s, ended_s[step] - began_s[step])


def _unsafe(result: RunResult, events: list[Event]) -> Mapping[str, str]:
    """Return the devices that were not made safe, with reasons; "every device" if making safe was not reached."""
    if any(event.kind == "made_safe" for event in events) or not any(event.kind == "step_begins" for event in events):
        return result.outcome.unsafe
    return {"every device": "the run ended before the devices were made safe"}


class _AcknowledgedSteps(Relay):
    """Forward everything to another observer, and store the acknowledged steps."""

    def __init__(self, observer: RunObserver) -> None:
        super().__init__(observer)
        self._told: list[tuple[str, str]] = []

    def lost(self, events: list[Event]) -> Iterator[str]:
        """Yield the acknowledged steps that are not in the journal."""
        kept = {(event.kind, event.step) for event in events}
        for kind, step in dict.fromkeys(self._told):
            if (kind, step) not in kept:
                yield f"{kind} {step} is not in the journal"

    def step_begins(self, planned: PlannedStep, index: int) -> None:
        """Store and forward."""
        self._told.append(("step_begins", planned.id))
        super().step_begins(planned, index)

    def step_ended(self, planned: PlannedStep, index: int) -> None:
        """Store and forward."""
        self._told.append(("step_ended", planned.id))
        super().step_ended(planned, index)
