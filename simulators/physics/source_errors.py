"""True current of a precision source: set current with errors of gain, offset and drift."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from simulators.physics.corrections import Array, Table, corrected_current

HOUR_S = 3600.0


@runtime_checkable
class CurrentSource(Protocol):
    """Interface of a simulated source whose current feeds a converter, through `load_ohm` in total."""

    load_ohm: float

    @property
    def feeds_a(self) -> float | None:
        """Set current, without errors; None while its output is off."""


@dataclass(frozen=True, slots=True)
class CurrentErrors:
    """Errors as drawn for one run; gain and offset are those right after the warm-up.

    The drift is `drift_per_h` of the current from then on, and `fresh` times as fast before.
    """

    gain: float = 0.0
    offset_a: float = 0.0
    drift_per_h: float = 0.0
    fresh: float = 5.0
    warm_up_s: float = 7200.0

    def current_a(self, set_a: float, on_s: Array) -> Array:
        """True current after `on_s` of operation."""
        warm_h = (on_s - self.warm_up_s) / HOUR_S
        drifted = self.drift_per_h * np.where(warm_h < 0, self.fresh, 1.0) * warm_h
        return np.asarray(set_a * (1 + self.gain + drifted) + self.offset_a)


@dataclass(frozen=True, slots=True)
class Feed:
    """A source on a bench: the instrument, and its errors. Its power-on is the start of the world.

    Errors are in addition to the corrections of its `table`.
    """

    source: CurrentSource
    errors: CurrentErrors
    table: Table = ((), ())

    def current_a(self, at_s: Array) -> Array:
        """Output current at true times."""
        set_a = self.source.feeds_a
        return (
            np.zeros_like(at_s) if set_a is None else self.errors.current_a(corrected_current(set_a, self.table), at_s)
        )
