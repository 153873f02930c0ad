"""Flights of calibrated units over many seeds: error of the velocity over its uncertainty.

    python -m campaigns.flights --seeds 40
    python -m campaigns.flights --method M2 --kind hysteresis --seeds 8
    python -m campaigns.flights --method "M0 volts" "M0 codes" --seeds 20

Each seed is another unit on another bench. A run is replayed at the level of records (`campaigns/truth/replay.py`), or
of volts and codes goes through all wires; its calibration file is written, and a flight of the same unit (`flight.py`)
converted through the files that `bench compensate` reads.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing import Pool
from pathlib import Path
from typing import Any

import numpy as np

from bench.app.drawn import world_settings
from bench.app.laboratory import unit_files
from bench.config.bench import load_bench
from bench.config.models import BenchFile
from bench.metrology.run_data import RunData
from bench.offline.calibration_content import calibration_files
from bench.offline.calibration_file import read_calibration
from bench.offline.motion import in_motion, wanted
from bench.reduce.evaluate import evaluate
from bench.reduce.journal import JournalRecords
from bench.reduce.stored_run import open_run
from bench.sequence.document.model import SequenceFile
from campaigns.flights.flight import Flight, Profile, Push, Sensor, write_record
from campaigns.truth.campaign import run_one
from campaigns.truth.cells import Cell
from campaigns.truth.player import Player, Template
from campaigns.truth.replay import template_of
from simulators.units.unit_file import stream
from simulators.units.unit_temperatures import ThermometerErrors
from simulators.world import World

KINDS = ("as shipped", "negative scale", "hysteresis", "noisy")
RMS = (0.75, 1.35)  # of error/u
AT_S = (1.0, 30.0, 150.0, 600.0)  # times of a flight at which its velocity is compared
REPLAYED = ("M0", "M2")
PLACE, G_MPS2 = "a", 9.80665
BIAS, QUADRATIC = 20e-6, 5e-6  # standard uncertainties in g and g/g² of the accelerometer of a channel, as stated
STORED_C = (-20.0, 50.0)  # cold or hot: ends of the calibration, from where loops of hysteresis are widest
WARMS_C = {
    "M0": 6.0,
    "M0 volts": 6.0,
    "M0 codes": 6.0,
    "M2": 1.0,
}  # by which the thermometer of the calibration rises in a flight
ROOM_C = 20.0  # at which a unit was stored before its flight


@dataclass(frozen=True)
class Arrival:
    """Velocity along an axis at a time of a flight, beside its truth."""

    seed: int
    channel: str
    at_s: float
    value_mps: float
    truth_mps: float
    u_mps: float

    @property
    def ratio(self) -> float:
        """Error over standard uncertainty."""
        return (self.value_mps - self.truth_mps) / self.u_mps


def flight_of(seed: int, temperatures_c: tuple[float, float], warms_c: float, sideways: bool) -> Flight:
    """A flight drawn by a seed: a push to some g along x, and smaller ones to both sides along y and z."""
    draws = stream(seed, "flight", "profile")

    def push(least_g: float, most_g: float) -> Push:
        begin_s, lasts_s = float(draws.uniform(5, 100)), float(draws.uniform(20, 200))
        return Push(begin_s, lasts_s, G_MPS2 * float(draws.uniform(least_g, most_g)))

    forward = Profile(G_MPS2 * float(draws.uniform(0.9, 1.1)), (push(1, 4), push(-0.5, 0.5)))
    aside = [Profile(G_MPS2 * float(draws.uniform(-0.5, 0.5)), (push(-1, 1), push(-1, 1))) for _ in "yz"]
    if not sideways:
        aside = [Profile(0.0), Profile(0.0)]
    low_c, high_c = temperatures_c
    from_c = float(draws.uniform(low_c, high_c - warms_c))
    return Flight((forward, *aside), from_c, from_c + warms_c, lasts_s=AT_S[-1])


@dataclass(frozen=True)
class Flown:
    """A flight, with the files from which its velocity is found."""

    seed: int
    flight: Flight
    sensors: Sequence[Sensor]
    calibration: Path
    record: Path

    def arrivals(self) -> list[Arrival]:
        """Velocities along all axes by the files, beside their truth."""
        found = self._velocities()
        assert not any(found[mark].any() for mark in ("gap", "extrapolated")), self.seed
        arrivals = []
        for profile, sensor in zip(self.flight.profiles, self.sensors, strict=False):
            true_mps = profile.velocity_mps(self.flight.time_s)
            for at_s in AT_S:
                row = round(at_s / self.flight.every_s)
                value, u = (float(found[f"{name}_mps"][row]) for name in (sensor.name, f"u_{sensor.name}"))
                arrivals.append(Arrival(self.seed, sensor.name, at_s, value, float(true_mps[row]), u))
        return arrivals

    def _velocities(self) -> dict[str, np.ndarray]:
        """Columns of `bench compensate --to velocity`, with the noise of the unit stated."""
        one = self.sensors[0]
        noise = f"{one.noise_density_g(self.flight):.9g} g/Hz^0.5"
        options = wanted("velocity", "g", "hold", one.truth.counter_bits if one.through is None else None, noise, ())
        found = in_motion(read_calibration(self.calibration), self.record, options)
        return {name: np.asarray(values) for name, _, values in found.columns}


@dataclass(frozen=True)
class Fleet:
    """Units of one kind, calibrated by one method: what the flights of their seeds need.

    Without a `template` each seed is a run of the `cell` through all wires, in the folder.
    """

    cell: Cell
    bench: BenchFile
    folder: Path
    template: Template | None

    @classmethod
    def of(cls, method: str, kind: str, folder: Path) -> Fleet:
        """Run the calibration once through all wires, from which all other seeds are replayed if they can be."""
        cell = Cell(method, kind)
        request = cell.request(folder, seed=0)
        template = template_of(request) if method in REPLAYED else None
        return cls(cell, load_bench(Path(request.bench)).bench, folder, template)

    def fly(self, seed: int, folder: Path) -> Flown | None:
        """Calibrate the unit of a seed, and fly it; None if its calibration has no specific force.

        By chance the slopes of one channel in a hundred are on no line (`drift_not_linear`).
        """
        world, content = self.calibrated(seed)
        sensors, thermometer = self.sensors(world, seed)
        if not {sensor.name for sensor in sensors} <= {entry["channel"] for entry in content["channels"]}:
            return None
        flight = flight_of(seed, _valid_c(content, sensors), WARMS_C[self.cell.method], sideways=len(sensors) > 1)
        folder.mkdir(parents=True, exist_ok=True)
        flown = Flown(seed, flight, sensors, folder / "calibration.json", folder / "flight.csv")
        flown.calibration.write_text(json.dumps(content), "utf-8")
        write_record(flown.record, flight, sensors, thermometer)
        return flown

    def calibrated(self, seed: int) -> tuple[World, dict[str, Any]]:
        """World of a seed after the calibration, and the content of the calibration file."""
        if self.template is not None:
            player = Player(self.template, self.bench, seed, None)
            data = player.play()
            return player.world, self._content(player.world, seed, self.template.sequence, data.__getitem__)
        path = run_one(self.cell.request(self.folder, seed))
        with open_run(path) as stored:
            began_s, ended_s = stored.data(stored.sequence.results[0].data).span_s
            settings = world_settings(self.bench, unit_files(self.bench, None), seed, ended_s - began_s)
            world = World(settings, lambda: ended_s)
            content = self._content(world, seed, stored.sequence, stored.data)
        shutil.rmtree(path)
        return world, content

    def _content(
        self, world: World, seed: int, sequence: SequenceFile, data: Callable[[str], RunData]
    ) -> dict[str, Any]:
        """Content of the calibration file of a run; of a channel with bias and nonlinearity stated."""
        if self.cell.method != "M2":
            (sensor,), _ = self.sensors(world, seed)
            stated = stated_of(sensor)
            results = [
                entry.model_copy(update={"settings": {**entry.settings, **stated}}) for entry in sequence.results
            ]
            sequence = sequence.model_copy(update={"results": results})
        found = evaluate(sequence, data, "completed", JournalRecords())
        manifest = {"run": f"flight_{seed}", "sequence": sequence.title, "started": "", "simulated": True}
        ((_, content),) = calibration_files(found.units, manifest, self.bench)
        return content

    def sensors(self, world: World, seed: int) -> tuple[list[Sensor], ThermometerErrors]:
        """Sensors of the unit, and the thermometer that its calibration is for."""
        settings, middle_s = world.settings, world.now() / 2
        common = {"seed": seed, "gravity_mps2": settings.gravity_mps2}
        if self.cell.method != "M2":
            place, truth = settings.places[PLACE], world.units[PLACE].truth
            held_c = place.unit.thermal.thermostat.set_point
            drifted_g = truth.drift_g_per_s * middle_s
            (name,) = self.bench.places[PLACE].measured_by.values()
            sensor = Sensor(
                truth, name, before_c=(ROOM_C,), drifted_g=drifted_g, fixed_c=held_c, through=place.through, **common
            )
            return [sensor], place.converter_thermometer
        imu = world.imus[PLACE]
        stored_c = float(stream(seed, "flight", "stored").choice(STORED_C))
        sensors = [
            Sensor(
                truth, f"acc_{axis}", before_c=(ROOM_C, stored_c), drifted_g=truth.drift_g_per_s * middle_s, **common
            )
            for axis, truth in zip("xyz", imu.truth.accelerometers, strict=True)
        ]
        return sensors, settings.imus[PLACE].thermometers["accelerometers"]


def stated_of(sensor: Sensor) -> dict[str, str]:
    """Bias and nonlinearity of the accelerometer, as another calibration has found them: with errors."""
    truth, draws = sensor.truth, stream(sensor.seed, "flight", "stated")
    hysteresis_g = float(sensor.moved_g(flight_of(0, (20.0, 30.0), 0.0, sideways=False))[0, 0])
    zero, at_1g = truth.output(np.array([0.0, truth.scale_a_per_g]), sensor.through).tolist()
    bias_g = truth.bias[0] + hysteresis_g + zero / (at_1g - zero)
    bias_g += BIAS * float(draws.standard_normal())
    quadratic = truth.k2 + QUADRATIC * float(draws.standard_normal())
    return {
        "bias": f"{bias_g:.9f} g", "bias_u": f"{BIAS:.9f} g",
        "quadratic": f"{quadratic:.9f} g/g²", "quadratic_u": f"{QUADRATIC:.9f} g/g²",
    }  # fmt: skip


def _valid_c(content: Mapping[str, Any], sensors: Sequence[Sensor]) -> tuple[float, float]:
    """Temperatures of the calibration, with a margin for the errors of the thermometer."""
    names = {sensor.name for sensor in sensors}
    ends = [entry["valid_c"] for entry in content["channels"] if entry["channel"] in names]
    return max(low for low, _ in ends) + 1.0, min(high for _, high in ends) - 1.0


def rms_of(arrivals: Sequence[Arrival]) -> float:
    """Of error over u."""
    return math.sqrt(sum(each.ratio**2 for each in arrivals) / len(arrivals))


def by_time(arrivals: Sequence[Arrival]) -> dict[tuple[str, float], list[Arrival]]:
    """Arrivals of all seeds by channel and time."""
    found: dict[tuple[str, float], list[Arrival]] = {}
    for each in arrivals:
        found.setdefault((each.channel, each.at_s), []).append(each)
    return found


def problems(arrivals: Sequence[Arrival]) -> list[str]:
    """Channels and times whose errors are outside of the bars."""
    return [
        f"{channel} at {at_s:g} s: rms(error/u) {rms_of(found):.2f}"
        for (channel, at_s), found in by_time(arrivals).items()
        if not RMS[0] <= rms_of(found) <= RMS[1]
    ]


def table(arrivals: Sequence[Arrival]) -> Iterator[str]:
    """A line for each channel and time."""
    for (channel, at_s), found in by_time(arrivals).items():
        covered = sum(abs(each.ratio) <= 2 for each in found) / len(found)
        u = float(np.mean([each.u_mps for each in found]))
        v = float(np.mean([abs(each.truth_mps) for each in found]))
        yield (
            f"  {channel:<6} at {at_s:>5g} s  n {len(found):>3}  rms(error/u) {rms_of(found):.2f}  "
            f"U covers {covered:.0%}  |v| {v:.4g} m/s  u {u:.3g} m/s"
        )


def _fly(fleet: Fleet, seed: int, folder: Path) -> list[Arrival]:
    flown = fleet.fly(seed, folder / str(seed))
    return [] if flown is None else flown.arrivals()


def main() -> int:
    """Fly all kinds of units; 1 if an error is outside of the bars."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--method", choices=list(WARMS_C), nargs="+", default=list(WARMS_C))
    parser.add_argument("--kind", choices=KINDS, nargs="+", default=list(KINDS))
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    failed = []
    with tempfile.TemporaryDirectory() as temporary:
        for method in options.method:
            for kind in options.kind:
                folder = Path(temporary) / f"{method}_{kind}".replace(" ", "_")
                fleet = Fleet.of(method, kind, folder)
                seeds = range(options.first, options.first + options.seeds)
                with Pool(options.processes) as pool:
                    found = pool.starmap(_fly, [(fleet, seed, folder) for seed in seeds], chunksize=1)
                arrivals = [each for flight in found for each in flight]
                failed += [f"{method}, {kind}: {each}" for each in problems(arrivals)]
                without = sum(not flight for flight in found)
                print(f"{method}, {kind}, {options.seeds} seeds, {without} without a specific force")
                print(*table(arrivals), sep="\n", flush=True)
    print("\n".join([*failed, f"flights: {'FAILED' if failed else 'ok'}"]))
    return 1 if failed else 0
