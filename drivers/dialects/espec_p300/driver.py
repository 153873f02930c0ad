"""A thermal chamber with an ESPEC P300 or SCP-220."""

from __future__ import annotations

from drivers.description import Setup
from drivers.dialects.espec_p300.controller import P300
from drivers.dialects.espec_p300.description import P300Options
from drivers.kinds.chamber.description import ChamberLimits, ChamberSafe
from drivers.kinds.chamber.driver import Chamber


class EspecP300(Chamber):
    """A ThermalChamber that the driver ramps by many set points."""

    def __init__(self, setup: Setup[P300Options, ChamberLimits, ChamberSafe]) -> None:
        super().__init__(setup.name, P300(setup), setup.limits, setup.safe, setup.options)
