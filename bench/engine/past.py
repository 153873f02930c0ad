"""The part of its plan that an interrupted run has done, by its journal, and what a resumed one must restore."""

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

ATTITUDE = "attitude"  # what a step that orients sets, whatever axes it moves


@dataclass
class Past:
    """The part of a plan that was done before an interruption.

    `over` are the ids of steps and sections that ended or were left out, as the plan has them; `begun` counts how often
    each step was begun. `decisions` are those of conditions, by the ids of `decision`. `values` are the variables as
    they were when each step last began, `angles_deg` where each movement went. `dropped` are units that take no further
    part. `under_way` are the steps that were interrupted, `state` is that of the run without them. `restarted` are
    groups that are done again from their first step. `credit` is what a soak that is done again may have.
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
        """Whether a step or section is over; only once, because what is asked for again is to be done."""
        if step not in self.over:
            return False
        self.over.remove(step)
        return True

    def restart(self, groups: Iterable[str]) -> None:
        """Mark groups as to be done again from their first step."""
        self.restarted = tuple(groups)
        for group in self.restarted:
            self.forget(group)

    def forget(self, inside: str) -> None:
        """Mark everything inside a node as not done."""
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
        for node in _begun_anew(entry):
            past.forget(node)
    past.under_way = tuple(map(first_visit, past.state.under_way))
    past.state = advanced(past.state, "run_resumed", "", {})
    return past


def _begun_anew(entry: Entry) -> Iterable[str]:
    """Ids of the nodes that are done once more from their first step after an entry."""
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
    """The id of a decision of a condition; of a loop, that before its pass of a number."""
    return node.id if isinstance(node, Alternatives) else f"{node.id}/pass={number}"


def done_of(nodes: Nodes, past: Past) -> Iterator[PlannedStep]:
    """The steps of nodes that a resumed run passes over, in the order of the plan."""
    return _those_of(nodes, past, past.over)


def under_way_of(nodes: Nodes, past: Past) -> Iterator[PlannedStep]:
    """The steps of nodes that an interruption cut short, but those inside an acquisition, which is made anew."""
    return _those_of(nodes, past, past.under_way)


def _those_of(nodes: Nodes, past: Past, ids: Container[str]) -> Iterator[PlannedStep]:
    for node in nodes:
        if isinstance(node, PlannedStep):
            if node.id in ids:
                yield node
        else:
            for inner in _gone_into(node, past):
                yield from _those_of(inner, past, ids)


def _gone_into(node: Node, past: Past) -> Iterator[Nodes]:
    """The nodes inside a node that were begun, and are not to be done again as a whole."""
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
    """The groups with a restart point in which a run was interrupted, outermost first."""
    for node in nodes:
        if isinstance(node, PlannedStep):
            continue
        if isinstance(node, Section) and node.restart_at is not None and node.id not in past.over:
            beginning = f"{node.id}/"
            if any(step.startswith(beginning) for step in past.begun):
                yield node
        for inner in _gone_into(node, past):
            yield from interrupted_in(inner, past)


def to_restore(done: Iterable[PlannedStep]) -> list[PlannedStep]:
    """The steps that bring a bench that was made safe back to where it was, in their order.

    They are the last one of each stimulus, and the waiting that followed it, in full: after an interruption nothing
    counts as settled but what `Past.credit` proves.
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
    """Names of what a step sets for longer than it lasts; empty for any other step."""
    step = planned.step
    if isinstance(step, (Move, Ramp, SetOutput)):
        return (step.role,)
    return (ATTITUDE,) if isinstance(step, Orient) else ()
