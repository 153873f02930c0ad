"""The start-up of a compensated inertial unit against the truth, and the campaign over many seeds.

The truth of a course is the noiseless unit at its true temperatures, compensated as its thermometers indicate.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.app.request import RunRequest
from bench.reduce.stored_run import open_run
from campaigns.truth import judge
from campaigns.truth.campaign import ROOT, Comparison, campaign, full_bench, results_of
from campaigns.truth.imu import decoding_of, imu_truth, table

CALIBRATION = ROOT / "config/uut/imu_calibration.json"
LABEL, PLACE, SUPPLY = "start_up", "a", "supply"
LIMITS = {"K0": 30e-6, "K1": 50e-6, "D0": 0.2 / 3600, "KG": 50e-6}
RATE_DPS = 30.0


@dataclass(frozen=True)
class TrueCourses:
    """True courses after one power-on: times since, (n,), and zero and scale by quantity and axis."""

    at_s: np.ndarray
    off: dict[tuple[str, str], np.ndarray]
    steps: dict[str, float]

    def at(self, quantity: str, axis: str, when_s: float) -> float:
        return float(np.interp(when_s, self.at_s, self.off[quantity, axis]))

    def settling_s(self, quantity: str, axis: str) -> float:
        size = np.abs(self.off[quantity, axis]) - LIMITS[quantity]
        outside = np.flatnonzero(size > 0)
        if not len(outside):
            return 0.0
        last = int(outside[-1])
        if last == len(size) - 1:
            return float(self.at_s[-1])
        part = size[last] / (size[last] - size[last + 1])
        return float(self.at_s[last] + part * (self.at_s[last + 1] - self.at_s[last]))


def true_courses(folder: Path) -> list[TrueCourses]:
    """One for each power-on, from the states of the unit in all windows."""
    truth = json.loads((folder / "truth.json").read_text("utf-8"))
    unit = imu_truth(truth["imus"][PLACE])
    released = json.loads((folder / f"released_{PLACE}.json").read_text("utf-8"))
    channels = {each["channel"]: each for each in released["channels"]}
    decodings = {name: decoding_of(truth, PLACE, name) for name in channels}
    with open_run(folder) as stored:
        acquisitions = stored.data(LABEL).acquisitions
    groups: dict[str, list] = {}
    for acquisition in acquisitions:
        groups.setdefault(acquisition.group, []).append(acquisition)
    return [_courses(members, truth["windows"], unit, channels, decodings) for members in groups.values()]


def compensated(channel: dict, output: np.ndarray, told_c: float) -> np.ndarray:
    """Values of outputs at an indicated temperature, by a channel of a calibration file: straight lines of knots."""
    offset, scale = (
        np.interp(told_c, channel[name]["knots_c"], channel[name]["values"]) for name in ("offset", "scale")
    )
    bias = channel["bias"]
    return (output - offset) / scale - (0.0 if bias is None else np.interp(told_c, bias["knots_c"], bias["values"]))


def _courses(members, windows, unit, channels, decodings) -> TrueCourses:
    at_s = np.array([(each.begin_s + each.end_s) / 2 - np.mean(each.on_since_s[SUPPLY]) for each in members])
    states = [windows[f"{LABEL}/{PLACE}@{each.step}"] for each in members]
    read_c = {name: [each.temperatures_c[name].mean() for each in members] for name in members[0].temperatures_c}
    off: dict[tuple[str, str], np.ndarray] = {}
    nothing = np.zeros(2)
    for number, axis in enumerate("xyz"):
        rows = []
        for index, state in enumerate(states):
            accelerometer, gyro = unit.accelerometers[number], unit.gyros[number]
            drifted_g = np.full(2, state["accelerometers_g"][number] + state["moving_g"][number])
            true_c, force_g = np.full(2, state["sensors_c"][number]), (np.array([1.0, -1.0]), nothing, nothing)
            current_a = accelerometer.current_a(force_g, true_c, drifted_g)
            output = accelerometer.output(current_a, decodings[f"acc_{axis}"])
            up, down = compensated(channels[f"acc_{axis}"], output, read_c["unit_temperature"][index])
            drifted_dps, gyro_c = np.full(2, state["gyros_dps"][number]), np.full(2, state["sensors_c"][3 + number])
            turned = (np.array([RATE_DPS, -RATE_DPS]), nothing, nothing)
            at_rest = gyro.output_pps((nothing, nothing, nothing), force_g, gyro_c, drifted_dps)
            turning = gyro.output_pps(turned, (nothing, nothing, nothing), gyro_c, drifted_dps)
            if (decoding := decodings[f"gyro_{axis}"]) is not None:
                sends = unit.gyros_send[number]
                at_rest, turning = (sends.codes(each) * decoding.scale + decoding.offset for each in (at_rest, turning))
            told_c = read_c["gyro_temperature"][index]
            rest_dps = compensated(channels[f"gyro_{axis}"], at_rest, told_c)
            plus, minus = compensated(channels[f"gyro_{axis}"], turning, told_c)
            rows.append(((up + down) / 2, (up - down) / 2 - 1, rest_dps.mean(), (plus - minus) / (2 * RATE_DPS) - 1))
        off |= {(quantity, axis): course for quantity, course in zip(LIMITS, np.array(rows).T, strict=True)}
    return TrueCourses(at_s, off, dict(zip([each.step for each in members], at_s.tolist(), strict=True)))


def compare_start_up(folder: Path, results: dict | None = None) -> list[Comparison]:
    """Every finding beside its truth; times where both are within the watch, and something was outside its limits."""
    courses = true_courses(folder)
    found = []
    for each in (results or results_of(folder))["findings"]:
        quantity, what = each["quantity"].split("/")
        course, axis = courses[each["at"]["visit"]], each["at"]["axis"]
        own_s = [course.steps[step] for step in each["steps"]]
        if what == "settling":
            truth = course.settling_s(quantity, axis)
            if (not each["value"] and not truth) or "more_than" in each["flags"] or truth >= max(own_s):
                continue
        else:
            truth = course.at(quantity, axis, min(own_s) if what == "power_on" else max(own_s))
        found.append(Comparison.of(0, each, truth, each["at"]["visit"]))
    return found


def main() -> int:
    """`python -m campaigns.truth.imu_start_up`: a full bench, whose thermometers and table have their errors."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--preset", default="quick")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--processes", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        full_bench(folder / "config")
        requests = [
            RunRequest(
                "imu_start_up", bench=str(folder / "config/imu.yaml"), preset=options.preset, seed=seed, runs=folder,
                settings=tuple(options.set), calibrations=(str(CALIBRATION),),
            )
            for seed in range(1, options.seeds + 1)
        ]  # fmt: skip
        comparisons = [each for run in campaign(requests, options.processes) for each in compare_start_up(run)]
    print("\n".join(table(comparisons)))
    found = judge.by_quantity(comparisons)
    held = {name: [each.held for each in chosen] for name, chosen in found.items() if "settling" in name}
    print("\n".join(f"{name}: {sum(each)} of {len(each)} intervals hold the truth" for name, each in held.items()))
    problems = list(judge.beyond(found, "full"))
    print("\n".join(problems) or "\ntruth: ok")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
