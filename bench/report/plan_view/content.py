"""A plan over time: lines of set point, angles, rates, levels; bars of soaks, prompts, acquisitions."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

from bench.config.models import BenchFile
from bench.report.plan_view.timeline import output_unit
from bench.sequence.estimate.estimate import Estimate, Span
from bench.sequence.plan.motion import rate_change_s
from bench.sequence.plan.plan import Alternatives, Meanwhile, Nodes, Passes, Plan, PlannedStep, leaves, within
from bench.sequence.steps.measuring import Acquire, Measure, Tare
from bench.sequence.steps.orienting import Orient
from bench.sequence.steps.stimulus import TURN_DEG, Move, Oscillate, Ramp, Rotate, SetOutput
from bench.sequence.steps.talk import Prompt
from bench.sequence.steps.verbs import Step
from bench.sequence.steps.waits import Soak, Wait, WaitUntil

Points = list[tuple[float, float]]  # (time in s, value); straight lines join the points, a NaN separates them

Kind = Literal["temperature", "angle", "rate", "output"]


@dataclass
class Panel:
    """Lines in one unit, by role. `swings` are oscillations about zero: from, to (s), and amplitude."""

    kind: Kind
    label: str
    lines: dict[str, Points] = field(default_factory=dict)
    swings: list[tuple[float, float, float]] = field(default_factory=list)

    def go(self, role: str, begin_s: float, end_s: float, value: float, at_first: float = 0.0) -> None:
        """Extend a line: constant until `begin_s`, then linear to `value` at `end_s`."""
        line = self.lines.setdefault(role, [(0.0, at_first)])
        line += [(begin_s, line[-1][1]), (end_s, value)]


@dataclass(frozen=True)
class Planned:
    """A plan over time; a panel for each kind of quantity.

    `bars` are begin and end (s) under a name. `passes` are the times of possible passes after the first: begin, end,
    number. With `chosen`, one of several alternatives is shown.
    """

    panels: tuple[Panel, ...]
    bars: Mapping[str, list[tuple[float, float]]]
    passes: tuple[tuple[float, float, int], ...]
    chosen: bool


def planned(plan: Plan, expected: Estimate, bench: BenchFile) -> Planned:
    """Content of a plan: the longer one of alternatives, the first of several passes."""
    nodes = (*plan.setup, *plan.steps, *plan.teardown)
    times = {span.step.id: span for span in expected.spans}
    spans = sorted(_shown(nodes, times), key=lambda span: span.begin_s)
    temperature = Panel("temperature", "set point / °C")
    angle, rate = Panel("angle", "angle / °"), Panel("rate", "rate / °/s")
    outputs = {"V": Panel("output", "output / V"), "A": Panel("output", "output / mA")}
    for span in spans:
        step = span.step.step
        if isinstance(step, Ramp):
            start_c = bench.simulation.chamber.start
            temperature.go(step.role, span.begin_s, span.end_s, span.state.set_point_c, start_c)
        elif isinstance(step, SetOutput):
            unit = output_unit(step.role, bench)
            level = span.state.outputs.get(step.role, 0.0) * (1000 if unit == "A" else 1)
            outputs[unit].go(step.role, span.begin_s, span.begin_s, level)
        elif isinstance(step, Orient):
            for role in bench.axes:
                stands_deg = _within_turns(span.state.angles_deg.get(role, 0.0))
                angle.go(role, span.begin_s, max(span.begin_s, span.end_s - step.settle_s), stands_deg)
        elif isinstance(step, (Move, Rotate, Oscillate)):
            _add_motion(step, span, angle, rate, bench)
    panels = [panel for panel in (temperature, angle, rate, *outputs.values()) if panel.lines or panel.swings]
    for panel in panels:
        for line in panel.lines.values():
            line.append((expected.total_s, line[-1][1]))
    return Planned(tuple(panels), _bars(spans), tuple(_passes(nodes, times)), len(spans) < len(expected.spans))


def _add_motion(step: Move | Rotate | Oscillate, span: Span, angle: Panel, rate: Panel, bench: BenchFile) -> None:
    if isinstance(step, Oscillate):
        rate.swings.append((span.begin_s, span.end_s, step.amplitude_deg * 2 * math.pi * step.highest_hz))
        return
    stands_deg = span.state.angles_deg.get(step.role, 0.0)
    if isinstance(step, Move):
        angle.go(step.role, span.begin_s, max(span.begin_s, span.end_s - step.settle_s), _within_turns(stands_deg))
        return
    device = bench.devices.get(step.role)
    change_s = rate_change_s(step, device.options if device is not None else None)
    rate.go(step.role, span.begin_s, span.begin_s + change_s, step.rate_dps)
    rate.go(step.role, span.end_s - change_s, span.end_s, 0.0)
    if step.role in angle.lines:
        angle.go(step.role, span.begin_s, span.begin_s, math.nan)
        angle.go(step.role, span.end_s, span.end_s, _within_turns(stands_deg))


def _within_turns(angle_deg: float) -> float:
    """An angle unchanged or, many turns away, its equivalent within a turn."""
    return angle_deg if abs(angle_deg) <= 2 * TURN_DEG else angle_deg % TURN_DEG


def _shown(nodes: Nodes, times: Mapping[str, Span]) -> Iterator[Span]:
    for node in nodes:
        if isinstance(node, PlannedStep):
            yield times[node.id]
        elif isinstance(node, Alternatives):
            yield from _shown(max(node.then, node.otherwise, key=lambda branch: _end_s(branch, times)), times)
        else:
            if isinstance(node, Meanwhile):
                yield times[node.step.id]
            for inner in within(node):
                yield from _shown(inner, times)


def _end_s(nodes: Nodes, times: Mapping[str, Span]) -> float:
    return max((times[step.id].end_s for step in leaves(nodes)), default=-1.0)


def _passes(nodes: Nodes, times: Mapping[str, Span]) -> Iterator[tuple[float, float, int]]:
    for node in nodes:
        if isinstance(node, Passes) and node.at_most > 1:
            begin_s, end_s = min(times[step.id].begin_s for step in leaves(node.body)), _end_s(node.body, times)
            yield end_s, begin_s + node.at_most * (end_s - begin_s), node.at_most - 1
        else:
            for inner in within(node):
                yield from _passes(inner, times)


def _bars(spans: list[Span]) -> dict[str, list[tuple[float, float]]]:
    """Bars of steps that take time: waits first, acquisitions last, each under its label."""
    order = {name: number for number, name in enumerate(("prompt", "soak", "wait", "oscillate", "measure"))}
    found: dict[str, list[tuple[float, float]]] = {}
    for span in spans:
        if name := _bar_of(span.step.step):
            found.setdefault(name, []).append((span.begin_s, span.end_s))
    return dict(sorted(found.items(), key=lambda bar: order.get(bar[0], len(order))))


def _bar_of(step: Step) -> str:
    match step:
        case Soak():
            return "soak"
        case Wait() | WaitUntil():
            return "wait"
        case Prompt():
            return "prompt"
        case Oscillate():
            return "oscillate"
        case Measure() | Tare():
            return "measure"
        case Acquire():
            return f"acquire {step.label}"
        case _:
            return ""
