"""Scripted answers to prompts: `--answers FILE`, for runs on simulated instruments."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from drivers.schema.fields import Degrees, Name, Seconds, StrictModel
from drivers.schema.wording import expected

SCRIPTED = "scripted technician"  # name of the person in the record, unless the file names another


def _as_text(raw: Any) -> Any:
    """Convert numbers and booleans to text as typed."""
    if isinstance(raw, (list, dict)) or raw is None:
        raise expected("an answer", raw)
    return str(raw).lower() if isinstance(raw, bool) else str(raw)


class ScriptedAction(StrictModel):
    """Action of the technician instead of the requested one; empty for none."""

    mount: Name | None = Field(None, description="the mount in which the units are fixed")
    input: Literal["accelerometer", "source"] | None = Field(None, description="what is plugged into the converters")
    channel: Literal["acc_x", "acc_y", "acc_z", "gyro_x", "gyro_y", "gyro_z"] | None = Field(
        None, description="with `input: source`, of an inertial unit: the channel of the cable, from acc_x to gyro_z"
    )
    turn: Degrees | None = Field(None, description="the angle to which the head is turned")

    @property
    def fed_channel(self) -> str:
        """Channel of the cable of a source; empty for a unit with one channel."""
        return self.channel or ""


class ScriptedAnswer(StrictModel):
    """Answer to the prompt of one step, or of a head that is turned by hand."""

    answer: Annotated[str, BeforeValidator(_as_text)] | None = Field(
        None, description="the answer; default: the first choice, or the requested angle"
    )
    after: Seconds | None = Field(
        None, description="the time until the answer; default: one minute, or the turn_time of a head"
    )
    does: ScriptedAction | None = Field(None, description="the action instead of the requested one; {} for none")
    by: str = Field(SCRIPTED, description="name of the person in the record", min_length=1, max_length=100)


class AnswersFile(StrictModel):
    """File of answers, by the ids of the steps that ask (`bench plan` lists them), or by the device that asks.

    Requests of a device are numbered: `head#3` is the third one, `head#3~2` its repetition, and `head` stands for all
    requests without an answer of their own.
    """

    schema_: Literal["itb-answers/1"] = Field(alias="schema", description="version of the file format")
    answers: Mapping[str, ScriptedAnswer] = Field(description="by the id of the asking step or device")
