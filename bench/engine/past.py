"""Completed part of the plan of an interrupted run, from its journal, and the conditions to restore."""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bench.engine.state import Entry, RunState, advanced
from bench.engine.units import UnitFailure
from bench.sequence.language.expressions import Value
from bench.sequence.plan.dwells import first_visit
from bench.sequence.plan.plan import Alternatives, Meanwhile, Node, Nodes, Passes, PlannedStep, Section, within
from bench.sequence.steps.measuring import Acquire
from bench.sequence.steps.orienting import Orient
from bench.sequence.steps.stimulus import Move, Ramp, SetOutput

if TYPE_CHECKING:
    from bench.engine.crediting import SoakCredit

ATTITUDE = "attitude"  # set by a step that orients, whichever axes it moves


@dataclass
class Past:
    """The part of a plan that was completed before an interruption.

    `over` are the ids, as in the plan, of steps and sections that ended or were left out; `begun` counts how often each
    step was begun. `decisions` are those of conditions, by the ids of `decision`. `values` are the variables when each
    step last began, `angles_deg` the target of each movement. `dropped` are units that take no further part.
    `under_way` are the steps that were interrupted, `state` is that of the run without them. `restarted` are groups
    that are repeated from their first step. `credit` is that of a repeated soak.
    """

    state: RunState = field(default_factory=RunState)
    over: set[str] = field(default_factory=set)
    begun: Counter[str] = field(default_factory=Counter)
    decisions: dict[str, bool] = field(default_factory=dict)
    values: dict[str, Mapping[str, Value]] = field(default_factory=dict)
    angles_deg: dict[str, float] = field(default_factory=dict)
    dropped: list[UnitFailure] = field(default_factory=list)
    under_way: tuple[str, ...] = ()
    restarted: tuple[str, ...] = ()
    credit: SoakCredit | None = None

    def passes_over(self, step: str) -> bool:
        """True if a step or section is completed; only once, because a step requested again is to be executed."""
        if step not in self.over:
            return False
        self.over.remove(step)
        return True

    def restart(self, groups: Iterable[str]) -> None:
        """Mark groups as to be repeated from their first step."""
        self.restarted = tuple(groups)
        for group in self.restarted:
            self.forget(group)

    def forget(self, inside: str) -> None:
        """Mark everything inside a node as not completed."""
        beginning = f"{inside}/"
        self.over = {each for each in self.over if not each.startswith(beginning)}
        self.decisions = {key: taken for key, taken in self.decisions.items() if not key.startswith(beginning)}


def past_of(entries: Iterable[Entry]) -> Past:
    """Fold the entries of a journal; a step that was begun again counts from its last beginning."""
    past = Past()
    for entry in entries:
        past.state = advanced(past.state, entry.kind, entry.step, entry.data)
        step = first_visit(entry.step)
        match entry.kind:
            case "step_begins":
                past.begun[step] += 1
                past.values[step] = past.state.variables
                past.over.discard(step)
            case "step_ended":
                past.over.add(step)
                if "angle_deg" in entry.data:
                    past.angles_deg[step] = float(entry.data["angle_deg"])
            case "left_out" | "group_ended":
                past.over.add(step)
            case "unit_dropped":
                place, kind, text = (entry.data[key] for key in ("place", "fault", "text"))
                past.dropped.append(UnitFailure(place, kind, text))
            case "decided":
                past.decisions[entry.step] = bool(entry.data["taken"])
            case _:
                pass
        for node in _repeated_nodes(entry):
            past.forget(node)
    past.under_way = tuple(map(first_visit, past.state.under_way))
    past.state = advanced(past.state, "run_resumed", "", {})
    return past


def _repeated_nodes(entry: Entry) -> Iterable[str]:
    """Ids of the nodes that are repeated from their first step after an entry."""
    match entry.kind:
        case "retried":
            return (first_visit(entry.step),)
        case "answered" if entry.data.get("answer") == "repeat":
            return (first_visit(entry.step).removesuffix("?"),)
        case "run_resumed":
            return tuple(entry.data.get("restarted", ()))
        case _:
            return ()


def decision(node: Alternatives | Passes, number: int = 1) -> str:
    """Id of a decision of a condition; of a loop, of the decision before the pass `number`."""
    return node.id if isinstance(node, Alternatives) else f"{node.id}/pass={number}"


def done_of(nodes: Nodes, past: Past) -> Iterator[PlannedStep]:
    """Steps of nodes that a resumed run passes over, in plan order."""
    return _those_of(nodes, past, past.over)


def interrupted_steps(nodes: Nodes, past: Past) -> Iterator[PlannedStep]:
    """Steps of nodes that an interruption cut short, except those inside an acquisition, which is repeated whole."""
    return _those_of(nodes, past, past.under_way)


def _those_of(nodes: Nodes, past: Past, ids: Container[str]) -> Iterator[PlannedStep]:
    for node in nodes:
        if isinstance(node, PlannedStep):
            if node.id in ids:
                yield node
        else:
            for inner in _entered_nodes(node, past):
                yield from _those_of(inner, past, ids)


def _entered_nodes(node: Node, past: Past) -> Iterator[Nodes]:
    """Nodes inside a node that were begun and are not to be repeated as a whole."""
    match node:
        case Meanwhile() if node.step.id not in past.over and isinstance(node.step.step, Acquire):
            return
        case Alternatives():
            if (taken := past.decisions.get(decision(node))) is not None:
                yield node.then if taken else node.otherwise
        case Passes():
            for number in range(1, node.at_most + 1):
                if not past.decisions.get(decision(node, number)):
                    return
                yield node.numbered(number)
        case _:
            yield from within(node)


def interrupted_in(nodes: Nodes, past: Past) -> Iterator[Section]:
    """Groups with a restart point in which a run was interrupted, outermost first."""
    for node in nodes:
        if isinstance(node, PlannedStep):
            continue
        if isinstance(node, Section) and node.restart_at is not None and node.id not in past.over:
            beginning = f"{node.id}/"
            if any(step.startswith(beginning) for step in past.begun):
                yield node
        for inner in _entered_nodes(node, past):
            yield from interrupted_in(inner, past)


def steps_to_restore(done: Iterable[PlannedStep]) -> list[PlannedStep]:
    """Steps that bring a bench that was made safe back to its previous condition, in order.

    They are the last step of each stimulus and the complete wait that followed it: after an interruption nothing counts
    as settled except by `Past.credit`.
    """
    last: dict[str, str] = {}
    steps = list(done)
    for planned in steps:
        for name in _stimuli(planned):
            last[name] = planned.id
    wanted, follows = set(last.values()), False
    restored = []
    for planned in steps:
        if _stimuli(planned):
            follows = planned.id in wanted
            if follows:
                restored.append(planned)
        elif follows and planned.step.resumed == "in full":
            restored.append(planned)
    return restored


def _stimuli(planned: PlannedStep) -> tuple[str, ...]:
    """Names of the quantities that a step sets beyond its own duration; empty for any other step."""
    step = planned.step
    if isinstance(step, (Move, Ramp, SetOutput)):
        return (step.role,)
    return (ATTITUDE,) if isinstance(step, Orient) else ()
