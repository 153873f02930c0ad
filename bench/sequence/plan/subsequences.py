"""Sequences called by another: found beside it, with the parameters of the call."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bench.config.document import Document, Place, Problem, read_document
from bench.errors import InputError
from bench.sequence.document.model import Outline
from bench.sequence.document.outline import outline_of
from bench.sequence.language.expressions import Value, ValueProblem
from bench.sequence.plan.scope import Scope
from drivers.schema.suggest import did_you_mean

DEPTH_LIMIT = 8  # levels of calls


Called = tuple[Document, Outline, list[Problem]]


def refuse_too_deep(path: Path, callers: tuple[Path, ...]) -> None:
    """Raise ValueProblem if a file calls itself, directly or not, or calls are nested too deeply."""
    if path.resolve() in callers:
        chain = " calls ".join(caller.name for caller in callers[callers.index(path.resolve()) :])
        raise ValueProblem(f"{chain} calls {path.name}: a sequence cannot call itself")
    if len(callers) > DEPTH_LIMIT:
        raise ValueProblem(f"sequences call one another more than {DEPTH_LIMIT} deep")


def read_called(path: Path) -> Called:
    """Read a called file: its outline and the problems of its steps; raises ValueProblem."""
    try:
        document = read_document(path)
        return document, *outline_of(document)
    except InputError as error:
        more = f" (and {len(error.problems) - 1} more)" if len(error.problems) > 1 else ""
        raise ValueProblem(f"{error.problems[0]}{more}") from None


def declared_at(document: Document, section: str, name: str) -> Place:
    """Place of a need or an interlock: in the document, or in a called one."""
    if name in (document.value.get(section) or ()):
        return section, name
    for place, called in document.included.items():
        if inner := declared_at(called, section, name):
            return *place, *inner
    return ()


def call_parameters(
    outline: Outline, wishes: Mapping[str, Any], scope: Scope, place: Place, found: list[Problem]
) -> dict[str, Value]:
    """Parameters of a called sequence: those of the call, otherwise its defaults; problems are added to `found`."""
    values: dict[str, Value] = {name: parameter.default for name, parameter in outline.parameters.items()}
    for name, raw in wishes.items():
        here = (*place, name)
        if name not in outline.parameters:
            found.append((here, f"there is no parameter '{name}'{did_you_mean(name, outline.parameters)}"))
            continue
        if scope.waits(raw):
            found.append(
                (
                    here,
                    f"'{name}' depends on a measurement; the parameters of a called sequence must be "
                    "known before the run",
                )
            )
            continue
        try:
            value = scope.value(raw)
        except ValueProblem as problem:
            found.append((here, f"{name}: {problem}"))
            continue
        refusal = "is not known" if value is None else outline.parameters[name].problem_with(value)
        if value is None or refusal:
            found.append((here, f"'{name}' {refusal}"))
        else:
            values[name] = value
    return values
