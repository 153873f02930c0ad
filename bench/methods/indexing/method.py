"""Descriptions of the static calibration on an indexing table (method M1) and of the step that compares both ends."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from bench.methods.indexing.names import CLOCKING, REVERSE, VERIFICATION
from bench.sequence.method import OUTPUT, MethodDescription, NamedPart, Units
from bench.sequence.per_degree import BiasPerDegree, ScalePerDegree
from bench.sequence.steps.custom import StepDescription
from drivers.schema.fields import InUnit, Name, Number, Ratio, StrictModel
from drivers.schema.wording import telling


class IndexingStaticSettings(BiasPerDegree, ScalePerDegree):
    """Settings of the static calibration on an indexing table.

    The scale factors of both ends count as equal if they differ by no more than the larger of `scale_tolerance` and `k`
    standard uncertainties.
    """

    scale_tolerance: Annotated[Ratio, InUnit("", at_least=0)] = Field(
        0.0, description="relative tolerance of the scale factor"
    )
    k: Annotated[Number, Field(ge=0)] = Field(2.0, description="standard uncertainties of the difference of both ends")
    output_limit_g: Annotated[float, InUnit("g", above=0)] | None = Field(
        None, alias="output_limit", description="an output beyond it, by the nominal scale factor, is never fitted"
    )
    outlier_k: Annotated[Number, Field(gt=0)] = Field(
        6.0, description="robust standard deviations beyond which a reading is left out"
    )
    platform_rad: Annotated[float, InUnit("rad")] | None = Field(
        None,
        alias="platform",
        description="angle by which the platform raises the input axis, by a coordinate measuring machine",
    )
    platform_u_rad: Annotated[float, InUnit("rad", at_least=0)] = Field(
        0.0, alias="platform_u", description="its standard uncertainty"
    )

    @model_validator(mode="after")
    def _goes_together(self) -> Self:
        if self.platform_rad is None and self.platform_u_rad:
            raise telling("platform_u is of platform, which is not given")
        return self


UNITS: Units = {
    "K0": ("g", "µg"),
    "K1": f"{OUTPUT}/g",
    "K1_si": f"{OUTPUT}/(m/s²)",
    "misalignment": ("rad", "µrad"),
    "misalignment_y": ("rad", "µrad"),
    "Kip": ("g/g²", "µg/g²"),
    "Kio": ("g/g²", "µg/g²"),
    "K2": ("g/g²", "µg/g²"),
    "K3": ("g/g³", "µg/g³"),
    "scale_difference": ("1", "ppm"),
    "bias": OUTPUT,
    "bias_corrected": OUTPUT,
    "bias_total": OUTPUT,
    "b3": OUTPUT,
    "b4": OUTPUT,
    "b5": OUTPUT,
    "seat_tilt": ("rad", "µrad"),
    "linearity": ("1", "ppm"),
    "hysteresis": ("g", "µg"),
    "verification/largest": ("g", "µg"),
    "verification/rms": ("g", "µg"),
    "verification/offset": ("g", "µg"),
    "verification/scale": ("1", "ppm"),
}
INDEXING_STATIC = MethodDescription(
    name="indexing_static",
    title="Static calibration on an indexing table (method M1)",
    target="bench.methods.indexing.reduction.run:reduce",
    settings=IndexingStaticSettings,
    quantities=UNITS,
    counts_at="records",
    drawn_by="bench.methods.indexing.shown:indexing_shown",
    meaning=(
        "The unit is measured together with its converter, or with the resistor that its current flows through. K0 and "
        "K1 are means of both ends, so that they are free of the misalignment of the input axis and of its cross "
        "coupling; by the clocking K0 is free of the tilt of the seat too. K1 contains K3 as far as the angles go. Kip "
        "is the coupling with Z, from both ends; Kio that with Y, from both sides, if the unit was measured there."
    ),
    words="bench.methods.indexing.words:WORDS",
    parts=(
        NamedPart(
            CLOCKING,
            "group",
            "readings of the clocking, from which the tilt of the seat follows",
            "the tilt of the seat is not found, and is in the bias and in its uncertainty",
        ),
        NamedPart(
            VERIFICATION,
            "group",
            "readings that are compared with the fitted equation",
            "the equation that is found is not tried on readings of its own",
        ),
        NamedPart(REVERSE, "loop", "readings of the pass back", "hysteresis is not determined"),
    ),
    rules="bench.methods.indexing.rules:RULES",
    spans="bench.methods.indexing.shown:ends",
    offline="bench.methods.indexing.offline:REDUCTIONS",
)


class CompareEndsSettings(StrictModel):
    """Settings of the comparison: label of the acquisitions, as in the `indexing_static` of the sequence's results."""

    data: Name = Field(description="the label of the acquisitions")
    max_repeats: Annotated[float, InUnit("", at_least=0)] = Field(
        3, description="maximum number of repeated measurements of both ends"
    )


COMPARE_ENDS = StepDescription(
    name="compare_ends",
    title="Comparison of both ends of a unit on an indexing table: accept, repeat, or marginal after all repeats",
    target="bench.methods.indexing.compare_ends:compare_ends",
    settings=CompareEndsSettings,
    example="repeat",
)
