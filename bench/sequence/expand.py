"""Unrolls loops and evaluates expressions: a sequence becomes a plan."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from bench.config.document import Document, Place
from bench.config.load import problems
from bench.errors import InputError
from bench.sequence.model import SequenceFile
from bench.sequence.plan import Phase, Plan, PlannedStep
from bench.sequence.steps import STEPS, Step
from bench.sequence.values import Value, ValueProblem, is_expression, spelled, value_of

STEP_LIMIT = 100_000
PHASES: tuple[Phase, ...] = ("setup", "steps", "teardown")


def expand(
    document: Document, sequence: SequenceFile, parameters: Mapping[str, Value], preset: str | None = None
) -> Plan:
    """The plan of a loaded sequence with these parameters; InputError lists every problem with its place."""
    expansion = _Expansion(document)
    phases = {
        phase: tuple(expansion.group(phase, document.value.get(phase) or [], (phase,), dict(parameters), {}, phase))
        for phase in PHASES
    }
    if expansion.problems:
        raise InputError(*dict.fromkeys(expansion.problems))
    return Plan(
        document, sequence, parameters, preset, setup=phases["setup"], steps=phases["steps"],
        teardown=phases["teardown"],
    )  # fmt: skip


class _Expansion:
    """One pass over a document, collecting problems on the way."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._count = 0
        self.problems: list[str] = []

    def group(
        self, phase: Phase, raw: Sequence[Mapping[str, Any]], place: Place, names: dict[str, Value],
        loops: dict[str, Value], path: str,
    ) -> Iterator[PlannedStep]:  # fmt: skip
        """The planned steps of a list of steps and loops."""
        seen: Counter[str] = Counter()
        for index, block in enumerate(raw):
            here: Place = (*place, index)
            verb = next(iter(block))
            if verb == "for_each":
                yield from self._loop(phase, block, here, names, loops, path, seen)
                continue
            seen[verb] += 1
            self._count += 1
            if self._count > STEP_LIMIT:
                raise InputError(f"{self._document.where(here)}: the plan has more than {STEP_LIMIT} steps")
            step = self._step(verb, block, here, names)
            if step is not None:
                yield PlannedStep(f"{path}/{_visit(verb, seen)}", phase, step, dict(loops), here)

    def _loop(
        self, phase: Phase, block: Mapping[str, Any], here: Place, names: dict[str, Value], loops: dict[str, Value],
        path: str, seen: Counter[str],
    ) -> Iterator[PlannedStep]:  # fmt: skip
        variable = str(block["for_each"])
        if variable in names:
            self._problem((*here, "for_each"), f"the name '{variable}' is taken; choose another for this loop")
            return
        try:
            values = value_of(block["in"], names)
        except ValueProblem as problem:
            self._problem((*here, "in"), str(problem))
            return
        if not isinstance(values, tuple) or not values:
            self._problem((*here, "in"), "expected a list or a range with at least one value")
            return
        for value in values:
            label = f"{variable}={spelled(value)}"
            seen[label] += 1
            yield from self.group(
                phase, block["steps"], (*here, "steps"), {**names, variable: value}, {**loops, variable: value},
                f"{path}/{_visit(label, seen)}",
            )  # fmt: skip

    def _step(self, verb: str, block: Mapping[str, Any], here: Place, names: dict[str, Value]) -> Step | None:
        """The step with its expressions evaluated; None, and a problem noted, when it does not validate."""
        try:
            ready = {key: self._evaluated(raw, (*here, key), names) for key, raw in block.items()}
            return STEPS[verb].model_validate(ready)
        except ValueProblem:
            return None
        except ValidationError as error:
            self.problems.extend(problems(self._document, error.errors(include_url=False), here))
            return None

    def _evaluated(self, raw: Any, place: Place, names: dict[str, Value]) -> Any:
        if isinstance(raw, Mapping):
            return {key: self._evaluated(value, (*place, key), names) for key, value in raw.items()}
        if not is_expression(raw):
            return raw
        try:
            return value_of(raw, names)
        except ValueProblem as problem:
            self._problem(place, str(problem))
            raise

    def _problem(self, place: Place, problem: str) -> None:
        self.problems.append(f"{self._document.where(place)}: {problem}")


def _visit(label: str, seen: Counter[str]) -> str:
    return label if seen[label] == 1 else f"{label}#{seen[label]}"
