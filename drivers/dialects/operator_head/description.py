"""Bench file keys of an indexing head that is turned by hand."""

from __future__ import annotations

import math
from typing import Annotated, Self

from pydantic import Field, model_validator

from drivers.certificates.corrections import TURN_DEG, AxisCorrections
from drivers.description import DriverDescription
from drivers.kinds.axes import AxisUncertainty
from drivers.kinds.head.description import AngleRange
from drivers.safe_state import NOTHING
from drivers.schema.fields import InUnit, PositiveSeconds, StrictModel
from drivers.schema.wording import telling

SAME_DEG = 1e-6  # rounding residue of a fraction of a degree


class OperatorHeadOptions(StrictModel):
    """Dial of the head, and angles at which it can be fixed."""

    index_step: Annotated[float, InUnit("°", above=0, at_most=180)] | None = Field(
        None,
        description="pitch of its coupling, such as 0.25° for 1440 teeth; without it any angle is allowed",
    )
    tolerance: Annotated[float, InUnit("°", above=0, at_most=1)] = Field(
        0.01, description="maximum difference of the typed angle from the requested one"
    )
    turn_time: PositiveSeconds = Field(120.0, description="usual time to turn it, read it, and answer")
    give_up_after: PositiveSeconds = Field(86400.0, description="after this time a missing answer is an error")

    @model_validator(mode="after")
    def _whole_steps_in_a_turn(self) -> Self:
        if self.index_step is not None and not self.is_index_position(TURN_DEG):
            raise telling(
                f"index_step is {self.index_step:.9g}°, a turn is {TURN_DEG / self.index_step:.6g} of them; "
                "expected a whole number"
            )
        return self

    def is_index_position(self, angle_deg: float) -> bool:
        """Return whether the head can be fixed at an angle."""
        return self.index_step is None or not abs(math.remainder(angle_deg, self.index_step)) > SAME_DEG


class OperatorHeadLimits(StrictModel):
    """Limits of the head on this bench."""

    angle: AngleRange


DESCRIPTION = DriverDescription(
    name="operator_head",
    title="indexing head, dividing head or Hirth-coupling table that a person turns by hand",
    capabilities=frozenset({"positioner"}),
    schemes=frozenset({"person"}),
    target="drivers.dialects.operator_head.driver:OperatorHead",
    options=OperatorHeadOptions,
    limits=OperatorHeadLimits,
    safe_state=NOTHING,
    uncertainty=AxisUncertainty,
    corrections=AxisCorrections,
    channels={"angle": "°"},
)
