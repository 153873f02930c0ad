"""Bench file keys of the chamber."""

from __future__ import annotations

from drivers.description import DriverDescription
from drivers.kinds.chamber.description import CHANNELS, ChamberLimits, ChamberSafe, StairOptions


class ToyChamberOptions(StairOptions):
    """How the controller is spoken to, and how it is ramped: by many set points, since it has no ramp of its own."""


DESCRIPTION = DriverDescription(
    name="toy_chamber",
    title="thermal chamber that nobody makes",
    capabilities=frozenset({"thermal_chamber"}),
    schemes=frozenset({"serial", "tcp"}),
    target="toy_chamber.driver:ToyChamber",
    simulator="toy_chamber.simulator:SimulatedToyChamber",
    options=ToyChamberOptions,
    limits=ChamberLimits,
    safe=ChamberSafe,
    channels=CHANNELS,
)
