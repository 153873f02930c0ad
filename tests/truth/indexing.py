"""The calibration on an indexing table against the truth: the same arithmetic on what an ideal bench would have read.

`python -m tests.truth.indexing` runs it with many seeds, on a perfect and on a full bench.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from bench.analysis.indexing_estimates import IndexingEstimates
from bench.analysis.indexing_readings import readings_of
from bench.analysis.indexing_static import _attempts
from bench.app.request import RunRequest
from bench.report.stored import open_run
from bench.sequence.methods.indexing import INDEXING_STATIC
from tests.truth import judge
from tests.truth.campaign import Comparison, campaign, full_bench, perfect_bench, results_of

QUANTITIES = ("K0", "K1", "misalignment", "Kip", "scale_difference", "bias", "bias_corrected", "b3", "b5")


def compare_indexing(folder: Path) -> list[Comparison]:
    """Every figure of a run beside its truth."""
    truth = json.loads((folder / "truth.json").read_text("utf-8"))
    figures = true_figures(folder, truth)
    return [
        Comparison(truth["seed"], 0, found["quantity"], found["value"], figures[found["quantity"]], found["u"])
        for found in results_of(folder)["findings"]
        if found["quantity"] in QUANTITIES
    ]


def true_figures(folder: Path, truth: dict) -> dict[str, float]:
    """The figures by the definitions of methods.md 3.4, from the noiseless outputs on an ideal bench."""
    with open_run(folder) as run:
        data = run.data("indexing")
        (entry,) = run.sequence.results
    settings = INDEXING_STATIC.settings.model_validate(entry.settings).model_dump()
    (unit,) = data.units
    readings = [
        dataclasses.replace(each, output=truth["outputs"][f"indexing/{unit.place}@{each.step}"])
        for each in readings_of(data, unit)[0]
    ]
    last = _attempts(readings, unit, settings)[-1]
    estimates = IndexingEstimates(data, unit, last.readings, last.found, [], None)
    both = estimates.both
    (_, up), (_, down) = estimates.line("up"), estimates.line("down")
    scale = both.scale.value
    return {
        "K0": both.bias.value / scale,
        "K1": scale,
        "misalignment": both.tilted.value / scale,
        "Kip": both.coupling.value / scale,
        "scale_difference": (up.value - down.value) / scale,
        "bias": both.bias.value,
        "bias_corrected": both.bias.value,
        "b3": scale * math.radians(truth["bench"]["level_deg"]),
        "b5": scale * head_rad(truth["bench"]),
    }


def head_rad(bench: dict) -> float:
    """By how much the errors of the head raise the input axis while it says 0°."""
    (head,) = bench["axes"].values()
    return math.radians(head["zero_deg"] + sum(head["cosines"]))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bench", default="indexing", help="indexing, or indexing_pulses")
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    problems = []
    with tempfile.TemporaryDirectory() as temporary:
        for name, make in (("perfect", perfect_bench), ("full", full_bench)):
            bench = make(Path(temporary) / name, options.bench)
            requests = [
                RunRequest(
                    "indexing_static", bench=str(bench), preset="quick", seed=seed, runs=Path(temporary) / "runs"
                )
                for seed in range(1, options.seeds + 1)
            ]
            found = [each for run in campaign(requests, options.processes) for each in compare_indexing(run)]
            print(f"\n{name} bench, {options.seeds} seeds")
            problems += [f"{name}: {problem}" for problem in judged(found, name)]
    print("\n".join(problems) or "\ntruth: ok")
    return 1 if problems else 0


def judged(comparisons: list[Comparison], name: str) -> Iterator[str]:
    """What is beyond the bars; a line is printed for each quantity."""
    found = judge.by_quantity(each for each in comparisons if each.u)
    for quantity, chosen in found.items():
        rms, worst = judge.rms_of(chosen), max(abs(each.ratio) for each in chosen)
        print(f"{quantity:<18} n {len(chosen):>3}  rms(error/u) {rms:.3f}  largest {worst:.2f}")
    yield from judge.beyond(found, name)


if __name__ == "__main__":
    sys.exit(main())
