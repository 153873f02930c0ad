"""A thermal chamber of Weiss or Vötsch."""

from __future__ import annotations

from drivers.chamber.description import ChamberLimits, ChamberSafe
from drivers.chamber.driver import Chamber
from drivers.description import Setup
from drivers.simserv.controller import Simpac
from drivers.simserv.description import SimservOptions


class Simserv(Chamber):
    """A ThermalChamber that ramps by itself."""

    def __init__(self, setup: Setup[SimservOptions, ChamberLimits, ChamberSafe]) -> None:
        super().__init__(setup.name, Simpac(setup), setup.limits, setup.safe, setup.options)
