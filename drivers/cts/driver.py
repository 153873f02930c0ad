"""A thermal chamber of CTS."""

from __future__ import annotations

from drivers.chamber.description import ChamberLimits, ChamberSafe
from drivers.chamber.driver import Chamber
from drivers.cts.controller import CtsController
from drivers.cts.description import CtsOptions
from drivers.description import Setup


class Cts(Chamber):
    """A ThermalChamber that ramps by itself."""

    def __init__(self, setup: Setup[CtsOptions, ChamberLimits, ChamberSafe]) -> None:
        super().__init__(setup.name, CtsController(setup), setup.limits, setup.safe, setup.options)
