"""The calibration on an indexing table against the truth: its definitions, put to what an ideal bench would have read.

`python -m campaigns.truth.indexing` runs it with many seeds, on a perfect and on a full bench, and on a
full one with a unit that has hysteresis in its input.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bench.app.request import RunRequest
from campaigns.truth import judge
from campaigns.truth.campaign import Comparison, campaign, full_bench, perfect_bench, results_of

INPUT_HYSTERESIS = "input_hysteresis: {amplitude: 20 µg, thresholds: [1 mg, 2 mg, 4 mg]}"
LOOP = "hysteresis"  # of a unit without, the largest of what noise makes: not judged by its scatter about 0
QUANTITIES = (
    "K0", "K1", "misalignment", "misalignment_y", "Kip", "Kio", "scale_difference", "bias", "bias_corrected", "b3",
    "b5", "verification/offset", "verification/scale",
)  # fmt: skip
AXES = {"a": "x", "b": "y", "c": "z"}  # measured in the places of `indexing_three_axes`
ALIKE_G = 1e-6  # readings at one angle
_BESIDE = re.compile(r"clocking|verification")  # readings that are not swept


def compare_indexing(folder: Path) -> list[Comparison]:
    """Every figure of a run beside its truth."""
    return compared(json.loads((folder / "truth.json").read_text("utf-8")), results_of(folder))


def compared(truth: dict, results: dict) -> list[Comparison]:
    """The same of a truth and of results at hand."""
    places = {found["id"].split("/")[1] for found in results["findings"]}
    figures = {place: true_figures(of_place(truth, place)) for place in places}
    return [
        Comparison.of(truth["seed"], found, figures[found["id"].split("/")[1]][found["quantity"]])
        for found in results["findings"]
        if found["quantity"] in QUANTITIES or (found["quantity"] == LOOP and is_hysteretic(truth))
    ]


def of_place(truth: dict, place: str) -> dict:
    """Truth of the readings of one place; of an instrument of three axes those while its axis was measured."""
    own = re.compile(f"/{place}@(?!.*axis=(?!{AXES.get(place, '')}))")
    kept = {
        name: {key: value for key, value in truth[name].items() if own.search(key)} for name in ("outputs", "forces_g")
    }
    return {**truth, **kept}


def is_hysteretic(truth: dict) -> bool:
    """Return whether the unit has hysteresis in its input."""
    return any(unit["input_hysteresis_g"] for unit in truth["units"].values())


def true_figures(truth: dict) -> dict[str, float]:
    """The figures by the definitions of equations 3.4, from the noiseless outputs on an ideal bench.

    A line over the sine for each end, b and G; both ends together are four linear equations for bias, scale factor,
    c1 δ and c_xz, whose factors are the lines of the cosine and of the sine times the cosine.
    """
    up, down = _line(truth, 1), _line(truth, -1)
    equations = np.block([[np.eye(2), up[:, 1:]], [np.eye(2), -down[:, 1:]]])
    bias, scale, tilted, coupling = np.linalg.solve(equations, np.concatenate([up[:, 0], down[:, 0]])).tolist()
    return {
        **_of_sides(truth),
        **_verified(truth, up[:, 0]),
        "K0": bias / scale,
        "K1": scale,
        "misalignment": tilted / scale,
        "Kip": coupling / scale,
        "scale_difference": (up[1, 0] - down[1, 0]) / scale,
        "bias": bias,
        "bias_corrected": bias,
        "b3": scale * math.radians(truth["bench"]["level_deg"]),
        "b5": scale * head_rad(truth["bench"]),
        LOOP: max(_loop(truth, sense) for sense in (1, -1)) / abs(scale),
    }


def _line(truth: dict, sense: int) -> np.ndarray:
    """Intercept and slope over sin θ of the output, cos θ and sin θ cos θ, (2, 3), of an end in the last pass."""
    keys = _swept(truth, sense)
    sine = np.array([truth["forces_g"][key][0] for key in keys])
    cosine = np.sqrt(1 - sine**2)
    columns = np.stack([[truth["outputs"][key] for key in keys], cosine, sine * cosine], axis=-1)
    design = np.stack([np.ones_like(sine), sine], axis=-1)
    return np.asarray(np.linalg.lstsq(design, columns, rcond=None)[0])


def _of_sides(truth: dict) -> dict[str, float]:
    """Kio and the misalignment towards Y by the symmetry of the outputs with +Y up and +Y down; empty without them.

    At opposite largest angles only the scale factor, odd in the angle, and the cross coupling, odd in the angle and in
    the side, remain of sums and differences; level, only the misalignment, odd in the side. No line is fitted.
    """
    means = {(angle, side): _mean(truth, side, angle) for angle in (-1, 0, 1) for side in (1, -1)}
    if any(output is None for output, _ in means.values()):
        return {}
    level, up, down = ({side: means[angle, side][0] for side in (1, -1)} for angle in (0, 1, -1))
    sine = means[1, 1][1]
    scale = (up[1] - down[1] + up[-1] - down[-1]) / (4 * sine)
    coupling = (up[1] - down[1] - up[-1] + down[-1]) / (4 * sine * math.sqrt(1 - sine**2))
    return {"Kio": coupling / scale, "misalignment_y": (level[1] - level[-1]) / 2 / scale}


def _verified(truth: dict, line: np.ndarray) -> dict[str, float]:
    """By how much the line through the outputs of the verification differs from that of the end with +Z up.

    Empty without a verification.
    """
    keys = [key for key in truth["forces_g"] if "verification" in key and truth["forces_g"][key][2] > 0]
    if not keys:
        return {}
    slope, intercept = np.polyfit(
        [truth["forces_g"][key][0] for key in keys], [truth["outputs"][key] for key in keys], 1
    )
    return {"verification/offset": (intercept - line[0]) / line[1], "verification/scale": slope / line[1] - 1}


def _mean(truth: dict, side: int, angle: int) -> tuple[float | None, float]:
    """Mean output with +Y up (1) or down (-1), level or at the largest angle of either sign, and the input in g."""
    keys = [key for key, (_, across, pendulous) in truth["forces_g"].items() if abs(across) > abs(pendulous)]
    largest = max((abs(truth["forces_g"][key][0]) for key in keys), default=0.0)
    here = [
        key for key in keys
        if truth["forces_g"][key][1] * side > 0 and abs(truth["forces_g"][key][0] - angle * largest) < ALIKE_G
    ]  # fmt: skip
    return (float(np.mean([truth["outputs"][key] for key in here])) if here else None), largest


def _loop(truth: dict, sense: int) -> float:
    """By how much the outputs of an end at one angle differ at most: the width of the loop that a unit goes through."""
    by_angle: dict[float, list[float]] = {}
    for key in _swept(truth, sense):
        by_angle.setdefault(round(truth["forces_g"][key][0], 6), []).append(truth["outputs"][key])
    return max(max(outputs) - min(outputs) for outputs in by_angle.values())


def _swept(truth: dict, sense: int) -> list[str]:
    """The readings of the sweeps of an end in the last pass."""
    swept = {key: force_g for key, force_g in truth["forces_g"].items() if not _BESIDE.search(key)}
    last = max(map(_pass_of, swept))
    return [
        key for key, (_, across, pendulous) in swept.items()
        if _pass_of(key) == last and pendulous * sense > abs(across)
    ]  # fmt: skip


def _pass_of(key: str) -> int:
    """Number of earlier measurements of both ends, plus one."""
    found = re.search(r"/pass=(\d+)", key)
    return int(found[1]) if found else 1


def head_rad(bench: dict) -> float:
    """By how much the errors of the head raise the input axis while it says 0°."""
    (head,) = bench["axes"].values()
    return math.radians(head["zero_deg"] + sum(head["cosines"]))


def hysteretic_bench(folder: Path, name: str) -> Path:
    """A full bench with a unit that has hysteresis in its input, twenty times what its limit allows."""
    path, file = full_bench(folder, name), folder / "uut" / "micro_g.yaml"
    text = file.read_text("utf-8")
    assert "\n  drift: " in text
    file.write_text(text.replace("\n  drift: ", f"\n  {INPUT_HYSTERESIS}\n  drift: "), "utf-8")
    return path


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bench", default="indexing", help="indexing, or indexing_pulses")
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    problems = []
    with tempfile.TemporaryDirectory() as temporary:
        for name, make in (("perfect", perfect_bench), ("full", full_bench), ("hysteretic", hysteretic_bench)):
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
    """Quantities beyond their bounds; a line is printed for each."""
    found = judge.by_quantity(each for each in comparisons if each.u)
    for quantity, chosen in found.items():
        rms, worst = judge.rms_of(chosen), max(abs(each.ratio) for each in chosen)
        print(f"{quantity:<18} n {len(chosen):>3}  rms(error/u) {rms:.3f}  largest {worst:.2f}")
    yield from judge.beyond(found, "perfect" if name == "perfect" else "full")


if __name__ == "__main__":
    sys.exit(main())
