"""Timeline of a plan as text: beginning and duration of each step, and the bench at its end."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, assert_never

from bench.config.models import BenchFile
from bench.figures.times_and_sizes import duration
from bench.sequence.estimate.estimate import BenchState, Estimate, Span
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
from bench.sequence.steps.orienting import Orient
from bench.sequence.steps.stimulus import Move, Oscillate, Ramp, Rotate, SetOutput

WIDTH = 120
RESUMED = "resumed"
RESTARTED = {"begin": "again from its begin", "never": "not resumed"}


def plan_table(plan: Plan, expected: Estimate, bench: BenchFile) -> Iterator[str]:
    """A line for each step, and one for each decision that is left to the run, with its steps indented.

    The columns in the middle are the bench after the step, one for each device that the plan acts on, and the treatment
    of the step by a resumed run.
    """
    rows = list(_Rows(plan, expected).rows)
    columns = [_Column(role, bench) for role in acted_on(plan, bench)]
    widths = [
        max([len(column.role), *(len(column.cell(row.span.state)) for row in rows if row.span)]) for column in columns
    ]
    widths.append(max([len(RESUMED), *(len(row.span.step.step.resumed) for row in rows if row.span)]))
    yield _line("begins", "takes", [*(column.role for column in columns), RESUMED], widths, "step")
    for row in rows:
        if row.span is None:
            yield _line("", "", ["" for _ in widths], widths, row.text)
        else:
            cells = [*(column.cell(row.span.state) for column in columns), row.span.step.step.resumed]
            yield _line(clock(row.span.begin_s), duration(row.span.duration_s), cells, widths, row.text)


def safe_states(bench: BenchFile) -> Iterator[str]:
    """A line for each device that moves or energises something: its safe state, and the time to reach it."""
    states = {role: entry.safe_state for role, entry in bench.devices.items() if entry.safe_state.words}
    widths = [max(map(len, column), default=0) for column in (states, (state.words for state in states.values()))]
    for role, state in states.items():
        alone = "" if state.alone_after_s is None else f"; by itself after {state.alone_after_s:g} s of silence"
        held = f"; after a failure held for {duration(state.hold_s)} before" if state.hold_s else ""
        yield f"{role:<{widths[0]}}  {state.words:<{widths[1]}}  within {state.within_s:.3g} s{alone}{held}"


def acted_on(plan: Plan, bench: BenchFile) -> list[str]:
    """Roles that the steps of a plan act on: chambers, then axes, then outputs."""
    chambers, axes, outputs = [], list[str](), []
    for planned in plan:
        match planned.step:
            case Ramp(role=role):
                chambers.append(role)
            case Move(role=role) | Rotate(role=role) | Oscillate(role=role):
                axes.append(role)
            case Orient():
                axes += bench.axes
            case SetOutput(role=role):
                outputs.append(role)
            case _:
                pass
    return list(dict.fromkeys([*chambers, *axes, *outputs]))


def output_unit(role: str, bench: BenchFile) -> str:
    """Unit of the level of an output."""
    device = bench.devices.get(bench.members(role)[0])
    return "A" if device is not None and "current_source" in device.description.capabilities else "V"


def turned_by_hand(expected: Estimate, bench: BenchFile) -> Mapping[str, int]:
    """Number of turns by hand of each head without a motor, for plans that need one."""
    times: Counter[str] = Counter()
    for span in expected.spans:
        step = span.step.step
        if isinstance(step, Move) and span.duration_s > step.settle_s:
            device = bench.devices.get(step.role)
            if device is not None and device.connection.is_person:
                times[step.role] += span.times
    return times


def timeline_json(expected: Estimate, bench: BenchFile) -> dict[str, Any]:
    """Timeline for programs; null for values unknown before the run."""
    return {
        "total_s": expected.total_s,
        "size_bytes": expected.size_bytes,
        "phases_s": dict(expected.phases_s),
        "made_safe": {
            role: {"state": state.words, "within_s": state.within_s, "alone_after_s": state.alone_after_s}
            for role, state in ((role, entry.safe_state) for role, entry in bench.devices.items())
            if state.words
        },
        "steps": [
            {
                "id": span.step.id,
                "begin_s": span.begin_s,
                "duration_s": span.duration_s,
                "times": span.times,
                "if_resumed": span.step.step.resumed,
                "set_point_c": span.state.set_point_c,
                "angles_deg": _known(span.state.angles_deg),
                "rates_dps": _known(span.state.rates_dps),
                "outputs": _known(span.state.outputs),
            }
            for span in expected.spans
        ],
    }


def _known(values: Mapping[str, float]) -> dict[str, float | None]:
    return {role: None if math.isnan(value) else value for role, value in values.items()}


def clock(seconds: float) -> str:
    """Hours, minutes and seconds: "32:16:16"."""
    whole = round(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02}:{whole % 60:02}"


def _line(begins: str, takes: str, cells: Sequence[str], widths: Sequence[int], step: str) -> str:
    """A row, no wider than the terminal: a long step id is shortened to its end, which identifies it."""
    state = "".join(f"  {cell:>{width}}" for cell, width in zip(cells, widths, strict=True))
    start = f"{begins:>9}  {takes:>11}{state}  "
    room = max(WIDTH - len(start), 24)
    return start + (step if len(step) <= room else f"…{step[1 - room :]}")


class _Column:
    """Column of a device in the lines of a plan."""

    def __init__(self, role: str, bench: BenchFile) -> None:
        self.role = role
        device = bench.devices.get(role)
        can = device.description.capabilities if device is not None else frozenset[str]()
        self._is_chamber, self._is_axis = "thermal_chamber" in can, bool({"positioner", "rate_table"} & can)
        self._unit = output_unit(role, bench)

    def cell(self, state: BenchState) -> str:
        """Set point, angle, rate or level of the device."""
        if self._is_chamber:
            return f"{state.set_point_c:g} °C"
        if not self._is_axis:
            return _level(state.outputs[self.role], self._unit) if self.role in state.outputs else "off"
        if self.role in state.rates_dps:
            return f"{state.rates_dps[self.role]:g} °/s".replace("nan", "?")
        return f"{round(state.angles_deg.get(self.role, 0.0), 3):g}°"


def _level(value: float, unit: str) -> str:
    if math.isnan(value):
        return f"? {unit}"
    small = unit == "A" and abs(value) < 1
    return f"{value * 1000:.6g} m{unit}" if small else f"{value:.6g} {unit}"


@dataclass(frozen=True, slots=True)
class _Row:
    """A step with its time, or a decision of the run, without one."""

    text: str
    span: Span | None = None


class _Rows:
    """Rows of a plan in its order and nesting."""

    def __init__(self, plan: Plan, expected: Estimate) -> None:
        self._spans = iter(expected.spans)
        self.rows: list[_Row] = []
        self._add((*plan.setup, *plan.steps, *plan.teardown), "")

    def _add(self, nodes: Nodes, indent: str) -> None:  # noqa: C901  one case for each kind of node
        for node in nodes:
            match node:
                case PlannedStep():
                    self._step(indent)
                case Meanwhile():
                    self._step(indent)
                    self._inside("", node.body, indent)
                case Section():
                    failed = f", on failure: {node.on_failure}" if node.on_failure else ""
                    restart = f", if interrupted: {RESTARTED[node.restart_at]}" if node.restart_at else ""
                    self._inside(f"group {node.id}{failed}{restart}", node.body, indent)
                    if node.teardown:
                        self._inside(f"in any case after {node.id}", node.teardown, indent)
                case Alternatives():
                    self._inside(f"if {node.condition.raw}", node.then, indent)
                    if node.otherwise:
                        self._inside("else", node.otherwise, indent)
                case Passes():
                    self._inside(f"while {node.condition.raw}, at most {node.at_most} passes", node.body, indent)
                case Attempts():
                    delay = f", {duration(node.delay_s)} between them" if node.delay_s else ""
                    self._inside(f"retry, {node.at_most} attempts{delay}", node.body, indent)
                case Branches():
                    for name, branch in node.branches.items():
                        self._inside(f"parallel: {name}", branch, indent)
                case _:
                    assert_never(node)

    def _inside(self, heading: str, nodes: Nodes, indent: str) -> None:
        if heading:
            self.rows.append(_Row(indent + heading))
        self._add(nodes, f"{indent}  ")

    def _step(self, indent: str) -> None:
        span = next(self._spans)
        self.rows.append(_Row(indent + span.step.id, span))
