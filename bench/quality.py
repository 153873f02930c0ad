"""Quality of a reading as its type: only valid readings can be judged, stored as values or averaged.

A driver returns `Reading`s. `bench.engine.channel.Channel` turns each into a `Valid` or an `Invalid`; nothing else
creates a `Valid`, a `Fresh` or a `Window`. An `Invalid` and a `Stale` have no number to compare.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray


class Valid(NamedTuple):
    """Accepted reading: loop time, value in the unit of its channel, and its index among all readings."""

    at_s: float
    value: float
    number: int


class Invalid(NamedTuple):
    """Rejected reading. `why` continues a sentence after the name of the channel; `raw` is the value as text."""

    at_s: float
    why: str
    number: int
    raw: str


class Stale(NamedTuple):
    """No recent valid reading.

    `why` continues a sentence after the name of the channel; `age_s` is inf without any reading.
    """

    why: str
    age_s: float


class Fresh(NamedTuple):
    """Newest valid reading, and its age in s."""

    reading: Valid
    age_s: float


class Window(NamedTuple):
    """Contiguous valid readings in order of time, at least one: times (N,) and values (N,)."""

    at_s: NDArray[np.float64]
    values: NDArray[np.float64]


Judged: TypeAlias = Valid | Invalid
Absent: TypeAlias = Invalid | Stale
Latest: TypeAlias = Fresh | Absent
