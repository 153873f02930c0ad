"""Ambient conditions of a run: the readings that a bench file lists under `site.ambient`."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bench.config.models import BenchFile, ReadingEntry
from bench.figures.languages import tr
from bench.figures.numbers import decimals
from bench.metrology.results.coverage import COVERAGE
from bench.reduce.corrections import corrections_of
from bench.store.reader import RunReader


@dataclass(frozen=True)
class AmbientRange:
    """Least and greatest value of a reading, corrected by its certificate; `expanded` is U, k = 2, if known."""

    name: str
    low: float
    high: float
    unit: str
    expanded: float | None

    @property
    def in_words(self) -> str:
        """Text for a report."""
        digits = decimals(self.expanded) if self.expanded else 1
        low, high = f"{self.low:.{digits}f}", f"{self.high:.{digits}f} {self.unit}"
        span = f"{tr(self.name.replace('_', ' '))} {tr('{low} to {high}', low=low, high=high)}"
        if self.expanded is None:
            return f"{span} ({tr('uncertainty not stated')})"
        return f"{span} (U = {self.expanded:.{digits}f} {self.unit}, k = {COVERAGE:g})"


def ambient_of(reader: RunReader, bench: BenchFile) -> Iterator[AmbientRange]:
    """Yield the range of each ambient reading that has valid values in a run."""
    known = corrections_of(bench)
    for name in bench.site.ambient:
        series = known.temperatures(reader.series(name))
        values = series.values[np.isfinite(series.values)]
        if len(values):
            low, high = float(values.min()), float(values.max())
            yield AmbientRange(name, low, high, series.unit, _expanded(bench.readings[name], low, high))


def _expanded(reading: ReadingEntry, low: float, high: float) -> float | None:
    """Expanded uncertainty anywhere in a range, by the certificate of a reading; None without one."""
    if reading.calibration is None:
        return None
    stated, k = reading.calibration.U, reading.calibration.k
    found = COVERAGE / k * math.hypot(stated.offset, stated.gain * max(abs(low), abs(high)))
    return found or None
