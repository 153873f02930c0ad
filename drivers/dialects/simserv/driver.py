"""A thermal chamber of Weiss or Vötsch."""

from __future__ import annotations

from drivers.description import Setup
from drivers.dialects.simserv.controller import Simpac
from drivers.dialects.simserv.description import SimservOptions
from drivers.kinds.chamber.description import ChamberLimits, ChamberSafe
from drivers.kinds.chamber.driver import Chamber


class Simserv(Chamber):
    """A ThermalChamber that ramps by itself."""

    def __init__(self, setup: Setup[SimservOptions, ChamberLimits, ChamberSafe]) -> None:
        super().__init__(setup.name, Simpac(setup), setup.limits, setup.safe, setup.options)
