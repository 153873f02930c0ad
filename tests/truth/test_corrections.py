"""Certificates with corrections against the truth: the instruments are wrong by them, and the results are right.

On the perfect bench, where nothing else is wrong; each correction taken the wrong way round is seen.
"""

from unittest import mock

import pytest

from bench.app.request import RunRequest
from bench.reduce.corrections import Corrections, Table
from campaigns.truth.campaign import compare, perfect_bench, run_one
from campaigns.truth.planted import comparisons_with

SETTLED = ("temperatures=[20 °C, 20 °C, 20 °C]", "soak=30 min")
STATED = {  # by the uncertainties beside which they stand
    "repeatability: 0": "angle: [{at: 0°, add: 12 arcsec}, {at: 90°, add: -9 arcsec}, {at: 180°, add: -15 arcsec}, "
    "{at: 270°, add: 4 arcsec}, {at: 360°, add: 12 arcsec}]",
    "time_base: 0": "time_base: 20 ppm",
}
ROWS = "[{at: -40 °C, add: 1.5 °C}, {at: 20 °C, add: 0.8 °C}, {at: 30 °C, add: 1.1 °C}, {at: 80 °C, add: -0.6 °C}]"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("corrected")
    bench = perfect_bench(folder / "config")
    lines = bench.read_text("utf-8").split("\n")
    for number, line in enumerate(lines):
        for uncertainty, corrections in STATED.items():
            if "U: {" in line and uncertainty in line:
                lines[number] = line.replace("U: {", f"corrections: {{{corrections}}}, U: {{")
        if "U: {offset: 0 °C" in line:
            lines[number] = line.replace("U: {", f"corrections: {ROWS}, U: {{")
    bench.write_text("\n".join(lines), "utf-8")
    assert bench.read_text("utf-8").count("corrections: ") == 3
    return run_one(RunRequest("tumble_static", bench=str(bench), seed=3, settings=SETTLED, runs=folder / "runs"))


def worst(comparisons, *quantities):
    return max(abs(each.ratio) for each in comparisons if each.quantity in quantities)


def test_corrected_readings_give_right_results(run):
    assert worst(compare([run]), "K0", "K1_si", "K2", "misalignment") < 4


def backwards(table):
    return Table(table.at, -table.add)


def wrong_angles():
    honest = Corrections.angle_deg
    return mock.patch.object(
        Corrections, "angle_deg",
        lambda self, role, at: honest(self._replace(axes={r: backwards(t) for r, t in self.axes.items()}), role, at),
    )  # fmt: skip


def wrong_temperatures():
    honest = Corrections.temperatures
    return mock.patch.object(
        Corrections, "temperatures",
        lambda self, read: honest(
            self._replace(thermometers={n: backwards(t) for n, t in self.thermometers.items()}), read
        ),
    )  # fmt: skip


def wrong_clock():
    honest = Corrections.counts
    return mock.patch.object(
        Corrections, "counts",
        lambda self, role, read: honest(self._replace(clocks={r: -c for r, c in self.clocks.items()}), role, read),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("plant", "quantity"),
    [(wrong_angles, "misalignment"), (wrong_temperatures, "K0"), (wrong_clock, "K1_si")],
    ids=["head", "thermometer", "counter"],
)
def test_a_correction_taken_the_wrong_way_round_is_seen(run, plant, quantity):
    assert worst(comparisons_with(plant, [run]), quantity) > 10
