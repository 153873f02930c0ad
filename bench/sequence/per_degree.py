"""Change of a coefficient per 1 °C, for results that state a temperature if the run determines no slope."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drivers.schema.fields import InUnit, StrictModel


class ScalePerDegree(StrictModel):
    """Change per 1 °C of a scale factor."""

    scale_per_c_u: Annotated[float, InUnit("1/°C", at_least=0)] = Field(
        6e-5,
        alias="scale_per_degree_u",
        description="standard uncertainty of the relative change of a scale factor with 1 °C, if the run "
        "does not determine it; no correction is applied",
    )


class BiasPerDegree(StrictModel):
    """Change per 1 °C of the bias of an accelerometer."""

    bias_per_c_u: Annotated[float, InUnit("g/°C", at_least=0)] = Field(
        2e-5,
        alias="bias_per_degree_u",
        description="standard uncertainty of the change of the bias with 1 °C; no correction is applied",
    )
