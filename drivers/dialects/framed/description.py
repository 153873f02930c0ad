"""Bench file keys of a head or a rate table whose frames a profile describes."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, ValidationError, model_validator

from drivers.dialects.framed.profile import FrameProfile
from drivers.kinds.described import indexing_head, rate_table
from drivers.kinds.head.description import HeadOptions
from drivers.kinds.table.description import TableOptions
from drivers.schema.fields import DocumentFile, InUnit, ModelBeside, StrictModel
from drivers.schema.wording import problem_at


class FramedOptions(StrictModel):
    """Protocol settings of the controller."""

    profile: Annotated[DocumentFile[FrameProfile], ModelBeside(FrameProfile)] = Field(
        description="profile file of its frames"
    )
    answer_timeout: Annotated[float, InUnit("s", above=0, at_most=2)] = Field(0.5, description="timeout of a status")


class FramedHeadOptions(HeadOptions, FramedOptions):
    """Motion settings of the axis."""

    @model_validator(mode="after")
    def _angles_do_not_wrap(self) -> Self:
        profile = self.profile.content
        if profile is not None and profile.angle_wraps:
            raise _refusal(self, "its angles wrap after a turn, which only framed_table supports")
        return self


class FramedTableOptions(TableOptions, FramedOptions):
    """Motion settings of the axis."""

    @model_validator(mode="after")
    def _it_turns(self) -> Self:
        profile = self.profile.content
        if profile is not None and (profile.commands.rate is None or profile.status.rate is None):
            raise _refusal(self, "a rate table needs commands.rate and status.rate; framed_head needs neither")
        return self


def _refusal(options: StrictModel, problem: str) -> ValidationError:
    return ValidationError.from_exception_data(type(options).__name__, [problem_at(("profile",), problem)])


SCHEMES = frozenset({"serial", "socket", "tcp"})
SIMULATOR = "simulators.instruments.axes.framed:SimulatedFrames"

HEAD = indexing_head(
    name="framed_head",
    title="indexing head whose frames a profile describes",
    schemes=SCHEMES,
    target="drivers.dialects.framed.axes:FramedHead",
    simulator=SIMULATOR,
    options=FramedHeadOptions,
)

TABLE = rate_table(
    name="framed_table",
    title="rate table whose frames a profile describes",
    schemes=SCHEMES,
    target="drivers.dialects.framed.axes:FramedTable",
    simulator=SIMULATOR,
    options=FramedTableOptions,
)
