"""Record of lost latches or samples of an acquisition."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Self


@dataclass(frozen=True, slots=True)
class Gap:
    """A row of lost numbers between two received ones.

    Numbers are those of the acquisition, unwrapped. `from_s` and `to_s` are the bench times of arrival before and after
    it, None if there was none; `device_s` is the time between them by the device's clock, modulo its period.
    """

    first: int
    last: int
    from_s: float | None
    to_s: float | None
    device_s: float | None


@dataclass(frozen=True, slots=True)
class Missed:
    """Losses of one channel during one acquisition: `lost` of `expected`, in `gaps` gaps.

    `listed` are the first of the gaps, at most MOST_LISTED. `unusable` is the reason why the mean over the acquisition
    is not used; empty if the losses do not affect it.
    """

    what: Literal["latches", "samples"]
    gaps: int
    lost: int
    expected: int
    listed: tuple[Gap, ...]
    unusable: tuple[str, ...]

    @classmethod
    def of_json(cls, content: Mapping[str, Any]) -> Self:
        """Read the content of a JSON object written from `dataclasses.asdict`."""
        listed = tuple(Gap(**gap) for gap in content["listed"])
        return cls(**{**content, "listed": listed, "unusable": tuple(content["unusable"])})
