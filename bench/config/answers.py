"""What a scripted technician answers: `--answers FILE`, for runs on simulated instruments."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from drivers.schema.fields import Degrees, Name, Seconds, StrictModel
from drivers.schema.wording import expected

SCRIPTED = "scripted technician"  # his name, unless the file gives him another


def _as_text(raw: Any) -> Any:
    """What would be typed: numbers and truths as they are written."""
    if isinstance(raw, (list, dict)) or raw is None:
        raise expected("an answer", raw)
    return str(raw).lower() if isinstance(raw, bool) else str(raw)


class Deed(StrictModel):
    """What the technician really does, whatever he was asked for; nothing when it is empty."""

    mount: Name | None = Field(None, description="the mount in which he fixes the units")
    input: Literal["accelerometer", "source"] | None = Field(None, description="what he plugs into the converters")
    turn: Degrees | None = Field(None, description="the angle to which he turns the head")


class ScriptedAnswer(StrictModel):
    """An answer to the question of one step, or of a head that is turned by hand."""

    answer: Annotated[str, BeforeValidator(_as_text)] | None = Field(
        None, description="the answer; default: the first choice, or the requested angle"
    )
    after: Seconds | None = Field(
        None, description="the time until the answer; default: one minute, or the turn_time of a head"
    )
    does: Deed | None = Field(None, description="what he does instead of the requested action; {} for nothing")
    by: str = Field(SCRIPTED, description="his name in the record", min_length=1, max_length=100)


class AnswersFile(StrictModel):
    """One file of answers, by the ids of the steps that ask (`bench plan` lists them), or by the device that asks.

    A device that asks for something by hand numbers its questions: `head#3` is the third one, `head#3~2` the same once
    more, and `head` are all that have no answer of their own.
    """

    schema_: Literal["itb-answers/1"] = Field(alias="schema", description="version of the file format")
    answers: Mapping[str, ScriptedAnswer] = Field(description="by the id of the asking step or device")
