"""Bench file keys of a Yokogawa GS200."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from drivers.dialects.yokogawa_gs200.wire import COMPLIANCE_MAX_V, COMPLIANCE_MIN_V, RANGES_A
from drivers.kinds.described import current_source
from drivers.kinds.ranges import range_of
from drivers.schema.fields import InUnit, StrictModel
from drivers.schema.wording import telling

KNOWN_RANGE = range_of(RANGES_A, "A", "1, 10, 100 or 200 mA")


def _whole_volts(compliance_v: float) -> float:
    if compliance_v != round(compliance_v):
        raise telling(f"is {compliance_v:g} V, expected whole volts")
    return compliance_v


class GS200Options(StrictModel):
    """Use of the source in current mode, with its voltage limited in whole volts."""

    range: Annotated[float, InUnit("A", above=0), KNOWN_RANGE] = Field(
        description="the one range for all levels, 1, 10, 100 or 200 mA; it covers 20 % more, up to 200 mA"
    )
    compliance: Annotated[
        float, InUnit("V", at_least=COMPLIANCE_MIN_V, at_most=COMPLIANCE_MAX_V), AfterValidator(_whole_volts)
    ] = Field(description="maximum compliance of a sequence, in whole volts")


DESCRIPTION = current_source(
    name="yokogawa_gs200",
    title="precision current source Yokogawa GS200",
    schemes=frozenset({"tcp"}),
    target="drivers.dialects.yokogawa_gs200.driver:YokogawaGS200",
    simulator="simulators.instruments.sources.yokogawa_gs200:SimulatedGS200",
    recognition="drivers.dialects.yokogawa_gs200.recognition:RECOGNITION",
    options=GS200Options,
)
