"""Runs a sequence on simulated benches with many seeds, and compares every result with the simulated truth."""

from __future__ import annotations

import json
import math
import re
import shutil
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from multiprocessing import Pool
from pathlib import Path
from typing import Self

import numpy as np

from bench.app.execute import execute
from bench.app.request import RunRequest, prepare
from bench.runner.quiet import Quiet
from simulators.truth.constants import channel_constants
from simulators.units.accelerometer import Decoding, Through, UnitTruth

ROOT = Path(__file__).parents[2]
QUANTITIES = (
    "K0", "K1", "K1_si", "K2", "misalignment", "misalignment_y", "K3", "Kip", "Kio", "asymmetry",
)  # fmt: skip
_U_VALUE = re.compile(r"(U: )(-?[\d.]+)")
_U_BLOCK = re.compile(r"(U: \{)([^}]*)(\})")
_NUMBER = re.compile(r"(?<![\w.])\d+(\.\d+)?(?= )")


@dataclass(frozen=True)
class Comparison:
    """One result of one run beside its truth."""

    seed: int
    dwell: int
    quantity: str
    value: float
    truth: float
    u: float
    interval: tuple[float, float] = (-math.inf, math.inf)
    k: float = 2.0

    @classmethod
    def of(cls, seed: int, finding: dict, truth: float, point: int = 0) -> Self:
        """A finding as it stands in the results beside its truth."""
        ends = finding["interval"]
        interval = (ends["low"], ends["high"]) if ends else (-math.inf, math.inf)
        return cls(seed, point, finding["quantity"], finding["value"], truth, finding["u"], interval, finding["k"])

    @property
    def covered(self) -> bool:
        """True if the truth is within the expanded uncertainty."""
        return abs(self.value - self.truth) <= self.k * self.u

    @property
    def held(self) -> bool:
        """True if the truth is in the interval, where there is one."""
        return self.interval[0] <= self.truth <= self.interval[1]

    @property
    def ratio(self) -> float:
        """Error over standard uncertainty."""
        return (self.value - self.truth) / self.u if self.u else math.inf


def full_bench(folder: Path, name: str = "simulated") -> Path:
    """A shipped bench, the demonstration bench unless another is named, with all it names, in a folder of its own."""
    shutil.copytree(ROOT / "config", folder, dirs_exist_ok=True)
    return folder / f"{name}.yaml"


def perfect_bench(folder: Path, name: str = "simulated") -> Path:
    """The same bench with every certified uncertainty zero, in simulator and bench file alike."""
    path = full_bench(folder, name)
    text = _U_BLOCK.sub(lambda block: block[1] + _NUMBER.sub("0", block[2]) + block[3], path.read_text("utf-8"))
    perfect = folder / "perfect.yaml"
    perfect.write_text(_U_VALUE.sub(r"\g<1>0", text), "utf-8")
    return perfect


def campaign(requests: Iterable[RunRequest], processes: int = 2) -> list[Path]:
    """Run them all; the run directories, in the order of the requests."""
    with Pool(processes, maxtasksperchild=8) as pool:
        return pool.map(run_one, list(requests), chunksize=1)


def run_one(request: RunRequest) -> Path:
    """Run one request; AssertionError when it does not get to its end."""
    result = execute(prepare(request), Quiet())
    assert result.outcome.how == "completed", result.problems
    return result.path


def compare(folders: Sequence[Path]) -> list[Comparison]:
    """Every result at a dwell beside its truth."""
    return [comparison for folder in folders for comparison in compare_one(folder, results_of(folder))]


def results_of(folder: Path) -> dict:
    return json.loads((folder / "results.json").read_text("utf-8"))


def compare_one(folder: Path, results: dict) -> list[Comparison]:
    """The results of one run, from the disk or reduced anew, beside the truth at the temperature they state."""
    return compared(json.loads((folder / "truth.json").read_text("utf-8")), results)


def compared(truth: dict, results: dict) -> list[Comparison]:
    """The same of a truth and of results at hand."""
    return [
        Comparison.of(
            truth["seed"], finding, true_constants(truth, finding)[finding["quantity"]], finding["at"]["dwell"]
        )
        for finding in results["findings"]
        if finding["quantity"] in QUANTITIES and "dwell" in finding["at"]
    ]


def through_of(truth: dict, place: str) -> Through:
    """Signal path of the current of the unit in a place: a load, its own A/D converter, or the pulse converter."""
    if place in truth["bench"].get("telemetry", {}):
        return Decoding(**truth["bench"]["telemetry"][place])
    loads = (meter["load_ohm"] for meter in truth["bench"].get("voltmeters", {}).values() if meter["place"] == place)
    return next(loads, None)


def true_constants(truth: dict, finding: dict) -> dict[str, float]:
    subject, _, path = finding["id"].partition("@")  # without a path where all of a run is one dwell
    dwell = truth["dwells"][f"{subject.removesuffix('/' + finding['quantity'])}@{path}"]
    if dwell["temperature_c"] == finding["at"]["temperature_c"]:
        return dwell
    place = finding["id"].split("/")[1]
    fields = {key: tuple(value) if isinstance(value, list) else value for key, value in truth["units"][place].items()}
    found = channel_constants(
        UnitTruth(**fields), truth["bench"]["gravity_mps2"], np.array(dwell["forces_g"]),
        finding["at"]["temperature_c"], dwell["drifted_g"], through_of(truth, place), extra=dwell.get("extra", ()),
        by_input_g=dwell.get("by_input_g", ()),
    )  # fmt: skip
    scale = 1 + dwell.get("turned_on_scale", 0.0)
    return {**found, "K1": found["K1"] * scale, "K1_si": found["K1_si"] * scale}
