"""Bench file keys of a chamber whose controller a profile describes."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, ValidationError, model_validator

from drivers.dialects.modbus_chamber.profile import ChamberProfile
from drivers.kinds.chamber.description import SteppedRampOptions
from drivers.kinds.described import thermal_chamber
from drivers.schema.fields import DocumentFile, ModelBeside, WholeNumber
from drivers.schema.wording import problem_at


class ModbusChamberOptions(SteppedRampOptions):
    """Protocol settings of the controller."""

    profile: Annotated[DocumentFile[ChamberProfile], ModelBeside(ChamberProfile)] = Field(
        description="profile file of the controller"
    )
    unit_id: Annotated[WholeNumber, Field(ge=1, le=247)] = Field(1, description="Modbus address")

    @model_validator(mode="after")
    def _steps_are_for_controllers_without_a_ramp(self) -> Self:
        profile = self.profile.content
        if profile is not None and profile.ramp is not None and "step" in self.model_fields_set:
            problem = "this controller ramps by itself, as its profile says; leave step out"
            raise ValidationError.from_exception_data(type(self).__name__, [problem_at(("step",), problem)])
        return self


DESCRIPTION = thermal_chamber(
    name="modbus_chamber",
    title="thermal chamber whose Modbus registers a profile describes",
    schemes=frozenset({"tcp", "serial", "socket"}),
    target="drivers.dialects.modbus_chamber.controller:ModbusChamber",
    simulator="simulators.instruments.chambers.modbus_chamber:SimulatedProfile",
    recognition="drivers.dialects.modbus_chamber.recognition:RECOGNITION",
    options=ModbusChamberOptions,
)
