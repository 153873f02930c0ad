"""Description of the method of threshold and resolution (method M4d)."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from bench.sequence.method import MethodDescription, NamedPart
from drivers.schema.fields import InUnit, StrictModel


class ThresholdSettings(StrictModel):
    """Settings of a ladder of small steps."""

    biased_above_g: Annotated[float, InUnit("g", above=0, at_most=1)] = Field(
        0.1,
        alias="biased_above",
        description="largest input of a threshold; a position with a larger one gives the resolution",
    )


THRESHOLD = MethodDescription(
    name="threshold",
    title="Threshold and resolution (method M4d)",
    target="bench.methods.threshold.reduction.run:reduce",
    words="bench.methods.threshold.words:WORDS",
    parts=(
        NamedPart("position", "loop", "the angle about which a ladder is made; 0° without it"),
        NamedPart("offset", "loop", "the step from there; 0° for a reading at the position itself"),
    ),
    rules="bench.methods.threshold.rules:RULES",
    spans="bench.methods.threshold.shown:ladders",
    settings=ThresholdSettings,
    quantities={"threshold": ("g", "µg"), "resolution": ("g", "µg")},
    counts_at="steps",
    drawn_by="bench.methods.threshold.shown:ladder_plots",
    after=("IEEE Std 1293", "IEEE Std 1554"),
)
