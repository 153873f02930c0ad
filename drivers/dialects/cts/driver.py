"""A thermal chamber of CTS."""

from __future__ import annotations

from drivers.description import Setup
from drivers.dialects.cts.controller import CtsController
from drivers.dialects.cts.description import CtsOptions
from drivers.kinds.chamber.description import ChamberLimits, ChamberSafe
from drivers.kinds.chamber.driver import Chamber


class Cts(Chamber):
    """A ThermalChamber that ramps by itself."""

    def __init__(self, setup: Setup[CtsOptions, ChamberLimits, ChamberSafe]) -> None:
        super().__init__(setup.name, CtsController(setup), setup.limits, setup.safe, setup.options)
