"""Keys common to all steps, and kinds of values that only steps have."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from drivers.quantity.quantities import Quantity
from drivers.schema.fields import PositiveSeconds, StrictModel
from drivers.schema.wording import telling

OnFailure = Literal["stop", "continue", "ask"]
Resumed = Literal["restored", "in full", "again", "anew", "asked", "never"]
"""Treatment, by a resumed run, of a step that an interruption cut short.

A *restored* step sets something beyond its own duration: it is repeated even if it had ended, before the first other
step. A wait is repeated *in full*; only the credit of a soak counts as passed. An acquisition begins *anew*: its
earlier data are kept in the record but superseded. *Never*: the run cannot be resumed.
"""
RestartAt = Literal["begin", "never"]
Text = Annotated[str, Field(min_length=1, max_length=500)]


class StepBase(StrictModel):
    """Keys of every step: its timeout, and the reaction if it fails."""

    resumed: ClassVar[Resumed] = "again"

    timeout_s: PositiveSeconds | None = Field(None, alias="timeout", description="maximum duration")
    on_failure: OnFailure | None = Field(
        None,
        description="reaction of the run if it fails; default: stop, but continue after a value outside its limits",
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
    """True if a value is present and does not wait for a measurement."""
    return value is not None and not math.isnan(value.base_value)


def one_of(*keys: tuple[str, ...]) -> ConfigDict:
    """Alternative sets of keys, for the schema: a step has exactly one set."""
    return ConfigDict(json_schema_extra={"oneOf": [{"required": list(names)} for names in keys]})


def choice_of(keys: dict[str, Any], what: str) -> str:
    """Return the one of several keys that a step has; raises if it has none, or two."""
    given = [key for key, value in keys.items() if value is not None]
    if len(given) != 1:
        found = f"has {' and '.join(given)}" if given else "has none of them"
        names = [*keys]
        raise telling(f"{what} needs one of {', '.join(names[:-1])} and {names[-1]}, it {found}")
    return given[0]
