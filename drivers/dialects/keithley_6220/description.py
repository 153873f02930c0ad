"""Bench file keys of a Keithley 6220 or 6221."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drivers.dialects.keithley_6220.wire import COMPLIANCE_MAX_V, COMPLIANCE_MIN_V, RANGES_A, Terminator
from drivers.kinds.described import current_source
from drivers.kinds.ranges import range_of
from drivers.schema.fields import InUnit, StrictModel

KNOWN_RANGE = range_of(RANGES_A, "A", "one of 2 nA to 20 mA in decades, or 100 mA")


class KeithleyOptions(StrictModel):
    """Use of the source.

    `terminator` ends lines in both directions and must be the one in the instrument's communication menu: on RS-232 it
    acts on a CR, with or without an LF after it; over TCP (6221) `lf` is usual.
    """

    range: Annotated[float, InUnit("A", above=0), KNOWN_RANGE] = Field(
        description="the one range for all levels, 2 nA to 20 mA in decades or 100 mA"
    )
    compliance: Annotated[float, InUnit("V", at_least=COMPLIANCE_MIN_V, at_most=COMPLIANCE_MAX_V)] = Field(
        description="maximum compliance of a sequence"
    )
    terminator: Terminator = "crlf"


DESCRIPTION = current_source(
    name="keithley_6220",
    title="precision current source Keithley 6220 or 6221",
    schemes=frozenset({"serial", "socket", "tcp"}),
    target="drivers.dialects.keithley_6220.driver:Keithley6220",
    simulator="simulators.instruments.sources.keithley_6220:SimulatedKeithley",
    recognition="drivers.dialects.keithley_6220.recognition:RECOGNITION",
    options=KeithleyOptions,
)
