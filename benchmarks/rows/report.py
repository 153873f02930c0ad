"""P10: the report of an inertial unit over temperature, as a page and as PDF; no program is its peer."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from bench.app.execute import execute
from bench.app.request import RunRequest, prepare
from bench.runner.quiet import Quiet
from benchmarks.compared import Row, Side, in_turn
from benchmarks.cost import cost_of

BENCH = Path(__file__).parents[2] / "config" / "imu.yaml"
GOALS_S = {"html": 2.0, "pdf": 8.0}


def measure(_whole: bool) -> Iterator[Row]:
    """Processor seconds of the command that reads the record of a whole night, reduces it and writes."""
    with tempfile.TemporaryDirectory() as folder:
        request = RunRequest("imu_24_position", bench=str(BENCH), runs=Path(folder))
        result = execute(prepare(request), Quiet())
        run = next(each for each in Path(folder).iterdir() if each.is_dir())
        if result.outcome.how != "completed":
            raise RuntimeError("\n".join(result.problems))
        found = in_turn({form: lambda form=form: written_s(run, form) for form in GOALS_S})  # type: ignore[misc]  # mypy knows no default of a lambda
    for form, goal_s in GOALS_S.items():
        side = Side("this program", "replaced as a whole", found[form])
        work = f"report of an inertial unit over temperature as {form}, a night of 37 h"
        yield Row("P10", work, "s of a processor", side, (), "", f"≤ {goal_s:g} s", side.value <= goal_s)


def written_s(run: Path, form: str) -> float:
    """Processor seconds of `bench report`, as a whole process, which writes the report beside the run."""
    out = run.parent / f"report.{form}"
    out.unlink(missing_ok=True)
    cost = cost_of([sys.executable, "-m", "bench", "report", run, "--format", form, "--out", out])
    assert out.stat().st_size
    return cost.processor
