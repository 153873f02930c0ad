"""Every method on units that differ in kind, and on benches whose errors are not as their budgets assume.

At full scale every cell has 40 seeds, and one beyond its bars is decided by 400 fresh ones: hours. What is found is
kept in build/truth, so that a campaign that was stopped goes on where it was.
"""

from __future__ import annotations

import tempfile
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path

from campaigns.trials.rows import Row
from campaigns.truth.cells import METHODS, RECORDS, WIRES, Cell, kept
from campaigns.truth.foreign import FORMS
from campaigns.truth.units import DECIDING, cells, columns, decided, far_off

SEEDS = 40


def trials(scale: float) -> Iterator[Row]:
    """A row for each method and kind of unit; a sample takes one kind of each method, and few seeds."""
    seeds = max(2, round(SEEDS * scale))
    every = list(cells(list(METHODS), (), list(FORMS), (RECORDS, WIRES)))
    with tempfile.TemporaryDirectory() as temporary:
        options = Namespace(records=kept(), processes=2, decide=DECIDING if scale >= 1 else 0)
        for cell in every if scale >= 1 else _sample(every):
            lines, found = decided(cell, seeds, options, Path(temporary))
            bad = found if scale >= 1 else far_off(lines)
            _, kind, form, _, rms, covered, held = columns(cell, lines)
            what = f"{cell.method}, {kind}" + ("" if form == "normal" else f", bench {form}")
            told = f"rms(error/u) {rms}, U covers {covered}" + ("" if held == "-" else f", intervals hold {held}")
            yield Row(f"{what}, {cell.level}", len(lines), "; ".join(bad) or told, not bad)


def _sample(every: list[Cell]) -> Iterator[Cell]:
    """One cell of each method at the level of records, of another kind from method to method."""
    for number, name in enumerate(METHODS):
        own = [cell for cell in every if (cell.method, cell.form, cell.level) == (name, "normal", RECORDS)]
        if own:
            yield own[number % len(own)]
