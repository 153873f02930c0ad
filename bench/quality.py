"""Quality of a reading as its type: only what is valid can be judged, stored as a value or averaged.

A driver gives `Reading`s. `bench.engine.channel.Channel` makes each of them a `Valid` or an `Invalid`; nothing else
makes a `Valid`, a `Fresh` or a `Window`. An `Invalid` and a `Stale` have no number to compare with.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray


class Valid(NamedTuple):
    """An accepted reading: loop time, value in the unit of its channel, and its number among all that were read."""

    at_s: float
    value: float
    number: int


class Invalid(NamedTuple):
    """A rejected reading. `why` follows the name of the channel in a sentence; `raw` is the value as text."""

    at_s: float
    why: str
    number: int
    raw: str


class Stale(NamedTuple):
    """No valid reading that is recent enough. `why` follows the name of the channel; `age_s` is inf without any."""

    why: str
    age_s: float


class Fresh(NamedTuple):
    """The newest reading, which is valid, and its age (s)."""

    reading: Valid
    age_s: float


class Window(NamedTuple):
    """Valid readings in the order of their times, at least one, without a gap: times (N,) and values (N,)."""

    at_s: NDArray[np.float64]
    values: NDArray[np.float64]


Judged: TypeAlias = Valid | Invalid
Absent: TypeAlias = Invalid | Stale
Latest: TypeAlias = Fresh | Absent
