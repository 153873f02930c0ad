"""An indexing head on a Newport XPS."""

from __future__ import annotations

from drivers.description import Nothing, Setup
from drivers.dialects.newport_xps.axis import XpsAxis
from drivers.dialects.newport_xps.description import XpsOptions
from drivers.kinds.head.description import HeadLimits
from drivers.kinds.head.driver import Head


class NewportXps(Head):
    """A Positioner."""

    def __init__(self, setup: Setup[XpsOptions, HeadLimits, Nothing]) -> None:
        super().__init__(setup.name, XpsAxis(setup), setup.options, setup.limits)
