"""How cost grows with the size of a task: `python -m benchmarks.growth [--page] [--short] [--only steps]`.

Processor time and memory of whole processes against hours of a night, frames a second, steps, units and viewers. A line
and a power are fitted to each. Figures are kept in benchmarks/growth.json; --page writes them and the picture into
docs/explanation/performance.md.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bench.figures.svg import as_document, drawing, new_figure
from benchmarks import station_viewers, wide_bench
from benchmarks.__main__ import ROOT, machine
from benchmarks.cost import Cost, cost_of
from benchmarks.rows.ingest import OURS, read

KEPT = Path(__file__).parent / "growth.json"
PAGE = ROOT / "docs" / "explanation" / "performance.md"
PICTURE = ROOT / "docs" / "images" / "growth.svg"
BEGIN, END = "<!-- growth: begin -->", "<!-- growth: end -->"
ROUNDS = 3
POWERS = np.arange(0.3, 2.005, 0.01)

NIGHT = """\
schema: itb-sequence/1
title: A night
needs: {{head: positioner, counter: pulse_counter}}
steps:
  - repeat: {count}
    steps:
      - for_each: position
        in: [1°, 91°, 181°, 271°]
        steps:
          - {{move: head, to: "${{position}}"}}
          - {{wait: 9 min}}
          - {{acquire: counter, for: 350 s, label: night}}
"""
STEPS = """\
schema: itb-sequence/1
title: Steps
needs: {{}}
steps:
  - repeat: {count}
    steps: [note: Nothing.]
"""


@dataclass(frozen=True)
class Growth:
    """One size and what it costs: `sizes` (N,) and, for each kind of cost, values (N,)."""

    size: str
    cost: str
    sizes: tuple[float, ...]
    processor: tuple[float, ...]
    memory: tuple[float, ...] = ()


class Fit(NamedTuple):
    """A line through costs, the largest deviation from it relative to the cost, and the power that fits best."""

    begin: float
    each: float
    off_line: float
    power: float


@dataclass(frozen=True)
class Task:
    """A quantity that is varied: values for a short and for a whole measurement, and the function that measures it."""

    size: str
    cost: str
    short: tuple[int, ...]
    whole: tuple[int, ...]
    measure: Callable[[Sequence[int]], Sequence[Cost]]


def fitted(sizes: Sequence[float], costs: Sequence[float]) -> Fit:
    """Fit `begin + each · size` and `begin + each · size^power`, deviations relative to the costs."""
    x, y = np.asarray(sizes, np.float64), np.asarray(costs, np.float64)
    begin, each, residuals = _line(x, y)
    power = min(POWERS, key=lambda power: float(np.square(_line(x**power, y)[2]).sum()))
    return Fit(begin, each, float(np.abs(residuals).max()), float(power))


def _line(x: np.ndarray, y: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Begin and slope of a line that begins at no cost below 0, and relative residuals (N,)."""
    terms = np.stack([np.ones_like(x), x], axis=1) / y[:, None]
    begin, each = np.linalg.lstsq(terms, np.ones_like(y))[0]
    if begin < 0:
        begin, each = 0.0, float(np.linalg.lstsq(terms[:, 1:], np.ones_like(y))[0][0])
    return float(begin), float(each), (begin + each * x) / y - 1


def run_cost(sequence: str, bench: str | Path = "simulated", units: Sequence[str] = ()) -> Cost:
    """What a run in virtual time costs."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sequence.yaml"
        path.write_text(sequence, "utf-8")
        placed = [part for place in units for part in ("--uut", f"{place}=QF-{place}")]
        given = ["--bench", str(bench), "--runs", f"{folder}/runs", "--no-report", *placed]
        return cost_of([sys.executable, "-m", "bench", "run", str(path), *given])


def of_hours(hours: Sequence[int]) -> Sequence[Cost]:
    return [run_cost(NIGHT.format(count=each)) for each in hours]


def of_steps(steps: Sequence[int]) -> Sequence[Cost]:
    return [run_cost(STEPS.format(count=each)) for each in steps]


def of_units(units: Sequence[int]) -> Sequence[Cost]:
    costs = []
    for each in units:
        with tempfile.TemporaryDirectory() as folder:
            bench, places = wide_bench.written(Path(folder), each)
            costs.append(run_cost(NIGHT.format(count=2), bench, places))
    return costs


def of_frames(rates: Sequence[int], seconds: float = 10.0) -> Sequence[Cost]:
    return [Cost(float(read(OURS, "socketcand", rate, seconds)["cpu_s"]) / seconds) for rate in rates]


def of_viewers(viewers: Sequence[int]) -> Sequence[Cost]:
    return [Cost(share) for share in station_viewers.shares(viewers, seconds=20.0)]


TASKS = {  # sizes of a short measurement, and of a whole one
    "hours": Task("hours of a night, 10 latches/s", "s", (1, 4), (1, 2, 4, 8, 16, 32, 64, 128), of_hours),
    "frames": Task("frames/s of a CAN bus", "cores", (1000, 8000), (500, 1000, 2000, 4000, 8000, 16000), of_frames),
    "steps": Task("steps", "s", (100, 2000), (100, 500, 1000, 2000, 4000, 8000), of_steps),
    "units": Task("units on a bench, a night of 2 h", "s", (1, 3), (1, 2, 3, 6, 9), of_units),
    "viewers": Task("viewers of a page", "cores", (0, 2), (0, 1, 2, 5, 10, 20), of_viewers),
}  # fmt: skip


def measured(task: Task, *, short: bool) -> Growth:
    """Costs of all sizes: the least of some rounds, since other programs only add to it."""
    sizes = task.short if short else task.whole
    rounds = [task.measure(sizes) for _ in range(1 if short else ROUNDS)]
    processor = tuple(min(each.processor for each in costs) for costs in zip(*rounds, strict=True))
    memory = tuple(min(each.memory or 0.0 for each in costs) for costs in zip(*rounds, strict=True))
    return Growth(task.size, task.cost, tuple(map(float, sizes)), processor, memory if all(memory) else ())


def table(growths: Sequence[Growth]) -> str:
    """A line for each cost, as Markdown."""
    lines = [
        "| grows with | cost | smallest | largest | line | off the line | power |",
        "|---|---|---|---|---|---|---|",
    ]
    for each in growths:
        lines.append(_line_of(each, "processor", each.cost, each.processor))
        if each.memory:
            lines.append(_line_of(each, "memory", "MB", each.memory))
    return "\n".join(lines)


def _line_of(growth: Growth, kind: str, unit: str, costs: Sequence[float]) -> str:
    fit = fitted(growth.sizes, costs)
    ends = [f"{size:,.0f}: {cost:.3g} {unit}" for size, cost in ((growth.sizes[at], costs[at]) for at in (0, -1))]
    few = len(costs) < 4
    line = f"{fit.begin:.3g} + {fit.each:.2g} each"
    shown = [growth.size, kind, *ends, line, "–" if few else f"{fit.off_line:.0%}", "–" if few else f"{fit.power:.2f}"]
    return f"| {' | '.join(shown)} |"


def picture(growths: Sequence[Growth]) -> str:
    """Costs over sizes with their lines, as a document of SVG."""
    with drawing():
        figure = new_figure(1.9 * len(growths))
        figure.subplots_adjust(hspace=0.55, wspace=0.25, top=0.97, bottom=0.05)
        for at, each in enumerate(growths):
            parts = {f"processor / {each.cost}": each.processor, "memory / MB": each.memory}
            for column, (label, costs) in enumerate(parts.items()):
                if not costs:
                    continue
                axes, fit = figure.add_subplot(len(growths), 2, 2 * at + column + 1), fitted(each.sizes, costs)
                axes.plot(each.sizes, costs, "o", color="#0b5394", markersize=4, clip_on=False)
                ends = np.array([0.0, max(each.sizes)])
                axes.plot(ends, fit.begin + fit.each * ends, color="#777777")
                axes.set(xlabel=each.size, ylabel=label, ylim=(0, None))
        return as_document(figure)


def into_page(known: Mapping[str, object], growths: Sequence[Growth]) -> None:
    """Write the figures between the marks of the page, and the picture beside it."""
    before, _, rest = PAGE.read_text("utf-8").partition(BEGIN)
    body = f"{BEGIN}\nMeasured on {known['date']}: {known['machine']}.\n\n{table(growths)}\n\n"
    body += f"![Costs over sizes, with their lines](../images/{PICTURE.name})\n"
    PAGE.write_text(f"{before}{body}{END}{rest.partition(END)[2]}", "utf-8")
    PICTURE.write_text(picture(growths), "utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--page", action="store_true", help="write the figures into the page")
    parser.add_argument("--short", action="store_true", help="few sizes, to see that it works")
    parser.add_argument("--only", action="append", choices=tuple(TASKS), default=[])
    asked = parser.parse_args()
    known = json.loads(KEPT.read_text("utf-8")) if KEPT.exists() and not asked.short else {"growths": {}}
    for name in asked.only or TASKS:
        found = measured(TASKS[name], short=asked.short)
        print(table([found]), flush=True)
        known["growths"][name] = asdict(found)
        known |= {"date": f"{datetime.now(UTC):%Y-%m-%d}", "machine": machine()}
        if not asked.short:
            KEPT.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n", "utf-8")
    if asked.page:
        growths = [Growth(**known["growths"][name]) for name in TASKS if name in known["growths"]]
        into_page(known, growths)


if __name__ == "__main__":
    main()
