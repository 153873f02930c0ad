"""A rate table on an Acutrol3000."""

from __future__ import annotations

from drivers.description import Nothing, Setup
from drivers.dialects.acutronic_acl.axis import AclAxis
from drivers.dialects.acutronic_acl.description import AclOptions
from drivers.kinds.table.description import TableLimits
from drivers.kinds.table.driver import Table


class AcutronicAcl(Table):
    """A Positioner and a RateTable.

    It locks out the front panel while it uses the table, and releases it at the end.
    """

    def __init__(self, setup: Setup[AclOptions, TableLimits, Nothing]) -> None:
        super().__init__(setup.name, AclAxis(setup), setup.options, setup.limits)
