"""A head and a rate table whose frames a profile describes."""

from __future__ import annotations

from drivers.description import Nothing, Setup
from drivers.dialects.framed.axes import FramedHeadAxis, FramedTableAxis
from drivers.dialects.framed.description import FramedHeadOptions, FramedTableOptions
from drivers.kinds.head.description import HeadLimits
from drivers.kinds.head.driver import Head
from drivers.kinds.table.description import TableLimits
from drivers.kinds.table.driver import Table


class FramedHead(Head):
    """A Positioner."""

    def __init__(self, setup: Setup[FramedHeadOptions, HeadLimits, Nothing]) -> None:
        super().__init__(setup.name, FramedHeadAxis(setup), setup.options, setup.limits)


class FramedTable(Table):
    """A Positioner and a RateTable."""

    def __init__(self, setup: Setup[FramedTableOptions, TableLimits, Nothing]) -> None:
        super().__init__(setup.name, FramedTableAxis(setup), setup.options, setup.limits)
