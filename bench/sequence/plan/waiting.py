"""Evaluation of expressions over measurements once these are known: values of steps and conditions."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from bench.errors import StepError
from bench.sequence.language.expressions import Value, ValueProblem
from bench.sequence.language.values import holds_expression, in_words, value_of
from bench.sequence.plan.plan import PlannedStep, Waiting
from bench.sequence.plan.scope import TEXTS, filled
from bench.sequence.steps.verbs import Step
from drivers.schema.wording import error_text


def completed(planned: PlannedStep, variables: Mapping[str, Value], folder: Path) -> Step:
    """The step with its expressions evaluated; StepError if the step cannot take their values."""
    if planned.waiting is None:
        return planned.step
    names = {**variables, **planned.waiting.names}
    try:
        ready = {key: _evaluated(key, raw, names) for key, raw in planned.waiting.raw.items()}
        found: Step = type(planned.step).model_validate(ready, context={"folder": folder, "files_needed": False})
    except ValueProblem as problem:
        raise StepError(_with_measurements(str(problem), variables)) from None
    except ValidationError as error:
        problems = [
            f"{'.'.join(map(str, item['loc']))}: {error_text(item)}" for item in error.errors(include_url=False)
        ]
        raise StepError(_with_measurements("; ".join(problems), variables)) from None
    return found


def is_true(condition: Waiting, variables: Mapping[str, Value]) -> bool:
    """The value of a condition; StepError if it is unknown."""
    try:
        value = value_of(condition.raw, {**variables, **condition.names})
    except ValueProblem as problem:
        raise StepError(_with_measurements(str(problem), variables)) from None
    if not isinstance(value, bool):
        raise StepError(_with_measurements(f"{condition.raw} is {in_words(value)}, neither true nor false", variables))
    return value


def _evaluated(key: str, raw: Any, names: Mapping[str, Value]) -> Any:
    if isinstance(raw, Mapping):
        return {inner: _evaluated(inner, value, names) for inner, value in raw.items()}
    if isinstance(raw, list):
        return [_evaluated(key, value, names) for value in raw]
    if not holds_expression(raw):
        return raw
    return filled(raw, names) if key in TEXTS else value_of(raw, names)


def _with_measurements(problem: str, variables: Mapping[str, Value]) -> str:
    """The problem with the measurements so far, from which it may result."""
    known = ", ".join(f"{name} = {in_words(value)}" for name, value in variables.items())
    return f"{problem}. Measured so far: {known or 'nothing'}"
