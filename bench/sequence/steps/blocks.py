"""Steps that contain steps: loops, alternatives, branches, attempts, other sequences."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import AfterValidator, ConfigDict, Field, WithJsonSchema, model_validator

from bench.errors import CODES
from bench.sequence.language.values import VALUE_SCHEMA
from bench.sequence.steps.fields import OnFailure, RestartAt
from bench.sequence.steps.nested import AnyBlock, Steps
from drivers.errors import CODES as DEVICE_CODES
from drivers.quantity.units import quoted
from drivers.schema.fields import NAME, NOT_EMPTY, Name, Seconds, StrictModel, TextLike, WholeNumber
from drivers.schema.suggest import did_you_mean
from drivers.schema.wording import expected, telling

RETRIED = (*DEVICE_CODES, *CODES)


def _variables(raw: object) -> object:
    """Parse the name of a loop variable, or a mapping of names to their values."""
    if isinstance(raw, Mapping) and not raw:
        raise expected("a name, or names with their values", raw)
    for name in raw if isinstance(raw, Mapping) else [raw]:
        NAME.validate(name)
    return raw


_NAME_SCHEMA = {"type": "string", "pattern": f"^(?:{NAME.pattern})$"}
_VARIABLES_SCHEMA = {
    "anyOf": [
        _NAME_SCHEMA,
        {"type": "object", "minProperties": 1, "propertyNames": _NAME_SCHEMA, "additionalProperties": VALUE_SCHEMA},
    ]
}
_ONE_FORM: dict[str, Any] = {"if": {"properties": {"for_each": {"type": "string"}}}, "then": {"required": ["in"]}}


class ForEach(StrictModel):
    """Repeat steps for each value of a list or range; the name holds the value inside.

    With a mapping of names to lists, for each combination: the last name varies fastest.
    """

    model_config = ConfigDict(json_schema_extra=_ONE_FORM)

    variable: Annotated[Any, AfterValidator(_variables), WithJsonSchema(_VARIABLES_SCHEMA)] = Field(alias="for_each")
    values: Any = Field(None, alias="in", description="its values: a list, a range, or an expression of one")
    steps: Steps = Field(description="run for each value")

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        if isinstance(self.variable, Mapping):
            if "values" in self.model_fields_set:
                raise telling("with a mapping of names to lists there is no 'in'")
        elif "values" not in self.model_fields_set:
            raise telling("the key 'in' is missing")
        return self


class Repeat(StrictModel):
    """Repeat steps a given number of times."""

    count: Any = Field(alias="repeat")
    steps: Steps = Field(description="run each time")


class Group(StrictModel):
    """Steps under a name, which becomes part of their ids. Its teardown runs also if its setup or its steps fail."""

    name: Name = Field(alias="group")
    setup: tuple[AnyBlock, ...] = Field((), description="done first")
    steps: Steps = Field(description="done then")
    teardown: tuple[AnyBlock, ...] = Field((), description="run at the end, also after a failure")
    on_failure: OnFailure | None = Field(
        None, description="reaction of the run if one of them fails; default: it stops"
    )
    restart_at: RestartAt | None = Field(
        None, description="if the run is interrupted in it: repeat it from its beginning, or never resume"
    )


class If(StrictModel):
    """Execute steps if a condition is true, others if it is not."""

    condition: Any = Field(alias="if")
    then: Steps = Field(description="run if it is true")
    otherwise: tuple[AnyBlock, ...] = Field((), alias="else", description="run if it is false")


class While(StrictModel):
    """Repeat steps while a condition is true, up to a number of passes."""

    condition: Any = Field(alias="while")
    at_most: Any = Field(description="maximum number of passes")
    steps: Steps = Field(description="run in each pass")


class Parallel(StrictModel):
    """Run branches in parallel, each with its own devices; the step ends when all have ended."""

    branches: Annotated[Mapping[Name, Steps], NOT_EMPTY] = Field(alias="parallel")


class Call(StrictModel):
    """Run another sequence from a file beside this one, with its parameters; its results are ignored."""

    file: Annotated[str, TextLike(r"[a-z][a-z0-9_]*\.yaml", "the name of a sequence file beside this one")] = Field(
        alias="call"
    )
    with_: Mapping[Name, Any] = Field(default_factory=dict, alias="with", description="values of its parameters")


def _code(code: str) -> str:
    if code not in RETRIED:
        raise telling(f"there is no kind of error {quoted(code)}{did_you_mean(code, RETRIED)}")
    return code


class Retry(StrictModel):
    """Repeat steps if one of them fails, up to a number of attempts; by default after any error of a device."""

    attempts: Annotated[WholeNumber, Field(ge=2, le=100)] = Field(alias="retry")
    delay_s: Seconds = Field(0.0, alias="delay", description="the time between two attempts")
    on: Annotated[tuple[Annotated[str, AfterValidator(_code)], ...], NOT_EMPTY] = Field(
        DEVICE_CODES, description="the error codes after which it is repeated; default: all errors of a device"
    )
    steps: Steps = Field(description="run in each attempt")
