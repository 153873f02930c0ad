"""How long a plan takes and how much it writes, worked out from the plan and the bench alone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, assert_never

from bench.config.models import BenchFile
from bench.sequence.custom import Custom, known_steps
from bench.sequence.measuring import Acquire, Measure, Tare
from bench.sequence.plan import (
    Alternatives,
    Attempts,
    Branches,
    Meanwhile,
    Nodes,
    Passes,
    Phase,
    Plan,
    PlannedStep,
    Section,
)
from bench.sequence.settling import Settling
from bench.sequence.steps import Step
from bench.sequence.stimulus import TURN_DEG, Move, Oscillate, Ramp, Rotate, SetOutput
from bench.sequence.talk import Alarm, Note, Prompt
from bench.sequence.waits import Soak, Wait, WaitUntil

COMMAND_S = 0.05
ANSWER_S = 60.0  # what a person takes to read a question, do what it asks, and answer
STORED_BYTES_PER_LATCH = 12  # three axes after compression
STORED_BYTES_PER_READING = 40


@dataclass(frozen=True, slots=True)
class BenchState:
    """Where a bench stands: the chamber's set point, the angle and the rate of each axis, the level of each output.

    `outputs` are volts or amperes by role, of those that are on.
    """

    set_point_c: float
    angles_deg: Mapping[str, float] = field(default_factory=dict)
    rates_dps: Mapping[str, float] = field(default_factory=dict)
    outputs: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Span:
    """A step on the time axis of a plan, and the bench when it ends."""

    step: PlannedStep
    begin_s: float
    duration_s: float
    state: BenchState

    @property
    def end_s(self) -> float:
        """When it ends."""
        return self.begin_s + self.duration_s


@dataclass(frozen=True, slots=True)
class Estimate:
    """The steps of a plan in its order, each with its time, when all has ended, and bytes in the run store.

    Of alternatives both are there, and the longer one counts. A loop whose end is measured counts as often as it may be
    gone through, attempts once.
    """

    spans: tuple[Span, ...]
    total_s: float
    size_bytes: int

    @property
    def steps_s(self) -> tuple[float, ...]:
        """How long each step takes, once."""
        return tuple(span.duration_s for span in self.spans)

    def of_phase(self, phase: Phase) -> float:
        """From the first step of a phase to its last; 0 without steps."""
        spans = [span for span in self.spans if span.step.id.startswith(f"{phase}/")]
        return max(span.end_s for span in spans) - min(span.begin_s for span in spans) if spans else 0.0


def estimate(plan: Plan, bench: BenchFile) -> Estimate:
    """The estimate; roles that the bench lacks count as instantaneous."""
    course = _Course(bench)
    total_s = course.nodes((*plan.setup, *plan.steps, *plan.teardown), 0.0)
    spans = tuple(course.spans)
    return Estimate(spans, total_s, _size_bytes(spans, total_s, bench))


def _size_bytes(spans: tuple[Span, ...], total_s: float, bench: BenchFile) -> int:
    counting_s = sum(span.duration_s for span in spans if isinstance(span.step.step, Acquire))
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
    size = counting_s / period_s * STORED_BYTES_PER_LATCH + total_s * per_s * STORED_BYTES_PER_READING
    return int(size) + 100_000


class _Course:
    """Goes through a plan along its time, and keeps where things stand."""

    def __init__(self, bench: BenchFile) -> None:
        self._bench = bench
        self._state = BenchState(bench.simulation.chamber.start)
        self._settling = Settling(bench)
        self.spans: list[Span] = []

    def nodes(self, nodes: Nodes, at_s: float) -> float:
        """Takes up steps that begin at `at_s`; when they have ended."""
        for node in nodes:
            match node:
                case PlannedStep():
                    at_s = self._step(node, at_s)
                case Meanwhile():
                    at_s = self._meanwhile(node, at_s)
                case Section():
                    at_s = self.nodes((*node.body, *node.teardown), at_s)
                case Alternatives():
                    before = self._state
                    then_s = self.nodes(node.then, at_s)
                    after, self._state = self._state, before
                    otherwise_s = self.nodes(node.otherwise, at_s)
                    self._state = after if then_s >= otherwise_s else self._state
                    at_s = max(then_s, otherwise_s)
                case Passes():
                    at_s += node.at_most * (self.nodes(node.body, at_s) - at_s)
                case Attempts():
                    at_s = self.nodes(node.body, at_s)
                case Branches():
                    at_s = max([self.nodes(branch, at_s) for branch in node.branches.values()], default=at_s)
                case _:
                    assert_never(node)
        return at_s

    def _meanwhile(self, node: Meanwhile, at_s: float) -> float:
        """The step lasts as long as those inside; what it turns comes to rest with them."""
        index = len(self.spans)
        self._step(node.step, at_s)
        end_s = self.nodes(node.body, self.spans[index].end_s)
        rates = {role: rate for role, rate in self._state.rates_dps.items() if role != node.step.step.role}  # type: ignore[union-attr]  # steps with others inside have a role
        self._state = replace(self._state, rates_dps=rates)
        self.spans[index] = replace(self.spans[index], duration_s=end_s - at_s, state=self._state)
        return end_s

    def _step(self, planned: PlannedStep, at_s: float) -> float:
        duration_s = self._duration_s(planned.step, at_s)
        duration_s = 0.0 if math.isnan(duration_s) else duration_s  # where it waits for a measurement
        self.spans.append(Span(planned, at_s, duration_s, self._state))
        return at_s + duration_s

    def _duration_s(self, step: Step, at_s: float) -> float:  # noqa: C901  one case for each kind of step
        match step:
            case Move():
                return self._move_s(step)
            case Rotate():
                return self._rotate_s(step)
            case Oscillate() | Wait() | Measure() | Tare():
                return max(step.least_s, COMMAND_S if isinstance(step, (Oscillate, Measure)) else 0.0)
            case SetOutput():
                self._set(step)
                return COMMAND_S
            case Note() | Alarm():
                return COMMAND_S
            case Acquire():
                return self._acquire_s(step)
            case Prompt():
                return ANSWER_S
            case Custom():
                return self._custom_s(step)
            case Soak():
                return self._settling.soak_s(step, at_s)
            case WaitUntil():
                return self._settling.wait_s(step, at_s)
            case Ramp():
                distance_c = abs(step.temperature_c - self._state.set_point_c)
                duration_s = distance_c / step.rate_c_per_min * 60 + COMMAND_S
                self._settling.ramp(self._state.set_point_c, step.temperature_c, at_s, duration_s)
                self._state = replace(self._state, set_point_c=step.temperature_c)
                return duration_s
            case _:
                assert_never(step)

    def _set(self, step: SetOutput) -> None:
        outputs = {role: level for role, level in self._state.outputs.items() if role != step.role}
        if step.output == "on":
            levels = (step.voltage_v, step.current_a, step.acceleration_g)
            outputs[step.role] = next((level for level in levels if level is not None), 0.0)
        self._state = replace(self._state, outputs=outputs)

    def _custom_s(self, step: Custom) -> float:
        description = known_steps()[step.name]
        return max(description.takes_s(description.settings.model_validate(dict(step.settings))), COMMAND_S)

    def _acquire_s(self, step: Acquire) -> float:
        if step.turns is None:
            return step.least_s
        rate_dps = abs(self._state.rates_dps.get(step.of or "", math.inf))
        return step.turns * TURN_DEG / rate_dps

    def _rotate_s(self, step: Rotate) -> float:
        options = self._options(step.role)
        acceleration: float = step.acceleration_dps2 or getattr(options, "acceleration", None) or 40.0
        change_s = abs(step.rate_dps) / acceleration
        if step.during is not None:
            self._state = replace(self._state, rates_dps={**self._state.rates_dps, step.role: step.rate_dps})
            return change_s
        angle_deg = self._angle_deg(step.role) + math.copysign(step.least_s * abs(step.rate_dps), step.rate_dps)
        self._state = replace(self._state, angles_deg={**self._state.angles_deg, step.role: angle_deg})
        return step.least_s + 2 * change_s

    def _move_s(self, step: Move) -> float:
        target_deg = step.target_deg(self._angle_deg(step.role))
        if step.role not in self._bench.devices or math.isnan(target_deg):
            return step.settle_s
        options = self._options(step.role)
        approach = getattr(options, "approach_distance", 0.0)
        start = target_deg + {"from_below": -approach, "from_above": approach, "direct": 0.0}[step.approach]
        rate = getattr(options, "rate", 20.0)
        ramp_s = rate / getattr(options, "acceleration", 40.0)
        legs = (abs(start - self._angle_deg(step.role)), abs(target_deg - start))
        self._state = replace(self._state, angles_deg={**self._state.angles_deg, step.role: target_deg})
        hold_s = getattr(getattr(options, "settle", None), "hold", 0.0)
        return sum(leg / rate + ramp_s for leg in legs if leg > 0) + hold_s + step.settle_s

    def _options(self, role: str) -> Any:
        device = self._bench.devices.get(role)
        return device.options if device is not None else None

    def _angle_deg(self, role: str) -> float:
        return self._state.angles_deg.get(role, 0.0)
