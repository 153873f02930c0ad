"""Kind `truth`: results of all methods against their truth, over units, forms of errors of the bench, and seeds.

The cells are those of `campaigns.truth.units`; the commands are the other parts of `make truth`.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.campaign.isolation import isolate
from bench.campaign.tasks import Known, Task
from bench.errors import InputError
from campaigns.kinds import commands
from campaigns.truth.bars import problems
from campaigns.truth.cells import METHODS, RECORDS, WIRES, Cell, Line, lines_of
from campaigns.truth.foreign import FORMS
from campaigns.truth.units import FRESH_FROM, WIRED_SEEDS, far_off, figures, row
from campaigns.truth.units import cells as cells_of
from drivers.schema.suggest import did_you_mean

CELLS = "units"
COMMANDS = {  # each in one process
    "tumble": "truth --seeds 40 --processes 1",  # static tumble, through all wires
    "indexing": "truth.indexing --seeds 40 --processes 1",  # through all wires: 5 s a seed and bench, 7 min
    "imu": "truth.imu --seeds 40 --processes 1",  # records: 5 s, 8 min
    "channel": "truth.channel --seeds 40 --processes 1",  # records: 2 s, 4 min
    "ramp": "truth.ramp --seeds 40 --processes 1",  # records: 4 s, 6 min
    "repeatability": "truth.repeatability --seeds 40 --processes 1",  # through all wires
    "resumed": "truth.resumed --seeds 40 --processes 1",  # through all wires, killed and resumed: 30 s, 20 min
    "imu_start_up": "truth.imu_start_up --seeds 20 --processes 1",
    "table": "truth.table --seeds 40 --processes 1",  # records: 11 s, 18 min, three seeds through all wires
    "ladder": "truth.ladder --seeds 20",
}
PARTS = (*COMMANDS, CELLS)


@dataclass(frozen=True)
class Truth:
    """Campaign of cells with so many seeds each, and of commands by name.

    A cell at the level of records that is beyond its bars is decided by `decide` fresh seeds; 0 leaves it. `block` is
    how many of its seeds are one task.
    """

    cells: Sequence[Cell]
    commands: Sequence[Task]
    seeds: int
    decide: int
    block: int
    shows_figures: bool = False
    name: str = "truth"

    def tasks(self, known: Known) -> Sequence[Task]:
        """The tasks of all cells, first those of commands; fresh seeds once a cell has failed."""
        found = list(self.commands)
        for cell in self.cells:
            found += self._first(cell)
        for cell in self.cells:
            if self._is_undecided(cell, known):
                found += self._fresh(cell)
        return found

    def lines(self, known: Known, out: Path) -> Iterator[str]:
        """What commands printed, and a row for each cell."""
        yield from commands.lines(self.commands, known)
        failed = 0
        for cell in self.cells:
            lines, found = self._decided(cell, known)
            if not lines:
                continue
            failed += bool(found)
            yield row(cell, lines, found)
            if self.shows_figures:
                yield from figures(cell, lines)
        yield "truth on altered units: " + (f"{failed} cells FAILED" if failed else f"{len(self.cells)} cells ok")

    def exit_code(self, known: Known) -> int:
        """Return 1 if a cell is beyond its bars, or a command has failed."""
        is_beyond = any(self._decided(cell, known)[1] for cell in self.cells)
        return 1 if is_beyond or commands.failed(self.commands, known) else 0

    def _first(self, cell: Cell) -> Sequence[Task]:
        count = min(self.seeds, WIRED_SEEDS) if cell.level == WIRES else self.seeds
        return _tasks(cell, cell.seeds(count), 1 if cell.level == WIRES else self.block)

    def _fresh(self, cell: Cell) -> Sequence[Task]:
        return _tasks(cell, cell.seeds(self.decide, FRESH_FROM), self.block)

    def _is_undecided(self, cell: Cell, known: Known) -> bool:
        """True for a cell that fresh seeds decide: of all its lines there is a result, and some figure is beyond."""
        first = self._first(cell)
        lines = _lines(first, known)
        whole = all((result := known(task)) is not None and result.is_finished for task in first)
        is_decidable = self.decide and cell.level == RECORDS and whole and not any(line.problem for line in lines)
        return bool(is_decidable and problems(cell, lines))

    def _decided(self, cell: Cell, known: Known) -> tuple[list[Line], list[str]]:
        """The lines that decide a cell, and what is beyond its bars."""
        lines = _lines(self._first(cell), known)
        found = (problems(cell, lines) if cell.level == RECORDS else far_off(lines)) if lines else []
        if self._is_undecided(cell, known) and (fresh := _lines(self._fresh(cell), known)):
            beyond = {each.split(":")[0] for each in found}
            return fresh, [each for each in problems(cell, fresh) if each.split(":")[0] in beyond]
        return lines, found


def campaign(
    *, parts: Sequence[str], methods: Sequence[str], kinds: Sequence[str], forms: Sequence[str],
    levels: Sequence[str], seeds: int, decide: int, block: int, figures: bool,
) -> Truth:  # fmt: skip
    """The campaign of a command line; empty lists stand for all. Raises InputError for an unknown name."""
    narrowed = bool(methods or kinds or forms or levels)
    parts = parts or ([CELLS] if narrowed else list(PARTS))
    every = {kind for method in METHODS.values() for kind in method.kinds}
    for option, given, known in (
        ("--part", parts, PARTS), ("--method", methods, METHODS), ("--unit", kinds, every), ("--form", forms, FORMS),
        ("--level", levels, (RECORDS, WIRES)),
    ):  # fmt: skip
        for each in given:
            if each not in known:
                raise InputError(
                    f"{option} {each}: unknown, expected {', '.join(sorted(known))}{did_you_mean(each, known)}"
                )
    chosen = cells_of(methods or list(METHODS), kinds, forms or list(FORMS), levels or (RECORDS, WIRES))
    found = [commands.task_of(name, COMMANDS[name]) for name in parts if name != CELLS]
    return Truth(list(chosen) if CELLS in parts else [], found, seeds, decide, block, figures)


def _tasks(cell: Cell, seeds: range, block: int) -> Sequence[Task]:
    of_cell = {"method": cell.method, "kind": cell.kind, "form": cell.form, "level": cell.level}
    return [
        Task(
            f"{cell.name} {some[0]}-{some[-1]}", "campaigns.kinds.truth:found",
            {**of_cell, "first": some[0], "count": len(some)}, sort=f"{cell.method} {cell.level}",
        )
        for some in (seeds[at : at + block] for at in range(0, len(seeds), block))
    ]  # fmt: skip


def _lines(tasks: Sequence[Task], known: Known) -> list[Line]:
    found = [result for task in tasks if (result := known(task)) is not None and result.is_finished]
    return [Line.of_json(text) for result in found for text in result.content]


def found(method: str, kind: str, form: str, level: str, first: int, count: int) -> list[str]:
    """What each seed of a cell found, as the lines of `campaigns.truth.cells`.

    The template of a cell stays in this process: the next task is likely to be of the same cell.
    """
    cell, folder = Cell(method, kind, form, level), isolate() / "truth"
    if folder.is_dir():
        for other in [each for each in folder.iterdir() if each.name != cell.name] + [folder / cell.name / "runs"]:
            shutil.rmtree(other, ignore_errors=True)
    return [line.to_json() for line in lines_of(cell, range(first, first + count), folder)]
