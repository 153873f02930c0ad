"""Bench file keys of a Weiss or Vötsch chamber."""

from __future__ import annotations

from pydantic import Field

from drivers.dialects.simserv.wire import Reads
from drivers.kinds.chamber.description import ChamberOptions
from drivers.kinds.described import thermal_chamber


class SimservOptions(ChamberOptions):
    """Protocol settings of the controller."""

    set_point_reads: Reads = Field(
        "target",
        description="set point reported during a ramp: the end of the ramp, or its present value",
    )


DESCRIPTION = thermal_chamber(
    name="simserv",
    title="thermal chamber of Weiss or Vötsch, SIMSERV",
    schemes=frozenset({"tcp"}),
    target="drivers.dialects.simserv.controller:Simserv",
    simulator="simulators.instruments.chambers.simserv:SimulatedSimserv",
    recognition="drivers.dialects.simserv.recognition:RECOGNITION",
    options=SimservOptions,
)
