"""Cross coupling of input and output axis and misalignment towards Y, from a unit on both of its sides (equations 3.4).

A unit that is rotated by 90° about its input axis has Y where Z was. The output is then that of equations 3.3 with the
specific force along Y in place of that along Z, so that the lines of both sides, +Y up and +Y down, are reduced as
those of both ends.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from bench.methods.indexing.reduction.calibrate import StaticCalibration
from bench.methods.indexing.reduction.estimates import IndexingEstimates
from bench.metrology.results.finding import Finding, Subject
from bench.metrology.results.flag import Flag


@dataclass(frozen=True)
class SideFindings:
    """Results of the sides of one unit: `found` and `estimates` are those of its readings there, Y in place of Z."""

    subject: Subject
    found: StaticCalibration
    estimates: IndexingEstimates

    def findings(self) -> Iterator[Finding]:
        """Kio and the misalignment towards Y; none if a side has no line."""
        both = self.estimates.both
        if both is None or both.tilted is None or both.coupling is None:
            return
        warm_c = [each.temperature_c for each in self.estimates.rows if np.isfinite(each.temperature_c)]
        at = {"at_c": float(np.mean(warm_c))} if warm_c else {}
        steps = tuple(dict.fromkeys(each.step.rsplit("/", 2)[0] for each in self.estimates.rows))
        for quantity, name, result, unit in (
            ("Kio", "cross coupling of the input axis and Y", both.coupling / both.scale, "g/g²"),
            ("misalignment_y", "of the input axis towards +Y", both.tilted / both.scale, "rad"),
        ):
            lines = self.estimates.budget.lines(result)
            yield self.subject.finding(quantity, name, result.value, unit, lines, at, steps)

    def flags(self) -> Iterator[Flag]:
        """Readings that were left out, what a reader should know of each side, and a side that is missing."""
        for why, count in self.found.excluded.items():
            if count and why != "unstable":
                yield Flag(f"{{count}} readings: {why}", values={"count": count})
        yield from (replace(note, at=note.at.replace("end", "side")) for note in self.found.notes if "end" in note.at)
        if self.estimates.both is None:
            yield Flag("sides:incomplete")
