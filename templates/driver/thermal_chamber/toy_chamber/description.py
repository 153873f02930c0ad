"""Bench file keys of the chamber."""

from __future__ import annotations

from drivers.description import DriverDescription
from drivers.kinds.chamber.description import CHANNELS, ChamberLimits, ChamberSafe, SteppedRampOptions


class ToyChamberOptions(SteppedRampOptions):
    """Protocol settings of the controller, and its ramp by a series of set points."""


DESCRIPTION = DriverDescription(
    name="toy_chamber",
    title="fictitious thermal chamber",
    capabilities=frozenset({"thermal_chamber"}),
    schemes=frozenset({"serial", "tcp"}),
    target="toy_chamber.driver:ToyChamber",
    simulator="toy_chamber.simulator:SimulatedToyChamber",
    options=ToyChamberOptions,
    limits=ChamberLimits,
    safe=ChamberSafe,
    channels=CHANNELS,
)
