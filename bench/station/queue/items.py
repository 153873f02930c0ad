"""Items of a queue: what is to be run, for whom, and what became of it."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from enum import StrEnum
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints

from bench.app.request import RunRequest
from bench.station.names import WORD


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("contains unprintable characters")
    return text


Line = Annotated[str, StringConstraints(max_length=200, strip_whitespace=True), AfterValidator(_printable)]
Short = Annotated[str, StringConstraints(max_length=64, strip_whitespace=True), AfterValidator(_printable)]
Word = Annotated[str, StringConstraints(pattern=f"^{WORD}$")]
PRIORITIES = 9


def _in_utc(instant: datetime) -> datetime:
    if instant.tzinfo is None:
        raise ValueError("give the offset from UTC, such as 2026-01-31T08:00:00Z")
    try:
        return instant.astimezone(UTC)
    except OverflowError:
        raise ValueError("is out of range") from None


Moment = Annotated[datetime, AfterValidator(_in_utc)]


class Submission(BaseModel):
    """Request for a run in the queue of a bench."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    sequence: Word = Field(description="name of a sequence of the station")
    bench: Word = Field(description="name of a bench of the station")
    preset: Word | None = Field(None, description="preset of the sequence")
    settings: Mapping[Word, Line] = Field({}, description="parameters of the sequence, as written in a sequence")
    units: Mapping[Word, Short] = Field({}, description="serial numbers by place of the bench")
    operator: Short = Field("", description="who runs it; default: who submits it")
    order: Line = Field("", description="order that the run is for")
    procedure: Line = Field("", description="test procedure and its revision")
    priority: int = Field(0, ge=-PRIORITIES, le=PRIORITIES, description="higher ones go first")
    not_before: Moment | None = Field(None, description="instant before which it does not begin")
    unattended: bool = Field(False, description="begin only if every line of the preflight is good")
    past_due: Literal["refuse", "mark"] = Field("refuse", description="what to do if a calibration is past due")
    speed: Annotated[str, StringConstraints(pattern=r"^(max|[0-9]{1,6}(\.[0-9]{1,3})?)$")] | None = Field(
        None, description="bench seconds per second, or max; for simulated benches"
    )
    seed: int | None = Field(None, ge=0, lt=2**53, description="seed of the simulation")

    def request(self, **paths: Any) -> RunRequest:
        """Return the request for the run, with the paths of its files."""
        return RunRequest(**paths, **self._common())

    def _common(self) -> dict[str, Any]:
        return {
            "preset": self.preset,
            "settings": tuple(f"{name}={value}" for name, value in self.settings.items()),
            "units": tuple(f"{place}={serial}" for place, serial in self.units.items()),
            "operator": self.operator,
            "order": self.order,
            "procedure": self.procedure,
            "unattended": self.unattended,
            "past_due": self.past_due,
            "speed": self.speed,
            "seed": self.seed,
        }

    def options(self) -> list[str]:
        """Return the options of `bench run` for all but the files."""
        single = {
            "--preset": self.preset, "--operator": self.operator, "--order": self.order, "--speed": self.speed,
            "--procedure": self.procedure, "--past-due": self.past_due, "--seed": self.seed,
        }  # fmt: skip
        words = [f"{name}={value}" for name, value in single.items() if value not in (None, "")]
        words += [f"--set={name}={value}" for name, value in self.settings.items()]
        words += [f"--uut={place}={serial}" for place, serial in self.units.items()]
        return [*words, "--unattended"] if self.unattended else words


class ItemState(StrEnum):
    """State of an item. `queued` and `held` wait; `starting` and `running` occupy the bench; the others are final."""

    QUEUED = "queued"
    HELD = "held"
    STARTING = "starting"
    RUNNING = "running"
    ENDED = "ended"
    REFUSED = "refused"
    CANCELLED = "cancelled"


WAITING = frozenset({ItemState.QUEUED, ItemState.HELD})
OCCUPYING = frozenset({ItemState.STARTING, ItemState.RUNNING})


class Item(BaseModel):
    """Item of the queue. `version` counts its changes; `place` orders items of one priority."""

    model_config = ConfigDict(frozen=True)

    id: str = Field(description="identifier; also the ticket of its run")
    number: int = Field(description="number of the item at this station")
    state: ItemState
    priority: int
    place: float
    version: int = 0
    submission: Submission
    submitted_by: str
    submitted_at: Moment
    inputs: str = Field("", description="digest of the input files that were checked; a run with others is refused")
    expected_s: float = Field(0.0, description="estimated duration in s of bench time")
    attempts: int = Field(0, description="number of times that a run was begun")
    run: str = Field("", description="name of the run directory")
    outcome: str = Field("", description="state of the run at its end")
    verdict: str | None = Field(None, description="verdict of the run")
    held_by: str = Field("", description="person who holds it; empty if nobody does, or the station")
    reason: str = Field("", description="why it is held, refused or cancelled, or what it waits for")
    begun_at: Moment | None = None
    ended_at: Moment | None = None

    @property
    def title(self) -> str:
        """Sequence and units in a few words."""
        return " · ".join([self.submission.sequence, *self.submission.units.values()])
