"""An inertial unit on a rate table against the truth: every sensor in every mounting (equations 5.10, 8.8).

    python -m campaigns.truth.table_imu --seeds 20 --kind misaligned
    python -m campaigns.truth.table_imu --seeds 20 --bench table_imu_telemetry

runs `table_full` through all wires. The truth takes the mountings from the words of the sequence (which axis is up, and
which along the fixture), the arms from the file of the unit and the drawn position of its middle, and the definitions
of the results from equations 5: it shares no line with the reduction.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from bench.app.request import RunRequest
from campaigns.truth import judge
from campaigns.truth.altered import alter_file
from campaigns.truth.campaign import ROOT, Comparison, campaign, full_bench, perfect_bench, results_of
from campaigns.truth.table import one_a_run, table
from campaigns.truth.table_truth import EARTH_DPS, _response
from simulators.units.accelerometer import UnitTruth
from simulators.units.gyro import GyroTruth

KINDS = ("as shipped", "negative scale", "misaligned", "noisy")
SHORT = (
    "warm_up=25 min", "rates=[100 °/s, 200 °/s, 300 °/s, 400 °/s]", "rest=5 s", "rate_record=5 s",
    "frequencies=[10.2 Hz, 30.2 Hz, 50.2 Hz, 62.2 Hz, 70.2 Hz, 78.2 Hz, 90.2 Hz]", "swing_record=5 s",
    "lever_record=20 s",
)  # fmt: skip
# Pulses for 1 °/s and 1 g, and codes.
STATED = {"gyro_x": 4000.0, "gyro_y": 3996.0, "gyro_z": 4005.0, "acc_x": 11300.0, "acc_y": 11300.0, "acc_z": 11300.0}
SENT = {"gyro_x": 1000.0, "gyro_y": 999.0, "gyro_z": 1001.25, "acc_x": 33900.0, "acc_y": 33900.0, "acc_z": 33900.0}
BENCHES = {"table_imu": "table_imu", "table_imu_telemetry": "table_imu_digital"}  # with the file of the unit
FULL_SCALE_DPS, FULL_SCALE_G, LEVER_HZ = 400.0, 2.0, 0.5
# Axes of the unit in the fixture, as the prompts of the sequence name them.
MOUNTED = {
    "z_up": np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    "y_up": np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "x_up": np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
}
UP = np.array([0.0, 0.0, 1.0])
Truth = Callable[[dict], float]


def compare_table_imu(folder: Path, results: dict | None = None) -> list[Comparison]:
    """Every figure of a run with a truth beside it."""
    truth, results = json.loads((folder / "truth.json").read_text("utf-8")), results or results_of(folder)
    found = []
    for each in results["findings"]:
        at = each["at"]
        true = _truths(truth, results, at["sensor"], at["mount"]).get(each["quantity"])
        if true is not None:
            found.append(Comparison.of(truth["seed"], each, true(at), at.get("point", 0)))
    return found


def _truths(truth: dict, results: dict, sensor: str, mount: str) -> dict[str, Truth]:
    place = Placed(truth, sensor, mount)
    if sensor.startswith("gyro"):
        return _gyro_range(place) | _gyro_response(place)
    return _accelerometer_range(place, results) | _accelerometer_response(place)


class Placed:
    """A sensor in a mounting: as drawn, its axes in the fixture, its arm there, and the bench."""

    def __init__(self, truth: dict, sensor: str, mount: str) -> None:
        unit, self.bench = truth["imus"]["a"], truth["bench"]
        self.sensor, self.mount, self.axis = sensor, mount, "xyz".index(sensor[-1])
        axes = MOUNTED[mount]
        self.axes = axes[[self.axis, (self.axis + 1) % 3, (self.axis + 2) % 3]]
        self.arm_m = np.array(self.bench["arms_m"]["a"])
        if sensor.startswith("acc"):
            self.arm_m = self.arm_m + axes.T @ np.array(unit["positions_m"][self.axis])
        self.drawn = {
            key: tuple(value) if isinstance(value, list) else value
            for key, value in unit["gyros" if sensor.startswith("gyro") else "accelerometers"][self.axis].items()
        }
        self.warm_c, self.rate = self.bench["warm_c"]["a"], self.bench["table"]["rate"]
        self.sends = unit["gyros_send"][self.axis] if unit["gyros_send"] else None

    def force_g(self, rate_dps: float) -> tuple[np.ndarray, ...]:
        """Along the input axis and the two after it, while the table turns."""
        pull = -(np.radians(rate_dps) ** 2) * self.arm_m * np.array([1, 1, 0]) / self.bench["gravity_mps2"]
        return tuple(np.array([each]) for each in self.axes @ (UP + pull))

    @property
    def sensed(self) -> np.ndarray:
        """Direction in the fixture along which a misaligned accelerometer senses."""
        along, second, third = self.axes
        return along + self.drawn["misalignment_o"] * second - self.drawn["misalignment_p"] * third

    def stated(self, scale: float) -> float:
        """Stated scale factor, of the sign that the sensor has."""
        return float(np.copysign((SENT if self.sends else STATED)[self.sensor], scale))

    def gyro_output(self, pps: np.ndarray) -> float:
        """Output of a gyro: its pulses, or what it sends in place of them."""
        rate = float(pps[0])
        return self.sends["codes_per_pps"] * rate + self.sends["zero_code"] if self.sends else rate

    def accelerometer_output(self, current_a: np.ndarray) -> float:
        """Output of an accelerometer for its current: pulses, or codes."""
        unit = UnitTruth(**self.drawn)
        return float((unit.codes(current_a) if self.sends else unit.rate_pps(current_a))[0])


def _gyro_range(place: Placed) -> dict[str, Truth]:
    gyro = GyroTruth(**place.drawn)
    stated = place.stated(gyro.scale_ppd)
    earth_dps = EARTH_DPS * np.sin(np.radians(place.bench["latitude_deg"]))

    def output_dps(rate_dps: float, at_c: float = place.warm_c) -> float:
        rates = tuple(np.array([each]) for each in place.axes @ (UP * (rate_dps + earth_dps)))
        pps = gyro.output_pps(rates, place.force_g(rate_dps), at_c, np.zeros(1))  # type: ignore[arg-type]
        return place.gyro_output(gyro.clipped_pps(pps)) / stated

    def error_dps(at: dict) -> float:
        rate_dps = at["rate_dps"] * (1 + place.rate)
        return output_dps(rate_dps) - output_dps(0.0) - rate_dps

    def relative(part: float, at_c: float = place.warm_c) -> float:
        rate_dps = part * FULL_SCALE_DPS
        return (output_dps(rate_dps, at_c) - output_dps(0.0, at_c)) / rate_dps - 1

    def even(part: float, at_c: float = place.warm_c) -> float:
        return (relative(part, at_c) + relative(-part, at_c)) / 2

    cubic = (even(1.0) - even(0.5)) / (1 - 0.5**2)
    return {
        "rest_rate": lambda _: output_dps(0.0),
        "rate_error": error_dps,
        "rate_error/relative": lambda at: error_dps(at) / abs(at["rate_dps"] * (1 + place.rate)),
        "scale_error": lambda at: even(1.0, at["at_c"]) - cubic,
        "asymmetry": lambda _: (relative(1.0) - relative(-1.0)) / 2,
        "nonlinearity/cubic": lambda _: cubic,
    }


def _gyro_response(place: Placed) -> dict[str, Truth]:
    gyro = GyroTruth(**place.drawn)
    warm = 1 + gyro.scale_per_c * (place.warm_c - gyro.reference_c)
    per_dps = place.gyro_output(np.array([gyro.scale_ppd])) - place.gyro_output(np.zeros(1))
    scale = per_dps * warm / place.stated(gyro.scale_ppd)
    assert gyro.dynamics is not None
    dynamics = gyro.dynamics
    return _response(lambda hz: complex(dynamics.response(np.array([hz]))[0]) * scale)


def _accelerometer_range(place: Placed, results: dict) -> dict[str, Truth]:
    unit = UnitTruth(**place.drawn)
    stated = place.stated(unit.scale_a_per_g)

    def output_g(rate_dps: float, added_g: float = 0.0) -> float:
        force_g = place.force_g(rate_dps)
        current_a = unit.current_a(force_g, np.array([place.warm_c]), np.array([added_g]))  # type: ignore[arg-type]
        return place.accelerometer_output(current_a) / stated

    rise_c = place.warm_c - place.bench["room_c"]
    moved_c = sum(min(threshold_c, rise_c) for threshold_c in unit.thresholds_c)
    after_g = unit.hysteresis_g * moved_c / sum(unit.thresholds_c)
    squares = np.radians(list(_low_dps(results, place))) ** 2 * (1 + place.rate) ** 2
    if not len(squares):
        return {}  # no radius was found
    rises_g = [output_g(float(np.degrees(np.sqrt(square)))) - output_g(0.0) for square in squares]
    per_square = float(squares @ rises_g) / float(squares @ squares)

    def error_g(at: dict) -> float:
        rate_dps = abs(at["rate_dps"]) * (1 + place.rate)
        return output_g(rate_dps) - output_g(0.0) - np.radians(rate_dps) ** 2 * per_square

    return {
        "rest_output": lambda _: output_g(0.0, after_g),
        "radius": lambda _: -float(place.arm_m * np.array([1, 1, 0]) @ place.sensed),
        "acceleration_error": error_g,
        "acceleration_error/relative": lambda at: error_g(at) / FULL_SCALE_G,
    }


def _low_dps(results: dict, place: Placed) -> Iterator[float]:
    """Rates of the acquisitions that a radius is made of."""
    for found in results["findings"]:
        at = found["at"]
        if found["quantity"] == "radius" and (at["sensor"], at["mount"]) == (place.sensor, place.mount):
            for step in found["steps"]:
                yield float(re.search(r"/rate=([\d.]+)/", step)[1])  # type: ignore[index]


def _accelerometer_response(place: Placed) -> dict[str, Truth]:
    dynamics = UnitTruth(**place.drawn).dynamics
    assert dynamics is not None

    def response(hz: float) -> complex:
        at, low = dynamics.response(np.array([hz, LEVER_HZ]))
        return complex(at / abs(low))

    return _response(response) | {
        "lever_arm/x": lambda _: float(place.arm_m * np.array([1, 1, 0]) @ place.sensed),
        "lever_arm/y": lambda _: float(place.arm_m @ np.cross(UP, place.sensed)),
    }


def prepared(
    folder: Path, kind: str = "as shipped", *, perfect: bool = False, name: str = "table_imu"
) -> tuple[Path, Path]:
    """A bench with a unit of a kind in a folder of its own, and the sequence that states its scale factors."""
    bench = perfect_bench(folder, name) if perfect else full_bench(folder, name)
    alter_file(folder / "uut" / f"{BENCHES[name]}.yaml", kind)
    sequence = (ROOT / "sequences" / "table_full.yaml").read_text("utf-8")
    if kind == "negative scale":
        bench.write_text(re.sub(r"\b(K1|output): (?=\d)", r"\1: -", bench.read_text("utf-8")), "utf-8")
        sequence = re.sub(r"\b(?<!\.)(?=\d[\d.]* (pulse|code)/)", "-", sequence)
    path = folder / "table_full.yaml"
    path.write_text(sequence, "utf-8")
    return bench, path


def main() -> int:
    """Print how errors compare with their uncertainties; 1 when those of a kind do not fit."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=1, help="the first seed")
    parser.add_argument("--kind", choices=KINDS, action="append")
    parser.add_argument("--bench", choices=list(BENCHES), default="table_imu")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--perfect", action="store_true")
    options = parser.parse_args()
    bad = []
    with tempfile.TemporaryDirectory() as temporary:
        for kind in options.kind or KINDS:
            folder = Path(temporary) / kind.replace(" ", "_")
            bench, sequence = prepared(folder / "config", kind, perfect=options.perfect, name=options.bench)
            requests = [
                RunRequest(str(sequence), bench=str(bench), seed=seed, settings=SHORT, runs=folder / f"runs{seed}")
                for seed in range(options.first, options.first + options.seeds)
            ]
            runs = campaign(requests, options.processes)
            found = [each for run in runs for each in compare_table_imu(run)]
            print(f"\n{kind}\n" + "\n".join(table(found)), flush=True)
            judged = judge.by_quantity(one_a_run(found))
            bad += [f"{kind}: {each}" for each in judge.beyond(judged, "perfect" if options.perfect else "full")]
    print("\n".join(bad) or "\ntruth: ok")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
