"""Latches or samples of an acquisition that did not arrive, as a record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Self


@dataclass(frozen=True, slots=True)
class Gap:
    """A row of numbers that did not come, between two that did.

    Numbers are those of the acquisition, unwrapped. `from_s` and `to_s` are the bench times at which what stands around
    it arrived, None where nothing did; `device_s` is the time between them by the clock that came with them, less the
    whole rounds of that clock.
    """

    first: int
    last: int
    from_s: float | None
    to_s: float | None
    device_s: float | None


@dataclass(frozen=True, slots=True)
class Missed:
    """What did not come of one channel during one acquisition: `lost` of so many `expected`, in so many `gaps`.

    `listed` are the first of the gaps, at most MOST_LISTED. `unusable` is why the mean over the acquisition is not
    used; empty where what did not come takes nothing from it but itself.
    """

    what: Literal["latches", "samples"]
    gaps: int
    lost: int
    expected: int
    listed: tuple[Gap, ...]
    unusable: tuple[str, ...]

    @classmethod
    def of_json(cls, content: Mapping[str, Any]) -> Self:
        """From what `dataclasses.asdict` makes of it."""
        listed = tuple(Gap(**gap) for gap in content["listed"])
        return cls(**{**content, "listed": listed, "unusable": tuple(content["unusable"])})
