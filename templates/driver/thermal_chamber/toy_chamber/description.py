"""Bench file keys of the chamber."""

from __future__ import annotations

from drivers.chamber.description import CHANNELS, ChamberLimits, ChamberSafe, StairOptions
from drivers.description import DriverDescription


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
