"""Steps that measure: counts under a label for a reduction, single readings with limits for a decision."""

from __future__ import annotations

from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from bench.config.interlocks import ReadingName
from bench.sequence.inside import Steps
from bench.sequence.limits import LimitEntry
from bench.sequence.step_fields import StepBase, choice_of, one_of
from drivers.fields import AnyQuantity, Flag, InUnit, Name, PositiveSeconds
from drivers.wording import telling


class Acquire(StepBase):
    """Counts pulses under a label that a result can name: for a time, over whole turns, or during other steps.

    `turns` are turns of the table `of`, which rotates meanwhile. `resolution` is what the counting alone must resolve,
    in g or relative to 1 g: the checker says when the time is too short for it.
    """

    model_config = one_of(("for",), ("turns", "of"), ("during",))

    role: Name = Field(alias="acquire")
    duration_s: PositiveSeconds | None = Field(None, alias="for", description="how long")
    turns: Annotated[float, InUnit("", above=0)] | None = Field(None, description="how many turns of the table")
    of: Name | None = Field(None, description="the table whose turns are counted")
    during: Steps | None = Field(None, description="these steps are done meanwhile")
    label: Name = Field(description="under which a result finds the counts")
    resolution: AnyQuantity | None = Field(None, description="what the counting alone must resolve")

    @property
    def least_s(self) -> float:
        """The counting time."""
        return self.duration_s or 0.0

    @model_validator(mode="before")
    @classmethod
    def _one_end(cls, raw: Any) -> Any:
        if isinstance(raw, dict):
            end = choice_of({key: raw.get(key) for key in ("for", "turns", "during")}, "an acquisition")
            if (end == "turns") != (raw.get("of") is not None):
                raise telling("turns and of go together: the table whose turns are counted")
        return raw


class Measure(StepBase):
    """Takes one value: the newest of a reading, or its mean over a time; within limits it passes, else it fails.

    A reading is a named one, DEVICE.CHANNEL, or the pulse rate of a counter's channel, which needs a time. `as` is the
    name that expressions in later steps know it by. With `net`, what the last `tare` found is taken off. What was read
    before the step is not taken.
    """

    reading: ReadingName = Field(alias="measure")
    duration_s: PositiveSeconds | None = Field(
        None, alias="for", description="the time of the mean; the newest value without it"
    )
    name: Name | None = Field(None, alias="as", description="the name of the value in later expressions")
    net: Flag = Field(False, description="take off what the last tare found")
    limits: LimitEntry | None = None

    @property
    def least_s(self) -> float:
        """The time of the mean."""
        return self.duration_s or 0.0

    @model_validator(mode="after")
    def _for_something(self) -> Self:
        if self.name is None and self.limits is None:
            raise telling("needs 'as' or 'limits': say what the value is for")
        return self


class Tare(StepBase):
    """Takes the mean of a reading over a time as the zero that later measures with `net: true` start from."""

    reading: ReadingName = Field(alias="tare")
    duration_s: PositiveSeconds = Field(alias="for", description="the time of the mean")

    @property
    def least_s(self) -> float:
        """The time of the mean."""
        return self.duration_s
