"""A head and a rate table whose frames a profile describes."""

from __future__ import annotations

from drivers.description import Nothing, Setup
from drivers.framed.axes import FramedHeadAxis, FramedTableAxis
from drivers.framed.description import FramedHeadOptions, FramedTableOptions
from drivers.head.description import HeadLimits
from drivers.head.driver import Head
from drivers.table.description import TableLimits
from drivers.table.driver import Table


class FramedHead(Head):
    """A Positioner."""

    def __init__(self, setup: Setup[FramedHeadOptions, HeadLimits, Nothing]) -> None:
        super().__init__(setup.name, FramedHeadAxis(setup), setup.options, setup.limits)


class FramedTable(Table):
    """A Positioner and a RateTable."""

    def __init__(self, setup: Setup[FramedTableOptions, TableLimits, Nothing]) -> None:
        super().__init__(setup.name, FramedTableAxis(setup), setup.options, setup.limits)
