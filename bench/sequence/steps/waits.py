"""Steps that wait: for a time, for a reading, for the unit to have the temperature of the chamber."""

from __future__ import annotations

from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from bench.config.interlocks import ReadingName
from bench.sequence.steps.fields import Resumed, StepBase, is_known
from drivers.quantity.units import parse_unit
from drivers.schema.fields import (
    AnyQuantity,
    CelsiusPerHour,
    InUnit,
    Name,
    PositiveCelsius,
    PositiveSeconds,
    Seconds,
    StrictModel,
)
from drivers.schema.wording import telling

LOOK_EVERY_S = 5.0  # how often a step that waits for a reading looks at it
WINDOW_COVERAGE = 0.95  # of the hold time must be covered by readings before it is judged


class Wait(StepBase):
    """Waits for a time."""

    resumed: ClassVar[Resumed] = "in full"

    duration_s: Seconds = Field(alias="wait")

    @property
    def least_s(self) -> float:
        """The time itself."""
        return self.duration_s


STEADY_PARTS = 6  # of the time over which outputs are to be steady; their means are compared


class Steady(StrictModel):
    """Steady means: of a line fitted to mean outputs over that time, the ends differ by no more than `change`.

    It is measured in six equal parts, so that what a count resolves over one of them must be small against `change`.
    """

    change: AnyQuantity = Field(
        description="in g, by what the units are made to be, or in the unit of their output, such as pulse/s"
    )
    over_s: Annotated[float, InUnit("s", at_least=30)] = Field(alias="over", description="the time looked at")

    @property
    def in_g(self) -> bool:
        """Whether it is in g, so that nominal scale factors are needed."""
        return self.change.dimension == parse_unit("g").dimension


class WaitUntil(StepBase):
    """Waits until a reading is above one value, below another, or both, and has been so for a time.

    Or, with `steady`, until the outputs of the units that are in no longer drift: of all, of those that one device
    measures, or of that on one channel where one is named.
    """

    resumed: ClassVar[Resumed] = "in full"

    reading: ReadingName = Field(alias="wait_until")
    above: AnyQuantity | None = Field(None, description="in the unit of the reading")
    below: AnyQuantity | None = Field(None, description="in the unit of the reading")
    hold_s: Seconds = Field(0.0, alias="hold", description="how long the condition must hold")
    steady: Steady | None = None
    give_up_after_s: PositiveSeconds = Field(alias="give_up_after", description="after this time it is an error")

    @property
    def least_s(self) -> float:
        """How long the condition must hold."""
        return self.hold_s if self.steady is None else self.steady.over_s

    @model_validator(mode="after")
    def _can_come_true(self) -> Self:
        if self.steady is not None:
            if self.above is not None or self.below is not None or self.hold_s:
                raise telling("'steady' stands alone: without above, below and hold")
            if self.give_up_after_s <= self.steady.over_s:
                raise telling("'give_up_after' must be longer than the time over which it is to be steady")
            return self
        if self.above is None and self.below is None:
            raise telling("needs above, or below, or both; or steady")
        if self.above is not None and self.below is not None and is_known(self.above) and is_known(self.below):
            if self.above.dimension != self.below.dimension:
                raise telling(f"above is {self.above}, below is {self.below}: they need the same unit")
            if self.above >= self.below:
                raise telling(f"nothing is above {self.above} and below {self.below}")
        if self.give_up_after_s <= self.hold_s:
            raise telling("'give_up_after' must be longer than 'hold'")
        return self


class Stable(StrictModel):
    """Stable means: over the last `hold`, within the step, max - min within band and a fitted slope within slope."""

    band_c: PositiveCelsius = Field(alias="band", description="how far apart the highest and the lowest value may be")
    slope_c_per_h: CelsiusPerHour = Field(alias="slope", description="the steepest fitted line")
    hold_s: PositiveSeconds = Field(alias="hold", description="the time over which both are looked at")


class Soak(StepBase):
    """Waits at a temperature for at least a time, and until a reading is stable."""

    resumed: ClassVar[Resumed] = "in full"

    role: Name = Field(alias="soak")
    at_least_s: Seconds = Field(alias="at_least", description="the shortest time")
    until_stable: Stable | None = None
    give_up_after_s: PositiveSeconds | None = Field(
        None, alias="give_up_after", description="after this time an unstable reading is an error"
    )

    @property
    def least_s(self) -> float:
        """The fixed time, or the time to see that it is stable."""
        return max(self.at_least_s, self.until_stable.hold_s if self.until_stable else 0.0)

    @model_validator(mode="after")
    def _bounded(self) -> Soak:
        if self.until_stable is not None and self.give_up_after_s is None:
            raise telling("'until_stable' needs 'give_up_after', a limit of the waiting time")
        return self
