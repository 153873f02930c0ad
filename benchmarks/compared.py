"""Figures of both sides of a comparison, taken in turn in one run, and the lines of the table that they make."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any

ROUNDS = 5
FROM_TWICE = "extrapolated from a part; from twice that part:"  # before the value that twice the part gives


@dataclass(frozen=True)
class Side:
    """One program at one work."""

    name: str  # with its version
    durability: str  # "each step on the disk", "at the end", "none"
    values: tuple[float, ...]  # one a round, in the unit of the row

    @property
    def value(self) -> float:
        """Median of all rounds."""
        return median(self.values)


@dataclass(frozen=True)
class Row:
    """One work: this program, its peers at the same work, and what physics or the disk permit."""

    key: str  # "P3"; several rows may share one
    work: str
    unit: str
    ours: Side
    peers: tuple[Side, ...]
    limit: str  # "bare commit of SQLite on this disk: 210 µs"; "" where there is none
    goal: str  # "" where there is none
    is_met: bool
    lower_is_better: bool = True

    def ratio(self, peer: Side) -> float:
        """How many times better this program is than `peer`: median of the ratios of the rounds.

        Infinite where this program costs nothing, or `peer` does not manage any.
        """
        ours, theirs = self.ours.values, peer.values
        if len(ours) != len(theirs):
            ours, theirs = (self.ours.value,), (peer.value,)
        if self.lower_is_better:
            ours, theirs = theirs, ours
        return median(each / other if other else math.inf for each, other in zip(ours, theirs, strict=True))

    def as_data(self) -> dict[str, Any]:
        """The row for `results.json`, with the ratios."""
        return {**asdict(self), "ratios": {each.name: self.ratio(each) for each in self.peers}}


def in_turn(sides: Mapping[str, Callable[[], float]], rounds: int = ROUNDS) -> dict[str, tuple[float, ...]]:
    """Figures of every side, one a round; the sides alternate, so that a slow minute of the machine meets them all."""
    found: dict[str, list[float]] = {name: [] for name in sides}
    for _ in range(rounds):
        for name, measure in sides.items():
            found[name].append(measure())
    return {name: tuple(values) for name, values in found.items()}


def table(rows: Sequence[Row]) -> str:
    """All rows as a Markdown table, a line for each peer."""
    lines = [
        "| | work | this program | peer | ratio | limit | goal |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        ours = f"{_shown(row.ours.value)} {row.unit} ({row.ours.durability})"
        verdict = f"{row.goal}: {'met' if row.is_met else '**not met**'}" if row.goal else "–"
        for at, peer in enumerate(row.peers or (None,)):
            first = (row.key, row.work, ours) if at == 0 else ("", "", "")
            beside = f"{peer.name}: {_shown(peer.value)} {row.unit} ({peer.durability})" if peer else "–"
            ratio = f"{_shown(row.ratio(peer))} ×" if peer else "–"
            last = (row.limit or "–", verdict) if at == 0 else ("", "")
            lines.append("| " + " | ".join((*first, beside, ratio, *last)) + " |")
    return "\n".join(lines)


def _shown(value: float) -> str:
    if math.isinf(value):
        return "∞"
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"
