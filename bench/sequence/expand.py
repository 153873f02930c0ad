"""Unrolls loops and evaluates expressions: a sequence becomes a plan."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from bench.config.document import Document, Place, Problem
from bench.config.load import problems
from bench.sequence.expressions import Value, ValueProblem
from bench.sequence.model import Outline
from bench.sequence.plan import Phase, Plan, PlannedStep
from bench.sequence.steps import STEPS, Step
from bench.sequence.values import holds_expression, in_words, spelled, value_of
from drivers.quantities import Quantity
from drivers.units import NO_DIMENSION

STEP_LIMIT = 100_000
PHASES: tuple[Phase, ...] = ("setup", "steps", "teardown")


def expand(
    document: Document,
    outline: Outline,
    parameters: Mapping[str, Value],
    preset: str | None = None,
    broken: Collection[Place] = (),
) -> tuple[Plan, list[Problem]]:
    """The plan of a sequence with these parameters, without what is wrong, and what is wrong.

    `broken` are the places of steps and loops that are not to be looked at.
    """
    expansion = _Expansion(document, broken)
    setup, steps, teardown = (
        tuple(expansion.group(phase, document.value.get(phase) or (), (phase,), dict(parameters), {}, phase))
        for phase in PHASES
    )
    plan = Plan(document, outline, parameters, preset, setup=setup, steps=steps, teardown=teardown)
    return plan, expansion.problems


class _Expansion:
    """One pass over a document, collecting problems on the way; what was wrong once is not looked at again."""

    def __init__(self, document: Document, broken: Collection[Place]) -> None:
        self._document = document
        self._broken = set(broken)
        self._made: dict[tuple[Place, tuple[Value, ...]], Step] = {}  # by the values of the names that a step mentions
        self._count = 0
        self.problems: list[Problem] = []

    def group(
        self, phase: Phase, raw: Sequence[Mapping[str, Any]], place: Place, names: dict[str, Value],
        loops: dict[str, Value], path: str,
    ) -> Iterator[PlannedStep]:  # fmt: skip
        """The planned steps of a list of steps and loops."""
        seen: Counter[str] = Counter()
        for index, block in enumerate(raw):
            here: Place = (*place, index)
            if here in self._broken or self._count > STEP_LIMIT:
                continue
            verb = next(iter(block))
            if verb not in STEPS:
                yield from self._passes(phase, block, here, names, loops, path, seen)
            elif (step := self._step(verb, block, here, names)) is not None:
                seen[verb] += 1
                yield PlannedStep(f"{path}/{_visit(verb, seen)}", phase, step, dict(loops), here)

    def _passes(
        self, phase: Phase, block: Mapping[str, Any], here: Place, names: dict[str, Value], loops: dict[str, Value],
        path: str, seen: Counter[str],
    ) -> Iterator[PlannedStep]:  # fmt: skip
        for label, own in self._labels(block, here, names):
            seen[label] += 1
            inside = tuple(
                self.group(
                    phase, block["steps"], (*here, "steps"), {**names, **own}, {**loops, **own},
                    f"{path}/{_visit(label, seen)}",
                )
            )  # fmt: skip
            if not inside:
                return  # all of it is wrong, and has been told
            yield from inside

    def _labels(
        self, block: Mapping[str, Any], here: Place, names: Mapping[str, Value]
    ) -> Iterator[tuple[str, dict[str, Value]]]:
        """Each pass of a block: what it is called in ids, and the names it adds."""
        match block:
            case {"for_each": variable, "in": raw}:
                for value in self._values(variable, raw, here, names):
                    yield f"{variable}={spelled(value)}", {variable: value}
            case {"repeat": raw}:
                for number in range(1, self._count_of(raw, here, names) + 1):
                    yield f"pass={number}", {}
            case {"group": name}:
                yield name, {}

    def _count_of(self, raw: Any, here: Place, names: Mapping[str, Value]) -> int:
        """How often a block is repeated; 0, and a problem noted, when that is wrong."""
        try:
            value = value_of(raw, names)
        except ValueProblem as problem:
            self._wrong(here, "repeat", str(problem))
            return 0
        count = value.base_value if isinstance(value, Quantity) and value.dimension == NO_DIMENSION else 0.0
        if count < 1 or count != int(count):
            self._wrong(here, "repeat", f"is {in_words(value)}, expected a whole number of at least 1")
            return 0
        return int(count)

    def _values(self, variable: str, raw: Any, here: Place, names: Mapping[str, Value]) -> tuple[Value, ...]:
        """What a loop runs over; nothing, and a problem noted, when that is wrong."""
        if variable in names:
            return self._wrong(here, "for_each", f"the name '{variable}' is taken; choose another for this loop")
        try:
            values = value_of(raw, names)
        except ValueProblem as problem:
            return self._wrong(here, "in", str(problem))
        if not isinstance(values, tuple) or not values:
            found = "empty" if values == () else in_words(values)
            return self._wrong(here, "in", f"is {found}, expected a list or a range with at least one value")
        return values

    def _wrong(self, here: Place, key: str, problem: str) -> tuple[Value, ...]:
        self._broken.add(here)
        self.problems.append(((*here, key), f"{key}: {problem}"))
        return ()

    def _step(self, verb: str, block: Mapping[str, Any], here: Place, names: Mapping[str, Value]) -> Step | None:
        """The step with its expressions evaluated; None, and its problems noted, when it does not validate."""
        self._count += 1
        if self._count > STEP_LIMIT:
            self.problems.append((here, f"the plan has more than {STEP_LIMIT} steps"))
            return None
        text = str(block)
        key = (here, tuple(value for name, value in names.items() if name in text))
        if key not in self._made and (step := self._made_anew(verb, block, here, names)):
            self._made[key] = step
        return self._made.get(key)

    def _made_anew(self, verb: str, block: Mapping[str, Any], here: Place, names: Mapping[str, Value]) -> Step | None:
        found: list[Problem] = []
        ready = {key: _evaluated(raw, (*here, key), names, found) for key, raw in block.items()}
        if not found:
            try:
                return STEPS[verb].model_validate(ready)
            except ValidationError as error:
                found.extend(problems(self._document.value, error, here))
        self._broken.add(here)
        self.problems += found
        return None


def _evaluated(raw: Any, place: Place, names: Mapping[str, Value], found: list[Problem]) -> Any:
    """A value of a step with its expressions evaluated; what is wrong with them goes to `found`."""
    if isinstance(raw, Mapping):
        return {key: _evaluated(value, (*place, key), names, found) for key, value in raw.items()}
    if not holds_expression(raw):
        return raw
    try:
        return value_of(raw, names)
    except ValueProblem as problem:
        found.append((place, f"{place[-1]}: {problem}"))
        return None


def _visit(label: str, seen: Counter[str]) -> str:
    return label if seen[label] == 1 else f"{label}#{seen[label]}"
