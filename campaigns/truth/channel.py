"""A channel over temperature and input level against the truth: the lines of its levels, and how they compare.

`python -m campaigns.truth.channel` runs `channel_full` with many seeds at record level, on a perfect and a full bench.
Then it reduces runs through all wires anew with errors planted. With `--bench channel_volts` or `channel_telemetry` the
channel makes volts or codes: all seeds go through all wires then, and errors of counting are not planted.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path

import numpy as np

from bench.app.request import RunRequest
from bench.reduce.stored_run import open_run
from campaigns.truth import judge
from campaigns.truth.campaign import Comparison, campaign, full_bench, perfect_bench, results_of
from campaigns.truth.judge import rms_of as rms
from campaigns.truth.planted_channel import OF_COUNTING, PLANTED
from campaigns.truth.replay import at_record_level

BENCH = "channel"
OF_A_LEVEL = ("rate", "rate/temperature_coefficient", "rate/relative_temperature_coefficient")
OF_TWO = ("deviation/raw", "deviation/normalised")
OF_ALL = ("tempco_offset", "tempco_scale")
REFERENCE_C = 25.0
WITHIN = slice(1, -1)  # of the truth of a ramp every 10 s, which begins and ends as its acquisition does
THROUGH_ALL_WIRES = 3  # seeds, in whose runs errors are planted
MUCH = 3.0  # times the error without a planted mistake
Line = tuple[float, float]


def compare_channel(folder: Path, results: dict | None = None) -> dict[str, Comparison]:
    """Every result of a run beside its truth, by the id of the result without its label and place."""
    return compared(json.loads((folder / "truth.json").read_text("utf-8")), results or results_of(folder))


def compared(truth: dict, results: dict) -> dict[str, Comparison]:
    """Compare a truth with results. A deviation without sign is compared by magnitude.

    What an uncertainty says is about the difference of two slopes. Its size alone would be nearer to that of the truth
    than that tells where the truth is about nothing.
    """
    compared = {}
    for axis in dict.fromkeys(each["at"].get("axis") for each in results["findings"]):
        found = [each for each in results["findings"] if each["at"].get("axis") == axis]
        compared |= _compared_channel(truth, found)
    return compared


def _compared_channel(truth: dict, found: list[dict]) -> dict[str, Comparison]:
    """The same of the findings of one channel."""
    true = {each["at"]["run"]: true_line(truth, each) for each in found if each["quantity"] == "rate"}
    lines = {run: tuple(_of_run(found, run, quantity) for quantity in OF_A_LEVEL[:2]) for run in true}
    compared = {}
    for each in found:
        if each["quantity"] in (*OF_A_LEVEL, *OF_ALL):
            value, true_value = each["value"], _true_value(each, true)
        elif each["quantity"] in OF_TWO:
            value, true_value = _deviation(each, lines), _deviation(each, true)
            assert math.isclose(abs(value), each["value"], rel_tol=1e-6), each["id"]
        else:
            continue
        key = each["id"].split("/", 2)[2]
        compared[key] = Comparison(truth["seed"], 0, each["quantity"], value, true_value, each["u"], k=each["k"])
    return compared


def _of_run(findings: list[dict], run: str, quantity: str) -> float:
    """Results of a level."""
    return next(each["value"] for each in findings if each["quantity"] == quantity and each["at"].get("run") == run)


def true_line(truth: dict, finding: dict) -> Line:
    """The rate at the reference temperature and the slope of the noiseless channel, over the steps of a finding.

    At the level that the finding states: a certificate may say that the source gave another than it was set to. And
    between the middles of the first gate and the last: the lag of the thermometer is in both lines alike then. A
    chamber's limit cycle tilts a line by some 1e-4 of its slope, by another amount where it is cut off elsewhere.
    """
    label, place = finding["id"].split("/")[:2]
    channel = "/".join([label, place, *([finding["at"]["axis"]] if "axis" in finding["at"] else [])])
    levels = [truth["levels"][f"{channel}@{step}"] for step in finding["steps"]]
    temperature_c = np.concatenate([level["temperature_c"][WITHIN] for level in levels])
    rate_pps = np.concatenate([level.get("rate_pps", level.get("output"))[WITHIN] for level in levels])
    slope, rate = np.polyfit(temperature_c - REFERENCE_C, rate_pps, 1)
    stated = finding["at"].get("current_a", levels[0]["input_a"]) / levels[0]["input_a"]
    return float(rate * stated), float(slope * stated)


def _true_value(finding: dict, lines: dict[str, Line]) -> float:
    quantity, at = finding["quantity"], finding["at"]
    if quantity in OF_ALL:
        scale, offset = np.polyfit([rate for rate, _ in lines.values()], [slope for _, slope in lines.values()], 1)
        return float(scale if quantity == "tempco_scale" else offset)
    rate, slope = lines[at["run"]]
    return {"rate": rate, "rate/temperature_coefficient": slope}.get(quantity, slope / rate)


def _deviation(finding: dict, lines: dict[str, Line]) -> float:
    """By how much the slope of a line is more than that of its reference, or its slope relative to its rate."""
    rate, slope = lines[finding["at"]["run"]]
    reference_rate, reference = lines[finding["at"]["reference"]]
    ratio = slope / reference
    return (ratio if finding["quantity"] == "deviation/raw" else ratio * reference_rate / rate) - 1


def comparisons_with(plant: object, folders: Sequence[Path]) -> dict[str, list[Comparison]]:
    """The runs reduced anew while an error is planted, beside their truths."""
    found = []
    for folder in folders:
        with plant(), open_run(folder) as stored:
            found.append(compare_channel(folder, stored.evaluate().to_json()))
    return by_result(found)


# The campaign


def by_result(runs: Sequence[dict[str, Comparison]]) -> dict[str, list[Comparison]]:
    keys = dict.fromkeys(key for run in runs for key in run)
    return {key: [run[key] for run in runs if key in run] for key in keys}


def worse(found: dict[str, list[Comparison]], honest: dict[str, list[Comparison]]) -> list[str]:
    """Results whose errors a planted mistake has made much larger than in the same runs without it, or u too large."""
    return [
        f"{key}: rms(error/u) is {rms(found[key]):.3g} instead of {rms(each):.3g}"
        for key, each in honest.items()
        if key in found and (rms(found[key]) > MUCH * max(rms(each), 1.0) or rms(found[key]) < rms(each) / MUCH)
    ]


def table(found: dict[str, list[Comparison]]) -> str:
    return "\n".join(
        f"{key:<52} n {len(each):>3}  rms(error/u) {rms(each):6.3f}  largest {max(abs(c.ratio) for c in each):5.2f}  "
        f"u {np.mean([c.u for c in each]):.3g}"
        for key, each in found.items()
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bench", default=BENCH, help="channel, channel_volts or channel_telemetry")
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    options = parser.parse_args()
    told: list[str] = []
    with tempfile.TemporaryDirectory() as temporary:
        requests: dict[str, list[RunRequest]] = {}
        folders: dict[str, list[Path]] = {}
        for name, make in (("perfect", perfect_bench), ("full", full_bench)):
            folder = Path(temporary) / name
            bench = make(folder / "config", options.bench)
            requests[name] = [
                RunRequest("channel_full", bench=str(bench), preset="quick", seed=seed, settings=tuple(options.set),
                           runs=folder)
                for seed in range(1, options.seeds + 1)
            ]  # fmt: skip
            if options.bench == BENCH:
                found = by_result(at_record_level(requests[name], compared, options.processes))
            else:  # only pulses are replayed
                folders[name] = campaign(requests[name], options.processes)
                found = by_result([compare_channel(path) for path in folders[name]])
            print(f"\n{name} bench, {options.seeds} seeds\n{table(found)}", flush=True)
            told += [f"{name} bench: {problem}" for problem in judge.beyond(found, name)]
        if options.bench == BENCH:
            told += _plant(PLANTED | OF_COUNTING, campaign(requests["perfect"][:THROUGH_ALL_WIRES], options.processes))
        else:
            told += _plant(PLANTED, folders["perfect"][:THROUGH_ALL_WIRES])
    print("\n".join([*told, f"channel truth: {'FAILED' if told else 'ok'}"]))
    return 1 if told else 0


def _plant(planted: Mapping[str, Callable[[], object]], folders: Sequence[Path]) -> list[str]:
    """Every planted error must be seen."""
    unseen, honest = [], comparisons_with(nullcontext, folders)
    for name, plant in planted.items():
        seen = worse(comparisons_with(plant, folders), honest)
        print(f"{name:<40} {'seen: ' + seen[0] if seen else 'NOT SEEN'}")
        unseen += [] if seen else [f"planted error not seen: {name}"]
    return unseen


if __name__ == "__main__":
    sys.exit(main())
