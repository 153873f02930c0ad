"""What all steps have in common, and the kinds of values that only steps have."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from drivers.quantity.quantities import Quantity
from drivers.schema.fields import PositiveSeconds, StrictModel
from drivers.schema.wording import telling

OnFailure = Literal["stop", "continue", "ask"]
Resumed = Literal["restored", "in full", "again", "anew", "asked", "never"]
"""What a resumed run does with a step that an interruption cut short.

A step that is *restored* sets something for longer than it lasts: it is also done again where it had ended, before the
first other step. *In full* is a waiting, of which nothing counts as passed but the credit of a soak. An acquisition
begins *anew*: what was acquired of it before is kept in the record, and superseded. *Never* refuses the resumption.
"""
RestartAt = Literal["begin", "never"]
Text = Annotated[str, Field(min_length=1, max_length=500)]


class StepBase(StrictModel):
    """Keys of every step: its timeout, and what happens if it fails."""

    resumed: ClassVar[Resumed] = "again"

    timeout_s: PositiveSeconds | None = Field(None, alias="timeout", description="the longest it may take")
    on_failure: OnFailure | None = Field(
        None, description="what the run does when it fails: it stops, but goes on after a value outside its limits"
    )

    @property
    def least_s(self) -> float:
        """Minimum duration of the step, from its own keys."""
        return 0.0

    @model_validator(mode="after")
    def _can_end_in_time(self) -> Self:
        if self.timeout_s is not None and self.timeout_s <= self.least_s:
            raise telling(f"its timeout of {self.timeout_s:g} s is over before the {self.least_s:g} s that it takes")
        return self


def is_known(value: Quantity | None) -> bool:
    """Whether a value is there, and no expression that waits for a measurement."""
    return value is not None and not math.isnan(value.base_value)


def one_of(*keys: tuple[str, ...]) -> ConfigDict:
    """For editors: of several sets of keys a step has exactly one."""
    return ConfigDict(json_schema_extra={"oneOf": [{"required": list(names)} for names in keys]})


def choice_of(keys: dict[str, Any], what: str) -> str:
    """The one of several keys that a step has; raises if it has none, or two."""
    given = [key for key, value in keys.items() if value is not None]
    if len(given) != 1:
        found = f"has {' and '.join(given)}" if given else "has none of them"
        names = [*keys]
        raise telling(f"{what} needs one of {', '.join(names[:-1])} and {names[-1]}, it {found}")
    return given[0]
