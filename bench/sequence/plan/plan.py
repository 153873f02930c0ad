"""A plan: every step of a run with its values and a stable id, in the order and nesting of execution.

It is data that can be listed, counted and checked. Everything known before the run is unrolled; a part that depends on
measurements remains a node: alternatives, passes, attempts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from bench.config.document import Document, Place
from bench.sequence.document.model import Outline, Phase
from bench.sequence.language.expressions import Value
from bench.sequence.steps.fields import OnFailure, RestartAt
from bench.sequence.steps.verbs import Step


class Waiting(NamedTuple):
    """Expressions over measurements: their document text, and the names whose values are known."""

    raw: Any
    names: Mapping[str, Value]


class PlannedStep(NamedTuple):
    """One step of a run.

    `id` names it by its loops (`steps/temperature=-40/position=90#2/acquire`; `#n` marks the n-th visit of the same
    value). `loops` holds the variables around it, outermost first; `place` is its place in the document. Expressions
    over measurements are in `waiting`; their numbers are not-a-number until they are known.
    """

    id: str
    phase: Phase
    step: Step
    loops: Mapping[str, Value]
    place: Place
    waiting: Waiting | None = None


class Meanwhile(NamedTuple):
    """A step that lasts as long as other steps do."""

    step: PlannedStep
    body: Nodes


class Section(NamedTuple):
    """Steps with their own teardown, or with a reaction to their failure or interruption."""

    id: str
    body: Nodes
    teardown: Nodes
    on_failure: OnFailure | None
    place: Place
    restart_at: RestartAt | None = None


class Alternatives(NamedTuple):
    """Steps for a condition over measurements that is true, and those for one that is false."""

    id: str
    condition: Waiting
    then: Nodes
    otherwise: Nodes
    place: Place


class Passes(NamedTuple):
    """Steps repeated while a condition over measurements is true; ids are those of the first pass."""

    id: str
    condition: Waiting
    at_most: int
    body: Nodes
    place: Place

    def numbered(self, number: int) -> Nodes:
        """Nodes of a pass, with its number in their ids."""
        return renamed(self.body, f"{self.id}/pass=1/", f"{self.id}/pass={number}/")


class Branches(NamedTuple):
    """Steps executed in parallel."""

    id: str
    branches: Mapping[str, Nodes]
    place: Place


class Attempts(NamedTuple):
    """Steps repeated if they fail with one of these kinds of errors."""

    id: str
    at_most: int
    delay_s: float
    on: tuple[str, ...]
    body: Nodes
    place: Place


Node = PlannedStep | Meanwhile | Section | Alternatives | Passes | Branches | Attempts
Nodes = tuple[Node, ...]


def within(node: Node) -> tuple[Nodes, ...]:
    """Nodes inside a node, by its lists."""
    match node:
        case PlannedStep():
            return ()
        case Meanwhile() | Passes() | Attempts():
            return (node.body,)
        case Section():
            return (node.body, node.teardown)
        case Alternatives():
            return (node.then, node.otherwise)
        case Branches():
            return tuple(node.branches.values())


def leaves(nodes: Nodes) -> Iterator[PlannedStep]:
    """Steps of nodes in document order: of all alternatives, of one pass and one attempt."""
    for node in nodes:
        if isinstance(node, PlannedStep):
            yield node
        elif isinstance(node, Meanwhile):
            yield node.step
        for inner in within(node):
            yield from leaves(inner)


def renamed(nodes: Nodes, old: str, new: str) -> Nodes:
    """The same nodes with another prefix of their ids."""
    return tuple(_renamed(node, old, new) for node in nodes)


def _renamed(node: Node, old: str, new: str) -> Node:
    if isinstance(node, Meanwhile):
        step = node.step._replace(id=node.step.id.replace(old, new, 1))
        return Meanwhile(step, renamed(node.body, old, new))
    named = node._replace(id=node.id.replace(old, new, 1))
    match named:
        case PlannedStep():
            return named
        case Section():
            return named._replace(body=renamed(named.body, old, new), teardown=renamed(named.teardown, old, new))
        case Alternatives():
            then, otherwise = renamed(named.then, old, new), renamed(named.otherwise, old, new)
            return named._replace(then=then, otherwise=otherwise)
        case Branches():
            return named._replace(branches={key: renamed(nodes, old, new) for key, nodes in named.branches.items()})
        case Passes() | Attempts():
            return named._replace(body=renamed(named.body, old, new))


@dataclass(frozen=True)
class Plan:
    """A sequence with its parameters chosen and its loops unrolled."""

    document: Document
    sequence: Outline
    parameters: Mapping[str, Value]
    preset: str | None
    setup: Nodes
    steps: Nodes
    teardown: Nodes
    _flat: tuple[PlannedStep, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_flat", tuple(leaves((*self.setup, *self.steps, *self.teardown))))

    @property
    def name(self) -> str:
        """Name of the file without its suffix."""
        return self.document.path.stem

    def __iter__(self) -> Iterator[PlannedStep]:
        """Iterate over the steps, in the order of `leaves`."""
        return iter(self._flat)

    def __len__(self) -> int:
        return len(self._flat)

    def where(self, place: Place) -> str:
        """`file:line:column` of a step, also of one in a called sequence."""
        return self.document.where(place)
