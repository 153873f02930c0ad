"""Description of the method: settings, results and their units, and the modules of its parts.

`bench check` reads this module too: it imports neither numpy nor matplotlib.
"""

from typing import Annotated

from bench.sequence.method import OUTPUT, MethodDescription
from drivers.schema.fields import StrictModel, WholeNumber
from pydantic import Field


class ToyRestSettings(StrictModel):
    """Settings of the output and drift at rest."""

    fewest: Annotated[WholeNumber, Field(ge=4, le=1000)] = Field(
        10, description="readings below which no drift is stated"
    )


DESCRIPTION = MethodDescription(
    name="toy_rest",
    title="Output and drift at rest",
    target="toy_rest.reduction:reduce",
    settings=ToyRestSettings,
    quantities={"rest_mean": OUTPUT, "rest_drift": "1/h", "rest_scatter": "1"},
    shown={"rest_drift": "ppm/h", "rest_scatter": "ppm"},
    counts_at="records",
    drawn_by="toy_rest.shown:rest_shown",
    rules="toy_rest.rules:RULES",
    words="toy_rest.words:WORDS",
    translations="toy_rest.words:TRANSLATIONS",
    spans="toy_rest.shown:spans",
    offline="toy_rest.offline:REDUCTIONS",
    truth="toy_rest.truth:truth",
    meaning=(
        "The unit is measured together with its converter, at one attitude. The drift is that of both, with what the "
        "change of their temperature during the readings adds to it."
    ),
)
