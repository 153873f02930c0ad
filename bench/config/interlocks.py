"""Interlocks in bench files and sequences: a condition on live readings, and its effect on a run.

The first key names the monitored quantity: a reading, its rate of change, the difference of two, or the age of the
newest value.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    WithJsonSchema,
    WrapValidator,
    model_validator,
)

from drivers.quantity.quantities import Quantity
from drivers.quantity.units import quoted
from drivers.schema.fields import AnyQuantity, PositiveSeconds, Seconds, StrictModel, TextLike
from drivers.schema.suggest import did_you_mean
from drivers.schema.wording import expected, telling

# Hold: the chamber's set point stays where it is, and no further step begins. Pause: no further step begins. Stop: the
# current step ends, the teardown runs. Abort: everything is made safe at once.
Action = Literal["hold", "pause", "stop", "abort"]
PASSING: tuple[Action, ...] = ("hold", "pause")  # the run can resume by itself

ReadingName = Annotated[
    str,
    TextLike(r"[a-z][a-z0-9_]{0,31}(\.\w+)*", "a named reading, or DEVICE.CHANNEL such as chamber.process_value"),
]


def _above_zero(limit: Quantity) -> Quantity:
    if limit.base_value <= 0:
        raise telling(f"is {limit}, expected more than 0: it is compared with the size, whatever the direction")
    return limit


def _pair(raw: object) -> object:
    if not isinstance(raw, (list, tuple)) or len(raw) != 2:
        raise telling("needs two readings, like [chamber.process_value, chamber.set_point]")
    return raw


Limit = Annotated[
    AnyQuantity,
    WithJsonSchema(
        {"type": ["number", "string"], "minLength": 1, "description": "a quantity in the unit of the monitored value"}
    ),
]
Size = Annotated[Limit, AfterValidator(_above_zero)]


class InterlockBase(StrictModel):
    """Interlock: duration of its condition before it trips, and its action.

    After a hold or a pause the run resumes by itself when the condition has been good for `good_for`.
    """

    for_s: Seconds = Field(0.0, alias="for", description="how long the condition must hold before it trips")
    then: Action = Field(description="the action when it trips")
    good_for_s: Seconds = Field(
        0.0,
        alias="good_for",
        description="how long the reading must be in range before the run resumes after a hold or a pause",
    )

    give_up_after_s: PositiveSeconds = Field(
        14_400.0, alias="give_up_after", description="time after which a hold or a pause without recovery stops the run"
    )

    @model_validator(mode="after")
    def _resumes_only_after_a_pause(self) -> Self:
        for key, field in (("good_for", "good_for_s"), ("give_up_after", "give_up_after_s")):
            if self.then not in PASSING and field in self.model_fields_set:
                raise telling(f"'{key}' goes with hold and pause: after '{self.then}' the run does not go on")
        return self


class ReadingInterlock(InterlockBase):
    """Interlock that trips while a reading is above one value or below another."""

    reading: ReadingName = Field(description="the monitored reading")
    above: Limit | None = Field(None, description="a larger value is bad")
    below: Limit | None = Field(None, description="a smaller value is bad")

    @model_validator(mode="after")
    def _can_be_good(self) -> Self:
        if self.above is None and self.below is None:
            raise telling("needs above, or below, or both")
        if self.above is not None and self.below is not None:
            if self.above.dimension != self.below.dimension:
                raise telling(f"above is {self.above}, below is {self.below}: they need the same unit")
            if self.above <= self.below:
                raise telling(f"every value is above {self.above} or below {self.below}: no value would be good")
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Monitored readings."""
        return (self.reading,)


class RateInterlock(InterlockBase):
    """Interlock that trips while the mean rate of a reading over the last `over` exceeds a limit, either way."""

    reading: ReadingName = Field(alias="rate_of", description="the reading whose rate of change is monitored")
    over_s: PositiveSeconds = Field(alias="over", description="the time whose mean rate is taken")
    above: Size = Field(description="rising or falling faster is bad")

    @property
    def names(self) -> tuple[str, ...]:
        """Monitored readings."""
        return (self.reading,)


class DifferenceInterlock(InterlockBase):
    """Interlock that trips while the difference of two readings exceeds a limit."""

    names: Annotated[tuple[ReadingName, ReadingName], BeforeValidator(_pair)] = Field(
        alias="difference", description="the two that are compared"
    )
    above: Size = Field(description="a larger difference is bad, whichever of them is the higher")
    rest_s: Seconds = Field(
        0.0,
        alias="once_at_rest_for",
        description="judged only after the second of them, such as the air that a unit follows, has stayed within "
        "half of the limit for this time",
    )


class AgeInterlock(InterlockBase):
    """Interlock that trips while the newest value of a reading is older than a limit."""

    reading: ReadingName = Field(alias="age_of", description="the reading whose age is monitored")
    above_s: PositiveSeconds = Field(alias="above", description="an older value is bad")

    @property
    def names(self) -> tuple[str, ...]:
        """Monitored readings."""
        return (self.reading,)


AnyInterlock = ReadingInterlock | RateInterlock | DifferenceInterlock | AgeInterlock
INTERLOCKS: dict[str, type[AnyInterlock]] = {
    "reading": ReadingInterlock, "rate_of": RateInterlock, "difference": DifferenceInterlock, "age_of": AgeInterlock,
}  # fmt: skip


def _by_first_key(raw: Any, _handler: Any) -> AnyInterlock:
    """Validate into the model of the first key, without the context of a document, since it holds no expressions."""
    if not isinstance(raw, Mapping) or not raw:
        raise expected("an interlock: a mapping whose first key names the monitored quantity", raw)
    first = str(next(iter(raw)))
    if first in INTERLOCKS:
        return INTERLOCKS[first].model_validate(raw)
    if later := [key for key in raw if key in INTERLOCKS]:
        raise telling(
            f"the first key of an interlock names the monitored quantity: put '{later[0]}' before {quoted(first)}"
        )
    raise telling(f"the first key names the monitored quantity, not {quoted(first)}{did_you_mean(first, INTERLOCKS)}")


InterlockEntry = Annotated[AnyInterlock, WrapValidator(_by_first_key)]


def rate_unit(unit: str) -> str:
    """Return the unit of the rate of change of a reading in `unit`."""
    return "°C/min" if unit == "°C" else f"{unit or 1}/s"
