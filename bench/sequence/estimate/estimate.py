"""Estimate of the duration of a plan and of its data volume, from plan and bench alone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import copy
from functools import cache
from typing import Any, NamedTuple, assert_never

from bench.config.channels import period_s
from bench.config.devices import DeviceEntry
from bench.config.models import BenchFile
from bench.sequence.document.model import PHASES, Phase
from bench.sequence.estimate.settling import Settling
from bench.sequence.plan.motion import REST_S, oscillation_s, rate_change_s, way_s
from bench.sequence.plan.plan import (
    Alternatives,
    Attempts,
    Branches,
    Meanwhile,
    Nodes,
    Passes,
    Plan,
    PlannedStep,
    Section,
)
from bench.sequence.steps.custom import Custom, known_steps
from bench.sequence.steps.measuring import Acquire, Measure, Tare
from bench.sequence.steps.orienting import Orient, Pose, Turning, Unreachable
from bench.sequence.steps.stimulus import TURN_DEG, Move, Oscillate, Ramp, Rotate, SetOutput
from bench.sequence.steps.talk import Alarm, Note, Prompt
from bench.sequence.steps.verbs import Step
from bench.sequence.steps.waits import Soak, Wait, WaitUntil
from drivers.capabilities import Approach

COMMAND_S = 0.05
ANSWER_S = 60.0  # for a person to read a question, carry out the request and answer
# Sizes found in run stores: a latch of three axes after compression, a reading, a step, and an empty store.
STORED_BYTES_PER_LATCH, STORED_BYTES_PER_READING, STORED_BYTES_PER_STEP, STORED_BYTES = 36, 25, 250, 25_000


class BenchState(NamedTuple):
    """State of a bench: set point of the chamber, angle and rate of each axis, level of each output.

    `outputs` are volts or amperes by role, of those that are on; not-a-number where it depends on a measurement.
    `rates_dps` are those of tables that keep turning.
    """

    set_point_c: float
    angles_deg: Mapping[str, float] = {}
    rates_dps: Mapping[str, float] = {}
    outputs: Mapping[str, float] = {}


class Span(NamedTuple):
    """First execution of a step on the time axis: state of the bench at its end, maximum number of executions."""

    step: PlannedStep
    begin_s: float
    duration_s: float
    state: BenchState
    times: int = 1

    @property
    def end_s(self) -> float:
        """Time at which it ends."""
        return self.begin_s + self.duration_s


class Estimate(NamedTuple):
    """Steps of a plan in order with their times, duration of each phase, and size of the run store.

    Both alternatives are included, and the longer one counts. A loop with a measured end counts with its maximum number
    of passes, attempts count once.
    """

    spans: tuple[Span, ...]
    phases_s: Mapping[Phase, float]
    size_bytes: int

    @property
    def total_s(self) -> float:
        """Time from the beginning of the first phase to the end of the last."""
        return math.fsum(self.phases_s.values())

    def of_phase(self, phase: Phase) -> float:
        """Duration of a phase; 0 without steps."""
        return self.phases_s[phase]


def estimate(plan: Plan, bench: BenchFile) -> Estimate:
    """Estimate of a plan; roles that the bench lacks count as instantaneous."""
    course = _Course(bench)
    phases_s: dict[Phase, float] = {}
    at_s = 0.0
    for phase, nodes in zip(PHASES, (plan.setup, plan.steps, plan.teardown), strict=True):
        end_s = course.nodes(nodes, at_s)
        phases_s[phase], at_s = end_s - at_s, end_s
    spans = tuple(course.spans)
    return Estimate(spans, phases_s, _size_bytes(spans, at_s, bench))


def _size_bytes(spans: tuple[Span, ...], total_s: float, bench: BenchFile) -> int:
    meters = set(bench.with_capability("voltmeter"))
    acquiring = {span.step.step.role for span in spans if isinstance(span.step.step, Acquire)}
    counted = {role for role in acquiring if not meters & set(bench.acquired_from(role))}
    counting_s = math.fsum(
        span.duration_s * span.times
        for span in spans
        if isinstance(span.step.step, Acquire) and span.step.step.role in counted
    )
    latch_s = min((_frame_period_s(entry) for entry in bench.devices.values()), default=1.0)
    per_s = math.fsum(len(entry.channels) / period_s(role, bench) for role, entry in bench.devices.items())
    size = counting_s / latch_s * STORED_BYTES_PER_LATCH + total_s * per_s * STORED_BYTES_PER_READING
    return int(size) + STORED_BYTES_PER_STEP * sum(span.times for span in spans) + STORED_BYTES


def _frame_period_s(entry: DeviceEntry) -> float:
    """Period of latches or samples of a device that sends frames."""
    return min((output.period_s for output in entry.outputs.values()), default=1.0)


class _Course:
    """Pass through a plan in time order that tracks the state of the bench."""

    def __init__(self, bench: BenchFile) -> None:
        self._bench = bench
        self._state = BenchState(bench.simulation.chamber.start)
        self._settling = Settling(bench)
        self._turning = Turning(bench)
        self._mount: str | None = None
        self._times = 1
        self._way_s = cache(self._worked_out_way_s)  # passes of a loop have the same ways
        self.spans: list[Span] = []

    def nodes(self, nodes: Nodes, at_s: float) -> float:
        """Add steps that begin at `at_s`; return the time of their end."""
        for node in nodes:
            match node:
                case PlannedStep():
                    at_s = self._step(node, at_s)
                case Meanwhile():
                    at_s = self._meanwhile(node, at_s)
                case Section():
                    at_s = self.nodes((*node.body, *node.teardown), at_s)
                case Alternatives():
                    at_s = self._alternatives(node, at_s)
                case Passes():
                    self._times *= node.at_most
                    at_s += node.at_most * (self.nodes(node.body, at_s) - at_s)
                    self._times //= node.at_most
                case Attempts():
                    at_s = self.nodes(node.body, at_s)
                case Branches():
                    at_s = max([self.nodes(branch, at_s) for branch in node.branches.values()], default=at_s)
                case _:
                    assert_never(node)
        return at_s

    def _alternatives(self, node: Alternatives, at_s: float) -> float:
        """Both alternatives begin with the same bench; later steps begin with the bench of the longer one."""
        before = self._state, copy(self._settling)
        then_s = self.nodes(node.then, at_s)
        after = self._state, self._settling
        self._state, self._settling = before
        otherwise_s = self.nodes(node.otherwise, at_s)
        if then_s >= otherwise_s:
            self._state, self._settling = after
        return max(then_s, otherwise_s)

    def _meanwhile(self, node: Meanwhile, at_s: float) -> float:
        """Duration of a step that lasts as long as the steps inside it; its motion stops with them."""
        index = len(self.spans)
        began_s = self._step(node.step, at_s)
        end_s = self.nodes(node.body, began_s)
        step = node.step.step
        if isinstance(step, Rotate):
            rest_s = _known(rate_change_s(step, self._options(step.role)))
            self._turn(step.role, step.rate_dps, end_s - began_s)
            end_s += rest_s
        if isinstance(step, (Rotate, Oscillate)):
            rates_dps = {role: rate for role, rate in self._state.rates_dps.items() if role != step.role}
            self._state = self._state._replace(rates_dps=rates_dps)
        self.spans[index] = self.spans[index]._replace(duration_s=end_s - at_s, state=self._state)
        return end_s

    def _step(self, planned: PlannedStep, at_s: float) -> float:
        duration_s = _known(self._duration_s(planned.step, at_s))
        self.spans.append(Span(planned, at_s, duration_s, self._state, self._times))
        return at_s + duration_s

    def _duration_s(self, step: Step, at_s: float) -> float:  # noqa: C901  one case for each kind of step
        match step:
            case Move():
                return self._move_s(step)
            case Orient():
                return self._orient_s(step)
            case Rotate():
                return self._rotate_s(step)
            case Oscillate():
                return oscillation_s(step, self._options(step.role))
            case Ramp():
                return self._ramp_s(step, at_s)
            case SetOutput():
                self._set(step, at_s)
                return COMMAND_S
            case Soak():
                return self._settling.soak_s(step, at_s)
            case WaitUntil():
                return self._settling.wait_s(step, at_s)
            case Acquire():
                return self._acquire_s(step)
            case Wait() | Tare():
                return step.least_s
            case Measure():
                return max(step.least_s, COMMAND_S)
            case Note() | Alarm():
                return COMMAND_S
            case Prompt():
                self._mount = step.expect.mount if step.expect and step.expect.mount else self._mount
                return min(ANSWER_S, step.give_up_after_s)
            case Custom():
                return _custom_s(step)
            case _:
                assert_never(step)

    def _move_s(self, step: Move) -> float:
        from_deg = self._angle_deg(step.role)
        target_deg = step.target_deg(from_deg)
        if step.role not in self._bench.devices or math.isnan(target_deg):
            return step.settle_s
        self._state = self._state._replace(angles_deg={**self._state.angles_deg, step.role: target_deg})
        return self._way_s(step.role, step.approach, from_deg, target_deg) + step.settle_s

    def _orient_s(self, step: Orient) -> float:
        """Duration of the moves, one axis after the other; 0 for an unreachable attitude, which the check reports."""
        try:
            targets = self._turning.targets_deg(step.attitude, Pose(self._state.angles_deg, self._mount))
        except Unreachable:
            return step.settle_s
        taken_s = step.settle_s
        for role, target_deg in targets.items():
            from_deg = self._angle_deg(role)
            if target_deg != from_deg:
                taken_s += self._way_s(role, step.approach, from_deg, target_deg)
        self._state = self._state._replace(angles_deg={**self._state.angles_deg, **targets})
        return taken_s

    def _rotate_s(self, step: Rotate) -> float:
        """Duration of a rotation; with steps inside, the time until the rate is reached."""
        change_s = rate_change_s(step, self._options(step.role))
        self._turn(step.role, step.rate_dps, change_s)
        if step.during is not None:
            self._state = self._state._replace(rates_dps={**self._state.rates_dps, step.role: step.rate_dps})
            return REST_S + change_s
        self._turn(step.role, step.rate_dps, step.least_s)
        return REST_S + step.least_s + 2 * change_s

    def _turn(self, role: str, rate_dps: float, duration_s: float) -> None:
        """Advance the angle; acceleration and deceleration together cover the angle of one of them at full rate."""
        way_deg = rate_dps * duration_s
        if math.isfinite(way_deg):
            angles_deg = {**self._state.angles_deg, role: self._angle_deg(role) + way_deg}
            self._state = self._state._replace(angles_deg=angles_deg)

    def _ramp_s(self, step: Ramp, at_s: float) -> float:
        from_c, to_c = self._state.set_point_c, step.temperature_c
        duration_s = abs(to_c - from_c) / step.rate_c_per_min * 60 + COMMAND_S
        if math.isfinite(duration_s):
            self._settling.ramp(from_c, to_c, at_s, duration_s)
            self._state = self._state._replace(set_point_c=to_c)
        return duration_s

    def _set(self, step: SetOutput, at_s: float) -> None:
        outputs = {role: level for role, level in self._state.outputs.items() if role != step.role}
        if step.output == "on":
            outputs[step.role] = self._level(step)
        self._state = self._state._replace(outputs=outputs)
        self._settling.power(step.role, step.output == "on", at_s)

    def _level(self, step: SetOutput) -> float:
        """Output level in volts or amperes; not-a-number if it is not known before the run."""
        if step.acceleration_g is not None:
            place = self._bench.places.get(step.place or "")
            return step.acceleration_g * place.nominal.amperes_per_g if place and place.nominal else math.nan
        level = step.voltage_v if step.voltage_v is not None else step.current_a
        return level if level is not None else math.nan

    def _acquire_s(self, step: Acquire) -> float:
        if step.turns is None:
            return step.least_s
        rate_dps = abs(self._state.rates_dps.get(step.of or "", math.inf))
        return step.turns * TURN_DEG / rate_dps

    def _worked_out_way_s(self, role: str, approach: Approach, from_deg: float, target_deg: float) -> float:
        return way_s(approach, from_deg, target_deg, self._options(role))

    def _options(self, role: str) -> Any:
        device = self._bench.devices.get(role)
        return device.options if device is not None else None

    def _angle_deg(self, role: str) -> float:
        return self._state.angles_deg.get(role, 0.0)


def _known(duration_s: float) -> float:
    """A duration; 0 if it depends on a measurement."""
    return 0.0 if math.isnan(duration_s) else duration_s


def _custom_s(step: Custom) -> float:
    description = known_steps()[step.name]
    return max(description.takes_s(description.settings.model_validate(dict(step.settings))), COMMAND_S)
