"""Bench file keys of a rate table on an Acutrol3000."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drivers.dialects.acutronic_acl.wire import ByteOrder
from drivers.kinds.described import rate_table
from drivers.kinds.table.description import TableOptions
from drivers.schema.fields import WholeNumber


class AclOptions(TableOptions):
    """Motion settings of the axis."""

    axis: Annotated[WholeNumber, Field(ge=1, le=9)] = Field(1, description="number of the axis at the controller")
    byte_order: ByteOrder = Field("little", description="byte order of the two numbers in front of every answer")


DESCRIPTION = rate_table(
    name="acutronic_acl",
    title="rate table on an Acutronic Acutrol3000 (ACL)",
    schemes=frozenset({"tcp"}),
    target="drivers.dialects.acutronic_acl.axis:AcutronicAcl",
    simulator="simulators.instruments.axes.acutronic_acl:SimulatedAcutrol",
    recognition="drivers.dialects.acutronic_acl.recognition:RECOGNITION",
    options=AclOptions,
)
