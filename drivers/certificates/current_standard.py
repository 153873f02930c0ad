"""Certificate of a current standard, whether a source or an ammeter."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drivers.schema.fields import InUnit, Ratio, StrictModel


class CurrentUncertainty(StrictModel):
    """Expanded uncertainty of a current source or an ammeter in its range, warmed up, from its certificate."""

    gain: Annotated[Ratio, InUnit("", at_least=0)] = Field(0.0, description="relative to the current, such as 40 ppm")
    offset: Annotated[float, InUnit("A", at_least=0)] = Field(0.0, description="constant part")
    drift: Annotated[float, InUnit("1/h", at_least=0)] = Field(0.0, description="relative drift, such as 2 ppm/h")
