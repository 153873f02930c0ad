"""Expand a sequence to a plan: unroll loops, evaluate expressions, insert called sequences."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from bench.config.document import Document, Place, Problem
from bench.config.load import problems
from bench.sequence.document.model import PHASES, Outline
from bench.sequence.document.outline import block_around
from bench.sequence.language.expressions import Value
from bench.sequence.plan.plan import Node, Nodes, Plan, renamed
from bench.sequence.plan.result_settings import with_settings
from bench.sequence.plan.scope import Scope, names_mentioned
from bench.sequence.plan.subsequences import Called, call_parameters, read_called, refuse_too_deep
from bench.sequence.plan.unroll import Raw, Wrong, nodes_of, wrong_at
from bench.sequence.steps.custom import Custom, known_steps
from bench.sequence.steps.measuring import Measure
from bench.sequence.steps.nested import UNROLLED
from bench.sequence.steps.talk import Prompt
from bench.sequence.steps.verbs import STEPS, Step
from drivers.schema.fields import DEFERRED

STEP_LIMIT = 10_000
Measured = Callable[[str], Value | None]  # example of a reading; None if its unit is unknown


def expand(
    document: Document,
    outline: Outline,
    parameters: Mapping[str, Value],
    preset: str | None = None,
    broken: Collection[Place] = (),
    measured: Measured = lambda _: None,
) -> tuple[Plan, list[Problem]]:
    """Plan of a sequence with these parameters, without its invalid parts, and the problems.

    `broken` are the places of steps and blocks to be passed over. A sequence that is called is kept with the document,
    what it needs and its interlocks with the outline.
    """
    expansion = DocumentPass(document, outline, broken, measured)
    known: dict[str, Value | None] = {}
    setup: Nodes = ()
    steps: Nodes = ()
    teardown: Nodes = ()
    try:
        setup, steps, teardown = (
            expansion.nodes(
                document.value.get(phase) or (), (phase,), Scope(phase, phase, dict(parameters), {}, known)
            )
            for phase in PHASES
        )  # fmt: skip
    except TooManySteps as problem:
        expansion.problems.append((problem.place, str(problem)))
    outline = outline.model_copy(update={"needs": expansion.needs, "interlocks": expansion.interlocks})
    outline, wrong_settings = with_settings(outline, parameters)
    plan = Plan(document, outline, parameters, preset, setup=setup, steps=steps, teardown=teardown)
    return plan, [*expansion.problems, *wrong_settings]


class TooManySteps(Exception):
    """The plan has more steps, or its loops more passes, than permitted; `place` is where."""

    def __init__(self, place: Place, what: str) -> None:
        super().__init__(f"the plan has more than {STEP_LIMIT} {what}")
        self.place = place


class DocumentPass:
    """One pass over a document that collects problems; an invalid part is not examined again."""

    def __init__(self, document: Document, outline: Outline, broken: Collection[Place], measured: Measured) -> None:
        self._document = document
        self._broken = set(broken)
        self._measured = measured
        self._made: dict[tuple[Place, tuple[object, ...]], Step] = {}  # by the values of the names that a step mentions
        self._mentioned: dict[Place, tuple[str, ...]] = {}
        self._lists: dict[int, Value] = {}  # lists among those values, by identity; kept here so that it stays unique
        self._count = self._passes = 0
        self._callers: tuple[Path, ...] = (document.path.resolve(),)
        self._read: dict[Path, Called] = {}  # by file
        self.needs, self.interlocks = dict(outline.needs), dict(outline.interlocks)
        self.problems: list[Problem] = []

    def nodes(self, raw: Sequence[Raw], place: Place, scope: Scope, taken: Collection[str] = ()) -> Nodes:
        """Nodes of a list of steps and blocks; `taken` are labels already used in its ids."""
        seen: Counter[str] = Counter(taken)
        found: list[Node] = []
        self._passes += 1
        if self._passes > STEP_LIMIT:
            raise TooManySteps(place, "passes")
        for index, block in enumerate(raw):
            here: Place = (*place, index)
            if here in self._broken:
                continue
            try:
                found += nodes_of(self, block, here, scope, seen)
            except Wrong as wrong:
                self._broken.add(here)
                self.problems.append(((*here, wrong.key), f"{wrong.key}: {wrong}"))
        return tuple(found)

    def passes(self, raw: Sequence[Raw], place: Place, scopes: Iterator[Scope]) -> Iterator[Node]:
        """Nodes in each of these scopes, which differ in their paths only.

        They are those of the first with other ids, unless that had problems or measured what the others then know.
        """
        first = next(scopes)
        steps, passes, wrong, measured = self._count, self._passes, len(self.problems), dict(first.measured)
        nodes = self.nodes(raw, place, first)
        yield from nodes
        steps, passes = self._count - steps, self._passes - passes
        are_alike = len(self.problems) == wrong and first.measured == measured
        for scope in scopes:
            if are_alike and max(self._count + steps, self._passes + passes) <= STEP_LIMIT:
                self._count, self._passes = self._count + steps, self._passes + passes
                yield from renamed(nodes, f"{first.path}/", f"{scope.path}/")
            else:
                yield from self.nodes(raw, place, scope)

    def step(self, verb: str, block: Raw, here: Place, scope: Scope) -> Step | None:
        """The step with its expressions evaluated; None, with its problems recorded, if it is invalid."""
        self._count += 1
        if self._count > STEP_LIMIT:
            raise TooManySteps(here, "steps")
        if here not in self._mentioned:
            self._mentioned[here] = tuple(names_mentioned(block))
        key = (here, tuple(self._key_part(scope.names.get(name)) for name in self._mentioned[here]))
        if key not in self._made and (step := self._made_anew(verb, block, here, scope)):
            self._made[key] = step
        return self._made.get(key)

    def _key_part(self, value: Value | None) -> object:
        """A value as part of a key: a list may be long, and is identified by its id."""
        if not isinstance(value, tuple):
            return value
        self._lists[id(value)] = value
        return id(value)

    def _made_anew(self, verb: str, block: Raw, here: Place, scope: Scope) -> Step | None:
        found: list[Problem] = []
        model = STEPS[verb]
        ready = {
            key: UNROLLED if key == "during" else scope.evaluated(raw, (*here, key), found)
            for key, raw in block.items()
        }
        if not found:
            looked_at = str(ready[verb]) if verb in ("measure", "wait_until") else ""
            found = scope.misfits(model, ready, here, self._measured(looked_at) if looked_at else None)
        if not found:
            owner, inner = self._document.owner(here)
            waits = DEFERRED if any(scope.waits(raw) for raw in ready.values()) else {}
            try:
                return model.model_validate(ready, context={**waits, "folder": owner.path.parent})
            except ValidationError as error:
                outer = here[: len(here) - len(inner)]
                found += [((*outer, *place), problem) for place, problem in problems(owner.value, error, inner)]
        self._broken.add(here)
        self.problems += found
        return None

    def call(self, block: Raw, here: Place, scope: Scope) -> tuple[Scope, Mapping[str, Any], Place]:
        """Enter a called sequence; return its scope, its phases and its place."""
        path = self._document.owner(here)[0].path.parent / block["call"]
        with wrong_at("call"):
            refuse_too_deep(path, self._callers)
            if path not in self._read:
                self._read[path] = read_called(path)
        document, outline, found = self._read[path]
        place = (*here, "call")
        if self._document.owner((*place, "title"))[0] is not document:  # first pass through this call
            self._document.include(place, document)
            self._broken |= {(*place, *inner) for at, _ in found if (inner := block_around(at)) is not None}
            self.problems += [((*place, *at), problem) for at, problem in found]
        names = call_parameters(outline, block.get("with", {}), scope, (*here, "with"), self.problems)
        self._take_over(outline)
        self._callers = (*self._callers, document.path.resolve())
        return scope.inside(document.path.stem)._replace(names=names), document.value, place

    def _take_over(self, called: Outline) -> None:
        """Take over the parts of a called sequence that apply to the whole run."""
        for role, kind in called.needs.items():
            if self.needs.setdefault(role, kind) != kind:
                raise Wrong("call", f"it needs '{role}' as a {kind}, another called sequence as a {self.needs[role]}")
        for name, interlock in called.interlocks.items():
            if self.interlocks.setdefault(name, interlock) != interlock:
                raise Wrong("call", f"its interlock '{name}' differs from that of the calling sequence")

    def returned(self) -> None:
        """Leave a called sequence."""
        self._callers = self._callers[:-1]

    def note_measured(self, step: Step, scope: Scope) -> None:
        """Record the name under which later expressions use the value of a step."""
        if isinstance(step, Measure) and step.name is not None:
            scope.measured[step.name] = self._measured(step.reading)
        elif isinstance(step, Prompt) and step.name is not None:
            scope.measured[step.name] = step.example
        elif isinstance(step, Custom) and step.value_name is not None and step.name in known_steps():
            scope.measured[step.value_name] = known_steps()[step.name].example
