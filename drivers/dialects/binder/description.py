"""Bench file keys of a Binder chamber."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from drivers.dialects.binder.wire import Kind, SetPointName
from drivers.kinds.chamber.description import SteppedRampOptions, TemperatureRange
from drivers.kinds.described import thermal_chamber
from drivers.schema.fields import Flag, PositiveSeconds, WholeNumber
from drivers.schema.wording import telling


class BinderOptions(SteppedRampOptions):
    """Protocol settings of the controller."""

    controller: Kind = Field(description="type of the controller: mb1 or mb2")
    range: TemperatureRange = Field(
        description="range of set points, from the chamber's manual; the controller does not report it"
    )
    unit_id: Annotated[WholeNumber, Field(ge=1, le=247)] = Field(1, description="Modbus address")
    set_point: SetPointName = Field("manual", description="mode of an mb1")
    swapped: Flag = Field(False, description="true for an mb1 with exchanged registers of basic and manual")
    answer_timeout: PositiveSeconds = Field(1.0, description="timeout of an answer, which takes up to 250 ms")

    @model_validator(mode="after")
    def _an_mb2_has_one_set_point(self) -> Self:
        if self.controller == "mb2" and (self.set_point == "basic" or self.swapped):
            raise telling("an mb2 has the manual set point only; leave set_point and swapped out")
        return self


DESCRIPTION = thermal_chamber(
    name="binder",
    title="Binder thermal chamber with MB1 or MB2, Modbus RTU",
    schemes=frozenset({"serial", "socket"}),
    target="drivers.dialects.binder.controller:Binder",
    simulator="simulators.instruments.chambers.binder:SimulatedBinder",
    recognition="drivers.dialects.binder.recognition:RECOGNITION",
    options=BinderOptions,
)
