"""Scenario: scripted faults of simulated instruments; `--scenario FILE` of simulate, run and rehearse."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from bench.config.devices import Text
from bench.config.simulation import AnyFault, FaultSimulation
from drivers.schema.fields import NOT_EMPTY, Seconds, StrictModel
from drivers.schema.wording import telling


class ScriptedFault(FaultSimulation):
    """Fault as in a bench file; its time is `at` or `after`, or their sum."""

    kind_key: ClassVar[str] = "fault"

    kind: AnyFault = Field(alias="fault", description="kind of fault; not every instrument supports every kind")
    at: Seconds = Field(0.0, description="when, after the beginning of the run, or after the step has ended")

    @model_validator(mode="after")
    def _some_time(self) -> ScriptedFault:
        if not self.model_fields_set & {"at", "after"}:
            raise telling("give at, such as 10 min, or after, the id of a step")
        return self


class ScenarioFile(StrictModel):
    """File of faults, for the instruments of one kind of bench."""

    schema_: Literal["itb-scenario/1"] = Field(alias="schema", description="version of the file format")
    title: Text = Field(description="purpose of the scenario")
    faults: Annotated[tuple[ScriptedFault, ...], NOT_EMPTY] = Field(description="in any order")
