"""Steps that measure: outputs under a label for a reduction, single readings with limits for a decision."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Self

from pydantic import Field, model_validator

from bench.config.interlocks import ReadingName
from bench.sequence.steps.fields import Resumed, StepBase, choice_of, one_of
from bench.sequence.steps.limits import LimitEntry
from bench.sequence.steps.nested import Steps
from drivers.schema.fields import OR_EXPRESSION, AnyQuantity, Flag, InUnit, Name, PositiveSeconds, StrictModel
from drivers.schema.wording import telling


class StableOutput(StrictModel):
    """Stability of an output: scatter and drift of its means over 10 s, in g by the nominal scale factor."""

    sd_g: Annotated[float, InUnit("g", above=0)] = Field(alias="sd", description="maximum scatter of the means")
    slope_g_per_s: Annotated[float, InUnit("g/s", above=0)] = Field(
        alias="slope", description="maximum drift of the means"
    )
    over_s: Annotated[float, InUnit("s", at_least=30, at_most=3600)] = Field(
        60.0, alias="over", description="evaluation time"
    )


class Acquire(StepBase):
    """Acquire the output of units under a label that a result can name.

    The acquisition lasts for a time, over whole turns, during other steps, or until the output is stable. `turns` are
    turns of the table `of`, which rotates meanwhile. Data not stable by `give_up_after` are kept and flagged.
    `resolution` is the resolution that the counting must reach, in g or relative to 1 g: the check warns if the time is
    too short.
    """

    model_config = one_of(("for",), ("turns", "of"), ("during",), ("until_stable", "give_up_after"))
    resumed: ClassVar[Resumed] = "anew"

    role: Name = Field(alias="acquire")
    duration_s: PositiveSeconds | None = Field(None, alias="for", description="how long")
    turns: Annotated[float, InUnit("", above=0)] | None = Field(None, description="number of turns of the table")
    of: Name | None = Field(None, description="the table whose turns are counted")
    during: Steps | None = Field(None, description="these steps run meanwhile")
    until_stable: StableOutput | None = None
    give_up_after_s: PositiveSeconds | None = Field(
        None, alias="give_up_after", description="maximum wait for stability"
    )
    label: Name = Field(description="by which a result refers to the data")
    resolution: AnyQuantity | None = Field(None, description="the resolution that the counting must reach")

    @property
    def least_s(self) -> float:
        """Minimum measuring time."""
        return self.until_stable.over_s if self.until_stable is not None else self.duration_s or 0.0

    @model_validator(mode="after")
    def _has_time(self) -> Self:
        if self.until_stable and self.give_up_after_s is not None and self.give_up_after_s < self.until_stable.over_s:
            raise telling("give_up_after is shorter than the time that must be stable")
        return self

    @model_validator(mode="before")
    @classmethod
    def _one_end(cls, raw: Any) -> Any:
        if isinstance(raw, dict):
            ends = ("for", "turns", "during", "until_stable")
            end = choice_of({key: raw.get(key) for key in ends}, "an acquisition")
            if (end == "until_stable") != (raw.get("give_up_after") is not None):
                raise telling("until_stable and give_up_after go together")
            if (end == "turns") != (raw.get("of") is not None):
                raise telling("turns and of go together: the table whose turns are counted")
        return raw


class Measure(StepBase):
    """Measure one value: the newest of a reading, or its mean over a time; within limits it passes, otherwise it fails.

    A reading is a named one, DEVICE.CHANNEL, or the pulse rate of a counter channel, which needs a time. So does
    OUTPUT.PLACE, where OUTPUT is a need of kind output: the output of the unit in a place, by whatever instrument, in g
    by its nominal scale factor; of an inertial unit OUTPUT.PLACE.acc_x, acc_y or acc_z. `as` is its name in later
    expressions. With `net`, the value of the last `tare` is subtracted. Readings from before the step are not used.
    """

    reading: Annotated[ReadingName, OR_EXPRESSION] = Field(alias="measure")
    duration_s: PositiveSeconds | None = Field(
        None, alias="for", description="averaging time; without it, the newest value"
    )
    name: Name | None = Field(None, alias="as", description="the name of the value in later expressions")
    net: Flag = Field(False, description="subtract the value of the last tare")
    limits: LimitEntry | None = None

    @property
    def least_s(self) -> float:
        """Averaging time."""
        return self.duration_s or 0.0

    @model_validator(mode="after")
    def _for_something(self) -> Self:
        if self.name is None and self.limits is None:
            raise telling("needs 'as' or 'limits', otherwise the value is not used")
        return self


class Tare(StepBase):
    """Measure the mean of a reading over a time as the zero of later `measure` steps with `net: true`."""

    reading: ReadingName = Field(alias="tare")
    duration_s: PositiveSeconds = Field(alias="for", description="averaging time")

    @property
    def least_s(self) -> float:
        """Averaging time."""
        return self.duration_s
