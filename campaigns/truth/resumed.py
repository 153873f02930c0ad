"""Runs that were killed and resumed against the simulated truth: `python -m campaigns.truth.resumed --seeds 40`.

Their units have another bias and scale factor after each power-on, by as much as the bench file states. Half of the
runs are killed at a moment drawn from their seed, the others during the readings of a dwell. Results with a line for
power cycles in their budget are compared with the unit without what its power-ons have added, others with the unit as
it was.
All meet the bars of runs that nobody disturbs; without the line those that have it are beyond.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import sys
import tempfile
from collections.abc import Iterator
from itertools import groupby
from multiprocessing import Pool
from pathlib import Path

from bench.app.request import RunRequest, prepare
from campaigns.truth import coefficients, judge
from campaigns.truth.campaign import Comparison, campaign, compared, full_bench, results_of
from tests.support.killed import interrupted, journal, resumed

SOURCE = "power cycles: repeatability of the unit"  # as the budgets call it
SEQUENCE, PRESET = "tumble_static", "quick"
BIAS_UG, SCALE_PPM = 40, 40
COMBINED = (*coefficients.QUANTITIES, "K0/closure")
LEAST_BEYOND = 1.5  # rms(error/u) of what combines both sides, without the line


def stepping_bench(folder: Path, name: str = "simulated", unit: str = "quartz_flexure") -> Path:
    """A shipped bench whose unit steps at each power-on, and that states by how much."""
    path = full_bench(folder, name)
    of_unit = folder / "uut" / f"{unit}.yaml"
    for file, old, new in (
        (of_unit, "  warm_up:", f"  turn_on: {BIAS_UG} µg\n  turn_on_scale: {SCALE_PPM} ppm\n  warm_up:"),
        (of_unit, "  hysteresis: {amplitude: 60 µg", "  hysteresis: {amplitude: 0 µg"),
        (path, "    nominal:", f"    power_cycles: {{bias: {BIAS_UG} µg, scale: {SCALE_PPM} ppm}}\n    nominal:"),
    ):  # fmt: skip
        text = file.read_text("utf-8")
        assert old in text, old
        file.write_text(text.replace(old, new), "utf-8")
    return path


def dwells_s(folder: Path) -> list[tuple[float, float]]:
    """From when to when the readings of each dwell are taken, in a run that nobody disturbs."""
    (path,) = campaign([request(folder, 1)], 1)
    spans = [
        (entry.step.rpartition("/position")[0], entry.data["begin_s"], entry.data["end_s"])
        for entry in journal(path)
        if entry.kind == "step_ended" and "label" in entry.data
    ]
    return [(group[0][1], group[-1][2]) for group in (list(each) for _, each in groupby(spans, lambda span: span[0]))]


def request(folder: Path, seed: int) -> RunRequest:
    """A run on a bench of its own."""
    bench = stepping_bench(folder / f"config{seed}")
    return RunRequest(SEQUENCE, bench=str(bench), preset=PRESET, seed=seed, runs=folder / f"runs{seed}")


def killed_and_resumed(folder: Path, seed: int, dwells: list[tuple[float, float]]) -> Path:
    """The directory of a run that came to its end after an interruption."""
    asked, draw = request(folder, seed), random.Random(seed)
    during = (0.0, prepare(asked).expected.total_s) if seed % 2 else draw.choice(dwells)
    at_s = draw.uniform(*during)
    path = interrupted(folder / f"runs{seed}", at_s, SEQUENCE, asked.bench, preset=PRESET, seed=seed)
    result = resumed(path)
    assert result.outcome.how == "completed", result.problems
    return path


def has_line(finding: dict) -> bool:
    """Return whether it combines both sides of an interruption."""
    return any(line["source"] == SOURCE for line in finding["budget"])


def without_line(finding: dict) -> dict:
    """A finding without what its unit was interrupted by in its uncertainty."""
    left = [line["u"] for line in finding["budget"] if line["source"] != SOURCE]
    return {**finding, "u": math.hypot(*left)}


def of_one_side(truth: dict, results: dict) -> list[Comparison]:
    """Results from one side of an interruption beside the unit as its last power-on had made it."""
    chosen = [each for each in results["findings"] if not has_line(each)]
    return compared(truth, {**results, "findings": chosen})


def of_both_sides(truth: dict, results: dict) -> Iterator[Comparison]:
    """Results that combine both sides beside the unit without what its power-ons have added."""
    own = {key: {**dwell, **_by_itself(dwell)} for key, dwell in truth["dwells"].items()}
    by_itself = {**truth, "dwells": own}
    chosen = [each for each in results["findings"] if has_line(each)]
    yield from compared(by_itself, {**results, "findings": chosen})
    if chosen:
        found = coefficients.compared(by_itself, results)
        yield from (each for each in found if each.quantity in COMBINED)


def _by_itself(dwell: dict) -> dict[str, float]:
    """The constants at a dwell without the steps of the last power-on."""
    bias_g, scale = dwell.get("turned_on_g", 0.0), 1 + dwell.get("turned_on_scale", 0.0)
    k0, drifted_g = dwell["K0"] - bias_g, dwell["drifted_g"] - bias_g
    k1 = {name: dwell[name] / scale for name in ("K1", "K1_si")}
    return {"K0": k0, "drifted_g": drifted_g, "turned_on_g": 0.0, "turned_on_scale": 0.0, **k1}


def _bare(results: dict) -> dict:
    """The results without the line; it is kept by name, so that it is known of which."""
    return {**results, "findings": [without_line(each) if has_line(each) else each for each in results["findings"]]}


def main() -> int:
    """Exit status 1 when a bar is not met."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary, Pool(options.processes, maxtasksperchild=4) as pool:
        dwells = dwells_s(Path(temporary) / "undisturbed")
        wishes = [(Path(temporary), seed, dwells) for seed in range(1, options.seeds + 1)]
        paths = pool.starmap(killed_and_resumed, wishes, chunksize=1)
        found = [(json.loads((path / "truth.json").read_text("utf-8")), results_of(path)) for path in paths]
    one_side = [each for truth, results in found for each in of_one_side(truth, results)]
    both = [each for truth, results in found for each in of_both_sides(truth, results)]
    bare = [each for truth, results in found for each in of_both_sides(truth, _bare(results))]
    print("from one side", *judge.table(one_side), sep="\n")
    firsts = {(each.seed, each.quantity): each for each in reversed(one_side)}  # the dwells of a run share its errors
    problems = [*judge.beyond(judge.by_quantity(firsts.values()), "full")]
    without = judge.by_quantity(bare)
    print("from both sides")
    for name, each in judge.by_quantity(both).items():
        rms, rms_without = judge.rms_of(each), judge.rms_of(without[name])
        print(f"{name:<14} n {len(each):>4}  rms(error/u) {rms:6.3f}, without the line {rms_without:8.3f}")
    print(f"{'all':<14} n {len(both):>4}  rms(error/u) {judge.rms_of(both):6.3f}, without {judge.rms_of(bare):8.3f}")
    problems += judge.beyond({"both sides": both}, "full")
    if judge.rms_of(bare) < LEAST_BEYOND:
        problems.append("both sides: without the line they are within their uncertainty as well")
    for problem in problems:
        print(problem)
    print("resumed runs: " + ("FAILED" if problems else "ok"))
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
