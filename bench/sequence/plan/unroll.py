"""Expansion of each kind of step and block of a document to nodes of a plan."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

from pydantic import ValidationError

from bench.config.document import Place
from bench.sequence.document.model import PHASES, Phase
from bench.sequence.language.expressions import Value, ValueProblem
from bench.sequence.language.values import in_words, spelled
from bench.sequence.plan.plan import (
    Alternatives,
    Attempts,
    Branches,
    Meanwhile,
    Node,
    Nodes,
    Passes,
    PlannedStep,
    Section,
    Waiting,
)
from bench.sequence.plan.scope import Scope
from bench.sequence.steps.blocks import Retry
from bench.sequence.steps.custom import Custom
from bench.sequence.steps.measuring import Measure
from bench.sequence.steps.nested import UNROLLED
from bench.sequence.steps.talk import Prompt
from bench.sequence.steps.verbs import STEPS, Step
from drivers.quantity.quantities import Quantity
from drivers.quantity.units import NO_DIMENSION
from drivers.schema.wording import error_text

Raw = Mapping[str, Any]
Seen = Counter[str]


class Expansion(Protocol):
    """Interface of the pass over a document in which a block is unrolled."""

    def nodes(self, raw: Sequence[Raw], place: Place, scope: Scope, taken: Collection[str] = ()) -> Nodes:
        """Return the nodes of a list of steps and blocks; `taken` are labels already used in its ids."""

    def passes(self, raw: Sequence[Raw], place: Place, scopes: Iterator[Scope]) -> Iterator[Node]:
        """Return the nodes of a list of steps and blocks in each of these scopes, which differ in their paths only."""

    def step(self, verb: str, block: Raw, here: Place, scope: Scope) -> Step | None:
        """Return the step with its expressions evaluated; None if it is wrong, with its problems recorded."""

    def call(self, block: Raw, here: Place, scope: Scope) -> tuple[Scope, Mapping[str, Any], Place]:
        """Enter a called sequence: return its scope, its phases and its place."""

    def returned(self) -> None:
        """Leave the called sequence."""

    def note_measured(self, step: Step, scope: Scope) -> None:
        """Record the name under which later expressions know the value of a step."""


class Wrong(ValueProblem):
    """A problem with a key of a block."""

    def __init__(self, key: str, problem: str) -> None:
        super().__init__(problem)
        self.key = key


@contextmanager
def wrong_at(key: str) -> Iterator[None]:
    """Report a problem with a value as one of the key."""
    try:
        yield
    except ValueProblem as problem:
        raise Wrong(key, str(problem)) from None


def nodes_of(run: Expansion, block: Raw, here: Place, scope: Scope, seen: Seen) -> Iterator[Node]:
    """Nodes of a step or a block; raises Wrong. `seen` counts the labels of its preceding siblings."""
    verb = next(iter(block))
    make = _step if verb in STEPS else _BLOCKS[verb]
    return make(run, block, here, scope, seen)


def _step(run: Expansion, block: Raw, here: Place, scope: Scope, seen: Seen) -> Iterator[Node]:
    verb = next(iter(block))
    step = run.step(verb, block, here, scope)
    if step is None:
        return
    name = getattr(step, "name", None) if isinstance(step, (Measure, Prompt)) else None
    name = step.value_name if isinstance(step, Custom) else name
    if name is not None and name in scope.names:
        raise Wrong("as", f"the name '{name}' is taken; choose another")
    label = _visit(verb, seen)
    waiting = None
    if any(scope.waits(raw) for key, raw in block.items() if key != "during"):
        waiting = Waiting({key: UNROLLED if key == "during" else raw for key, raw in block.items()}, scope.names)
    planned = PlannedStep(f"{scope.path}/{label}", scope.phase, step, dict(scope.loops), here, waiting)
    run.note_measured(step, scope)
    if "during" in block:
        body = run.nodes(block["during"], (*here, "during"), scope._replace(path=f"{scope.path}/{label}"))
        yield Meanwhile(planned, body)
    else:
        yield planned


def _for_each(run: Expansion, block: Raw, here: Place, scope: Scope, seen: Seen) -> Iterator[Node]:
    variable = block["for_each"]
    product = isinstance(variable, Mapping)
    lists = variable if product else {variable: block.get("in")}
    loops = [(name, _values(name, raw, "for_each" if product else "in", scope)) for name, raw in lists.items()]
    yield from _loop(run, loops, block, here, scope, seen)


def _loop(
    run: Expansion, loops: Sequence[tuple[str, tuple[Value, ...]]], block: Raw, here: Place, scope: Scope, seen: Seen
) -> Iterator[Node]:
    """Steps of a loop for each value of its first variable, nested for the other variables."""
    (variable, values), *others = loops
    for value in values:
        label = f"{variable}={spelled(value)}"
        inside = scope.inside(_visit(label, seen), **{variable: value})
        if others:
            yield from _loop(run, others, block, here, inside, Counter())
        else:
            yield from run.nodes(block["steps"], (*here, "steps"), inside)


def _values(variable: str, raw: Any, key: str, scope: Scope) -> tuple[Value, ...]:
    if variable in scope.names or variable in scope.measured:
        raise Wrong("for_each", f"the name '{variable}' is taken; choose another for this loop")
    if scope.waits(raw):
        raise Wrong(key, "depends on a measurement; the values of a loop must be known before the run")
    with wrong_at(key):
        values = scope.value(raw)
    if not isinstance(values, tuple) or not values:
        found = "empty" if values == () else in_words(() if values is None else values)
        raise Wrong(key, f"is {found}, expected a list or a range with at least one value")
    return values


def _repeat(run: Expansion, block: Raw, here: Place, scope: Scope, seen: Seen) -> Iterator[Node]:
    count = _count(block["repeat"], "repeat", scope)
    inside = (scope.inside(_visit(f"pass={number}", seen)) for number in range(1, count + 1))
    yield from run.passes(block["steps"], (*here, "steps"), inside)


def _count(raw: Any, key: str, scope: Scope) -> int:
    """Parse a whole number of at least 1."""
    if scope.waits(raw):
        raise Wrong(key, "depends on a measurement; use while, which has a condition")
    with wrong_at(key):
        value = scope.value(raw)
    count = value.base_value if isinstance(value, Quantity) and value.dimension == NO_DIMENSION else 0.0
    if count < 1 or count != int(count):
        raise Wrong(key, f"is {in_words(() if value is None else value)}, expected a whole number of at least 1")
    return int(count)


def _group(run: Expansion, block: Raw, here: Place, scope: Scope, seen: Seen) -> Iterator[Node]:
    inner = scope.inside(_visit(block["group"], seen))
    yield from _section(run, block, here, inner, here)


def _call(run: Expansion, block: Raw, here: Place, scope: Scope, seen: Seen) -> Iterator[Node]:
    inner, phases, place = run.call(block, here, scope)
    inner = inner._replace(path=f"{scope.path}/{_visit(inner.path.rpartition('/')[2], seen)}")
    yield from _section(run, phases, place, inner, here)
    run.returned()


def _section(run: Expansion, phases: Raw, place: Place, scope: Scope, here: Place) -> Iterator[Node]:
    """Phases of a group or a called sequence, in a section of its own if needed."""
    setup, steps, teardown = (
        run.nodes(phases.get(phase) or (), (*place, phase), _phase_of(scope, phase), _BESIDE[phase]) for phase in PHASES
    )
    on_failure, restart_at = (phases.get(key) if place == here else None for key in ("on_failure", "restart_at"))
    if teardown or on_failure or restart_at:
        yield Section(scope.path, (*setup, *steps), teardown, on_failure, here, restart_at)
    else:
        yield from (*setup, *steps)


# The ids of setup and teardown are at the level of those of the steps.
_BESIDE: Mapping[Phase, tuple[str, ...]] = {"setup": (), "steps": ("setup", "teardown"), "teardown": ()}


def _phase_of(scope: Scope, phase: Phase) -> Scope:
    if phase == "steps":
        return scope
    inner = scope._replace(path=f"{scope.path}/{phase}")
    return inner._replace(phase="teardown") if phase == "teardown" else inner


def _if(run: Expansion, block: Raw, here: Place, scope: Scope, seen: Seen) -> Iterator[Node]:
    with wrong_at("if"):
        condition = scope.condition(block["if"])
    paths = {key: f"{scope.path}/{_visit(key, seen)}" for key in ("if", "then", "else")}

    def branch(key: str) -> Nodes:
        return run.nodes(block.get(key) or (), (*here, key), scope._replace(path=paths[key]))

    if isinstance(condition, bool):
        yield from branch("then" if condition else "else")
    else:
        yield Alternatives(paths["if"], condition, branch("then"), branch("else"), here)


def _while(run: Expansion, block: Raw, here: Place, scope: Scope, seen: Seen) -> Iterator[Node]:
    at_most = _count(block["at_most"], "at_most", scope)
    path = f"{scope.path}/{_visit('while', seen)}"
    with wrong_at("while"):
        condition = scope.condition(block["while"])
    if isinstance(condition, bool):
        raise Wrong("while", "does not depend on a measurement, so it never changes; use repeat, or if")
    inside = scope._replace(path=f"{path}/pass=1")
    yield Passes(path, condition, at_most, run.nodes(block["steps"], (*here, "steps"), inside), here)


def _parallel(run: Expansion, block: Raw, here: Place, scope: Scope, seen: Seen) -> Iterator[Node]:
    path = f"{scope.path}/{_visit('parallel', seen)}"
    branches = {
        name: run.nodes(raw, (*here, "parallel", name), scope._replace(path=f"{path}/{name}"))
        for name, raw in block["parallel"].items()
    }
    yield Branches(path, branches, here)


def _retry(run: Expansion, block: Raw, here: Place, scope: Scope, seen: Seen) -> Iterator[Node]:
    path = f"{scope.path}/{_visit('retry', seen)}"
    model = _retry_model(block, scope)
    body = run.nodes(block["steps"], (*here, "steps"), scope._replace(path=path))
    yield Attempts(path, model.attempts, model.delay_s, model.on, body, here)


def _retry_model(block: Raw, scope: Scope) -> Retry:
    if scope.waits(block.get("delay")):
        raise Wrong("delay", "depends on a measurement; it must be known before the run")
    with wrong_at("delay"):
        delay = {"delay": scope.value(block["delay"])} if "delay" in block else {}
    try:
        return Retry.model_validate({**block, **delay, "steps": UNROLLED})
    except ValidationError as error:
        raise Wrong("delay", error_text(error.errors(include_url=False)[0])) from None


_BLOCKS: Mapping[str, Callable[[Expansion, Raw, Place, Scope, Seen], Iterator[Node]]] = {
    "for_each": _for_each, "repeat": _repeat, "group": _group, "call": _call, "if": _if, "while": _while,
    "parallel": _parallel, "retry": _retry,
}  # fmt: skip


def _visit(label: str, seen: Seen) -> str:
    """Label of one more visit, with its number from the second on."""
    seen[label] += 1
    return label if seen[label] == 1 else f"{label}#{seen[label]}"
