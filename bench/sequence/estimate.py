"""How long a plan takes and how much it writes, worked out from the plan and the bench alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, assert_never

from bench.config.models import BenchFile
from bench.sequence.plan import Phase, Plan
from bench.sequence.steps import Acquire, Move, Note, Ramp, SetOutput, Soak, Step, Wait, WaitUntil

COMMAND_S = 0.05
STORED_BYTES_PER_LATCH = 12  # three axes after compression
STORED_BYTES_PER_READING = 40


@dataclass(frozen=True, slots=True)
class Estimate:
    """Seconds for each step of the plan, in its order, and bytes in the run store."""

    steps_s: tuple[float, ...]
    size_bytes: int

    @property
    def total_s(self) -> float:
        """All steps."""
        return sum(self.steps_s)

    def of_phase(self, plan: Plan, phase: Phase) -> float:
        """The steps of one phase of the plan that was estimated."""
        return sum(step_s for step_s, planned in zip(self.steps_s, plan, strict=True) if planned.phase == phase)


def estimate(plan: Plan, bench: BenchFile) -> Estimate:
    """The estimate; roles that the bench lacks count as instantaneous."""
    state = _BenchState(bench)
    steps_s = tuple(state.duration_s(planned.step) for planned in plan)
    counting_s = sum(planned.step.duration_s for planned in plan if isinstance(planned.step, Acquire))
    period_s = min(
        (getattr(entry.options, "period", 1.0) for entry in bench.devices.values()
         if "pulse_counter" in entry.description.capabilities), default=1.0,
    )  # fmt: skip
    named = {reading.device for reading in bench.readings.values()}
    per_s = sum(
        len(entry.description.channels_of(entry.options))
        / (bench.monitor.period if role in named else bench.monitor.devices)
        for role, entry in bench.devices.items()
    )
    readings = sum(steps_s) * per_s
    size = counting_s / period_s * STORED_BYTES_PER_LATCH + readings * STORED_BYTES_PER_READING
    return Estimate(steps_s, int(size) + 100_000)


class _BenchState:
    """Where things stand between two steps."""

    def __init__(self, bench: BenchFile) -> None:
        self._bench = bench
        self._angle_deg = 0.0
        self._set_point_c = bench.simulation.chamber.start

    def duration_s(self, step: Step) -> float:
        match step:
            case Move():
                return self._move_s(step)
            case SetOutput() | Note():
                return COMMAND_S
            case Wait() | WaitUntil() | Soak() | Acquire():
                return step.least_s
            case Ramp():
                distance, self._set_point_c = abs(step.temperature_c - self._set_point_c), step.temperature_c
                return distance / step.rate_c_per_min * 60 + COMMAND_S
            case _:
                assert_never(step)

    def _move_s(self, step: Move) -> float:
        head = self._bench.devices.get(step.role)
        if head is None:
            return step.settle_s
        options: Any = head.options
        approach = getattr(options, "approach_distance", 0.0)
        start = step.angle_deg + {"from_below": -approach, "from_above": approach, "direct": 0.0}[step.approach]
        rate = getattr(options, "rate", 20.0)
        ramp_s = rate / getattr(options, "acceleration", 40.0)
        legs = (abs(start - self._angle_deg), abs(step.angle_deg - start))
        self._angle_deg = step.angle_deg
        hold_s = getattr(getattr(options, "settle", None), "hold", 0.0)
        return sum(leg / rate + ramp_s for leg in legs if leg > 0) + hold_s + step.settle_s
