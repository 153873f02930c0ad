"""Messages of a station by MQTT: models of their JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import datetime
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

LARGEST_DATA = 64 * 1024  # together with the rest, below what brokers accept
_HISTORICAL = Field(
    False, description="true if it was recorded before the present connection began, such as during an outage"
)
_ID = "identifier: the same if it is delivered again"
_RUN = "name of the run directory"


class Message(BaseModel):
    """Message."""

    model_config = ConfigDict(frozen=True)

    def payload(self) -> str:
        """Return the message as JSON. Characters that are not valid in UTF-8 are escaped."""
        found = self.model_dump(mode="json")
        try:
            text = json.dumps(found, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
        except ValueError:  # JSON has no NaN
            found = json.loads(json.dumps(found), parse_constant=lambda _: None)
            text = json.dumps(found, ensure_ascii=False, separators=(",", ":"))
        return text.encode("utf-8", "backslashreplace").decode()


class Status(Message):
    """State of the station itself, retained. The broker publishes `offline` when it loses the connection."""

    status: Literal["online", "offline"]
    bd_seq: int = Field(
        description="number of the connection, 0 to 255, then 0 again; an `offline` with another one than the last "
        "`online` belongs to an older connection"
    )
    title: str = Field("", description="name of the station")
    version: str = Field("", description="version of the program")
    computer: str = Field("", description="name of the computer, as in an archive of runs")
    at: datetime | None = Field(None, description="instant by the clock of the station; null in `offline`")


class Question(Message):
    """Question to a person."""

    step: str
    text: str
    expected: str = Field(description="answers that are accepted")


class State(Message):
    """State of a bench, retained."""

    title: str = Field(description="name of the bench")
    at: datetime | None = Field(
        None, description="when it was so, by the clock of the station; renewed with a change, and each hour"
    )
    zone: str = Field("", description="time zone of the bench, such as `Europe/Berlin`")
    url: str = Field("", description="page of the bench at its station; empty if the station has no address for others")
    bench: str = Field("", description="title in the bench file, which is that in the records of runs")
    run: str = Field("", description="name of the run directory; empty if none is in progress")
    sequence: str = ""
    run_title: str = Field("", description="title of the run")
    units: tuple[str, ...] = Field((), description="serial numbers")
    operator: str = ""
    item: str = Field("", description="item of the queue; empty for a run started by hand")
    steps: tuple[str, ...] = Field((), description="ids of the steps in progress")
    sentence: str = Field("", description="the step in progress in words; empty if unknown")
    sentences: Mapping[str, str] = Field(
        default_factory=dict, description="the same in other languages, by their codes, such as `zh`"
    )
    started: datetime | None = Field(None, description="begin of the run")
    done: int = Field(0, description="steps that have ended")
    total: int = Field(0, description="steps of the plan; 0 if it is unknown")
    ends: datetime | None = Field(None, description="estimated end; sent again when it has changed by half a minute")
    held_by: tuple[str, ...] = Field((), description="why no step begins; `operator` for a person")
    problems: tuple[str, ...] = Field((), description="the newest 20 problems of the run")
    stopped: str = Field("", description="why no item of the queue begins; empty if items begin")
    waiting: int = Field(0, description="items of the queue that wait")


class Questions(Message):
    """Open questions of a bench, retained; an empty message when there are none."""

    run: str = Field(description=_RUN)
    at: datetime | None = Field(None, description="since when they are open, by the clock of the station")
    questions: tuple[Question, ...]


class Reading(Message):
    """Newest reading of a channel, QoS 0. One that a slow connection has missed is not sent later."""

    run: str = Field(description=_RUN)
    value: float | None = Field(description="null unless it is valid and not stale")
    unit: str
    quality: str = Field(description="`valid`, `invalid` or `stale`")
    why: str = Field("", description="why it is invalid or stale")
    at_s: float | None = Field(None, description="bench time of the reading in s")
    at: datetime | None = Field(None, description="instant of the reading by the clock of the bench")


class Event(Message):
    """Entry of the journal of a run."""

    id: str = Field(description=f"RUN:SEQ; {_ID}")
    run: str = Field(description=_RUN)
    seq: int = Field(description="number in the journal, from 1, without gaps")
    kind: str
    step: str
    at_s: float = Field(description="bench time in s")
    at: datetime | None = Field(description="instant by the clock of the bench")
    data: Mapping[str, Any] = Field(
        description="facts of the entry; `omitted_bytes` alone if they are longer than 64 KiB"
    )
    is_historical: bool = _HISTORICAL


class Alarm(Message):
    """Entry of the journal that needs a person."""

    id: str = Field(description=f"RUN:SEQ; {_ID}")
    run: str = Field(description=_RUN)
    seq: int = Field(description="number in the journal")
    kind: str
    text: str = Field(description="what has happened")
    step: str
    at: datetime | None = Field(description="instant by the clock of the bench")
    is_historical: bool = _HISTORICAL


class Bounds(Message):
    """Limits of a result; null where it has none."""

    min: float | None = None
    max: float | None = None


class Finding(Message):
    """Result with its expanded uncertainty."""

    id: str
    uut: str = Field("", description="serial number of the unit")
    quantity: str
    name: str = ""
    at: Mapping[str, Any] = Field(default_factory=dict, description="where in the run, such as the temperature")
    value: float | None
    unit: str = ""
    k: float | None = Field(None, description="coverage factor")
    expanded: float | None = Field(None, description="expanded uncertainty U")
    limits: Bounds | None = None
    verdict: str | None = None


class Results(Message):
    """End of a run. It is sent again when the run is reduced again."""

    id: str = Field(description=f"RUN:results; {_ID}")
    run: str = Field(description=_RUN)
    outcome: str = Field(description="how it ended, such as `completed`, `stopped` or `aborted`")
    verdict: str | None
    title: str
    sequence: str
    units: tuple[str, ...] = Field(description="serial numbers")
    ended: str | None = Field(description="instant by the clock of the bench")
    findings: tuple[Finding, ...] = Field(description="as many as fit into 64 KiB")
    findings_omitted: int = 0
    is_historical: bool = _HISTORICAL


class Command(BaseModel):
    """Command to a run, on the topic of its sender. It is refused if it is retained, repeated or older than 30 s."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    command: Literal["pause", "stop", "abort"]
    run: str = Field(min_length=1, max_length=200, description=_RUN)
    nonce: str = Field(pattern=r"^[A-Za-z0-9_-]{8,64}$", description="8 to 64 random letters and digits, once each")
    at: datetime = Field(description="instant at which it was sent, with its time zone")


class Reply(Message):
    """Answer to a command."""

    nonce: str = Field(description="of the command; empty if that could not be read")
    done: bool
    text: str = Field(description="answer of the run, or why the command was refused")
    at: datetime
