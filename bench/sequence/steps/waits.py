"""Steps that wait: for a time, for a reading, for the unit to reach the temperature of the chamber."""

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

LOOK_EVERY_S = 5.0  # polling interval of a step that waits for a reading
WINDOW_COVERAGE = 0.95  # part of the hold time that readings must cover


class Wait(StepBase):
    """Wait for a time."""

    resumed: ClassVar[Resumed] = "in full"

    duration_s: Seconds = Field(alias="wait")

    @property
    def least_s(self) -> float:
        """Duration of the wait."""
        return self.duration_s


STEADY_PARTS = 6  # parts of the evaluation time; their means are compared


class Steady(StrictModel):
    """Stability criterion for mean outputs: the ends of a line fitted over the time differ by at most `change`.

    The time is divided into six equal parts; the resolution of a count over one part must be small against `change`.
    """

    change: AnyQuantity = Field(
        description="in g, by the nominal scale factor of the units, or in the unit of their output, such as pulse/s"
    )
    over_s: Annotated[float, InUnit("s", at_least=30)] = Field(alias="over", description="evaluation time")

    @property
    def in_g(self) -> bool:
        """True if it is in g, so that nominal scale factors are needed."""
        return self.change.dimension == parse_unit("g").dimension


class WaitUntil(StepBase):
    """Wait until a reading is above one value, below another, or both, and has been so for a time.

    Or, with `steady`, until the outputs of the remaining units no longer drift: of all, or of those that one device or
    one channel measures.
    """

    resumed: ClassVar[Resumed] = "in full"

    reading: ReadingName = Field(alias="wait_until")
    above: AnyQuantity | None = Field(None, description="in the unit of the reading")
    below: AnyQuantity | None = Field(None, description="in the unit of the reading")
    hold_s: Seconds = Field(0.0, alias="hold", description="how long the condition must hold")
    steady: Steady | None = None
    give_up_after_s: PositiveSeconds = Field(alias="give_up_after", description="maximum wait; an error after it")

    @property
    def least_s(self) -> float:
        """Hold time of the condition."""
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
    """Stability criterion: over the last `hold` of the step, max − min within band and fitted slope within slope."""

    band_c: PositiveCelsius = Field(alias="band", description="maximum range: highest minus lowest value")
    slope_c_per_h: CelsiusPerHour = Field(alias="slope", description="maximum slope of the fitted line")
    hold_s: PositiveSeconds = Field(alias="hold", description="evaluation time of both")


class Soak(StepBase):
    """Wait at a temperature for a minimum time, and until a reading is stable."""

    resumed: ClassVar[Resumed] = "in full"

    role: Name = Field(alias="soak")
    at_least_s: Seconds = Field(alias="at_least", description="minimum time")
    until_stable: Stable | None = None
    give_up_after_s: PositiveSeconds | None = Field(
        None, alias="give_up_after", description="maximum wait for stability; an error after it"
    )

    @property
    def least_s(self) -> float:
        """The fixed time, or the evaluation time of stability."""
        return max(self.at_least_s, self.until_stable.hold_s if self.until_stable else 0.0)

    @model_validator(mode="after")
    def _bounded(self) -> Soak:
        if self.until_stable is not None and self.give_up_after_s is None:
            raise telling("'until_stable' needs 'give_up_after', a limit of the waiting time")
        return self
