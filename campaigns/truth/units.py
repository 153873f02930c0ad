"""Every method on units that differ in kind, held against the truth; `bench campaign truth` gives the cells to workers.

    python -m campaigns.truth.units --seeds 8 --method M4a --kind warm
    python -m campaigns.truth.units --seeds 40             # stopped, it goes on where it was
    python -m campaigns.truth.units --seeds 40 --decide    # what fails is decided by 400 fresh seeds

Each cell has seeds of its own. Of hundreds of figures some are beyond their bars by chance with 40 seeds. One that is
beyond is repeated with fresh seeds, and these alone decide.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from campaigns.truth.bars import judged, problems
from campaigns.truth.cells import METHODS, RECORDS, WIRES, Cell, Line, kept, known, run
from campaigns.truth.foreign import FORMS

FRESH_FROM = 1000
DECIDING = 400
WIRED_SEEDS = 3
FOREIGN = [form for form in FORMS if form != "normal"]


def cells(methods: Sequence[str], kinds: Sequence[str], forms: Sequence[str], levels: Sequence[str]) -> Iterator[Cell]:
    """The cells of a campaign; all kinds with normal errors, and the shipped unit with each foreign form of them."""
    for name in methods:
        method = METHODS[name]
        for kind in [each for each in method.kinds if not kinds or each in kinds]:
            for form in [each for each in forms if each == "normal" or kind == "as shipped" or kinds]:
                if RECORDS in levels and method.at_records:
                    yield Cell(name, kind, form, RECORDS)
                if WIRES in levels and form == "normal":
                    yield Cell(name, kind, form, WIRES)


def decided(cell: Cell, seeds: int, options: argparse.Namespace, folder: Path) -> tuple[list[Line], list[str]]:
    """The lines that decide a cell, and what is beyond its bars; a cell that fails gets fresh seeds."""
    count = min(seeds, WIRED_SEEDS) if cell.level == WIRES else seeds
    lines = run(cell, cell.seeds(count), folder, options.records, options.processes)
    found = problems(cell, lines) if cell.level == RECORDS else far_off(lines)
    if found and options.decide and cell.level == RECORDS and not any(line.problem for line in lines):
        lines = run(cell, cell.seeds(options.decide, FRESH_FROM), folder, options.records, options.processes)
        found = [each for each in problems(cell, lines) if each.split(":")[0] in {e.split(":")[0] for e in found}]
    return lines, found


def far_off(lines: Sequence[Line]) -> list[str]:
    """Large deviations for few seeds: values beyond five times their uncertainty, and runs without a result."""
    told = [f"seed {line.seed}: {line.problem}" for line in lines if line.problem]
    return told + [
        f"seed {line.seed}: {each.quantity} is {each.ratio:+.1f} u off"
        for line in lines
        for each in line.found
        if each.u and abs(each.ratio) > 5 and not each.interval[0] <= each.truth <= each.interval[1]
    ]


def main() -> int:
    """Run or list the cells, a line for each; 1 when one is beyond its bars."""
    options = _options()
    failed = 0
    with tempfile.TemporaryDirectory() as temporary:
        for cell in cells(options.method or list(METHODS), options.kind, options.form, options.level):
            if options.table:
                lines = known(cell, options.records)
                found = problems(cell, lines) if cell.level == RECORDS else far_off(lines)
            else:
                lines, found = decided(cell, options.seeds, options, Path(temporary))
            if lines:
                print(row(cell, lines, found), flush=True)
                failed += bool(found)
            if options.figures:
                print("\n".join(figures(cell, lines)), flush=True)
    print("truth on altered units: " + (f"{failed} cells FAILED" if failed else "ok"))
    return 1 if failed else 0


def row(cell: Cell, lines: Sequence[Line], found: Sequence[str]) -> str:
    """A line of a table: the cell, its seeds, the figures furthest from where they should be, and what is wrong."""
    return " | ".join(["", *columns(cell, lines), "; ".join(found) or "ok", ""]).strip()


def columns(cell: Cell, lines: Sequence[Line]) -> list[str]:
    """Method, unit, errors of the bench, seeds, rms(error/u) from to, least coverage by U, intervals held from to."""
    every = list(judged(cell, lines))
    rms = [each.rms for each in every if each.held is None]
    held = [each.held for each in every if each.held is not None]
    least = min((each.covered for each in every if each.held is None), default=1.0)
    return [
        cell.method, cell.kind, cell.form, f"{len(lines)} {cell.level}",
        f"{min(rms):.2f} … {max(rms):.2f}" if rms else "-", f"{least:.0%}",
        f"{min(held):.0%} … {max(held):.0%}" if held else "-",
    ]  # fmt: skip


def figures(cell: Cell, lines: Sequence[Line]) -> Iterator[str]:
    """A line for each quantity of a cell."""
    for each in judged(cell, lines):
        held = "" if each.held is None else f"  held {each.held:.0%}"
        told = f"  {each.quantity:<34} n {each.values:>3}  rms(error/u) {each.rms:7.3f}  U covers {each.covered:.0%}"
        yield f"{told}{held}  {each.problem}"


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--method", choices=sorted(METHODS), action="append")
    parser.add_argument("--kind", action="append", default=[], help="of unit; all without it")
    parser.add_argument("--form", choices=sorted(FORMS), nargs="+", default=list(FORMS), help="of the bench's errors")
    parser.add_argument("--level", choices=(RECORDS, WIRES), nargs="+", default=[RECORDS, WIRES])
    parser.add_argument("--records", type=Path, default=kept(), help="where what is found is kept")
    parser.add_argument("--decide", type=int, nargs="?", const=DECIDING, default=0, metavar="SEEDS")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--figures", action="store_true", help="every quantity of each cell")
    parser.add_argument("--table", action="store_true", help="run nothing; show what is known")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
