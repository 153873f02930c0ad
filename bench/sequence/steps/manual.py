"""Step `custom: manual_control`: the run waits for orders of a person and obeys them."""

from __future__ import annotations

from pydantic import Field

from bench.sequence.steps.custom import StepDescription
from drivers.schema.fields import PositiveSeconds, StrictModel

STEP, SEQUENCE = "manual_control", "manual"


class ManualSettings(StrictModel):
    """Settings of manual control."""

    give_up_after_s: PositiveSeconds = Field(
        300.0, alias="give_up_after", description="the run is stopped after this time without a sign of life"
    )


MANUAL_CONTROL = StepDescription(
    name=STEP,
    title="Manual control: the run obeys orders of an engineer until the session is ended",
    target="bench.engine.orders:attend",
    settings=ManualSettings,
    takes_s=lambda settings: float(settings.give_up_after_s),
)
