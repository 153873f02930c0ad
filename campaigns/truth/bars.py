"""The bars of the campaign on altered units, and what a cell comes to by them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from scipy.stats import binom

from campaigns.truth.campaign import Comparison
from campaigns.truth.cells import Cell, Line
from campaigns.truth.judge import rms_of

RMS = (0.7, 1.35)  # of error/u, where errors follow the budget
HELD = (0.90, 0.99)  # of the intervals of largest values
BY_CHANCE = 0.05  # that intervals which hold in 99 % hold as often as they did: 40 of 40 are no proof of more
COVERED = 0.95  # of the expanded uncertainties, where errors of the bench are foreign to the budget, chance apart
BRACKETS = ("threshold", "resolution")  # between two steps of a ladder, which hold whatever the noise is


@dataclass(frozen=True)
class Judged:
    """Judgement of one quantity of a cell; `problem` is empty where it is within its bar."""

    quantity: str
    values: int
    rms: float
    covered: float
    held: float | None
    problem: str


def judged(cell: Cell, lines: Sequence[Line]) -> Iterator[Judged]:
    """Every quantity of a cell, one value of each a seed: those of one run share the errors of its bench."""
    found: dict[str, list[Comparison]] = {}
    for line in lines:
        own: dict[str, list[Comparison]] = {}
        for each in line.found:
            if each.u:
                own.setdefault(each.quantity, []).append(each)
        for quantity, points in own.items():
            found.setdefault(quantity, []).append(points[line.seed % len(points)])
    for quantity, values in found.items():
        rms, covered = rms_of(values), sum(each.covered for each in values) / len(values)
        held = sum(each.held for each in values) / len(values) if _is_largest(values) else None
        yield Judged(
            quantity, len(values), rms, covered, held, _problem(cell, quantity, len(values), rms, covered, held)
        )


def _is_largest(values: Sequence[Comparison]) -> bool:
    return any(math.isfinite(end) for each in values for end in each.interval)


def _problem(cell: Cell, quantity: str, values: int, rms: float, covered: float, held: float | None) -> str:
    if held is not None:
        too_often = float(binom.sf(round(held * values) - 1, values, HELD[1])) < BY_CHANCE and quantity not in BRACKETS
        return f"{held:.1%} of the intervals hold the truth" if held < HELD[0] or too_often else ""
    if cell.form != "normal":
        by_chance = 2 * math.sqrt(COVERED * (1 - COVERED) / values)
        return "" if covered >= COVERED - by_chance else f"U covers {covered:.1%}"
    return "" if RMS[0] <= rms <= RMS[1] else f"rms(error/u) {rms:.2f}"


def problems(cell: Cell, lines: Sequence[Line]) -> list[str]:
    """All that is beyond the bars of a cell, runs that came to no result, or to less than others, first."""
    bad = [line for line in lines if line.problem]
    told = [f"{len(bad)} of {len(lines)} seeds: {bad[0].problem}"] if bad else []
    every = {each.quantity for line in lines for each in line.found}
    lacking = {line.seed: every - {each.quantity for each in line.found} for line in lines if not line.problem}
    if without := {seed: names for seed, names in lacking.items() if names}:
        seed, names = next(iter(without.items()))
        told.append(f"{len(without)} of {len(lines)} seeds lack findings, {seed} {', '.join(sorted(names))}")
    return told + [f"{each.quantity}: {each.problem}" for each in judged(cell, lines) if each.problem]
