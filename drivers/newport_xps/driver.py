"""An indexing head on a Newport XPS."""

from __future__ import annotations

from drivers.description import Nothing, Setup
from drivers.head.description import HeadLimits
from drivers.head.driver import Head
from drivers.newport_xps.axis import XpsAxis
from drivers.newport_xps.description import XpsOptions


class NewportXps(Head):
    """A Positioner."""

    def __init__(self, setup: Setup[XpsOptions, HeadLimits, Nothing]) -> None:
        super().__init__(setup.name, XpsAxis(setup), setup.options, setup.limits)
