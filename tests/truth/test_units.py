"""The campaign on altered units: a sample of it, and that what it is made of does what it says."""

import dataclasses
import itertools
import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from bench.app.drawn import world_settings
from bench.app.laboratory import unit_files
from bench.app.request import RunRequest
from bench.config.bench import load_bench
from bench.config.document import read_document
from bench.config.load import load
from campaigns.truth import bars, cells, units
from campaigns.truth.altered import alter_file, times
from campaigns.truth.campaign import ROOT, Comparison, full_bench
from campaigns.truth.cells import METHODS, Cell, Line
from campaigns.truth.foreign import DRIFT, FORMS, Drifts, bench_errors
from campaigns.truth.replay import replayed, template_of
from simulators.units.gyro_file import GyroFile
from simulators.units.imu_file import ImuFile
from simulators.units.unit_file import UnitFile
from simulators.world import World

SHORT = (
    "temperatures=[20 °C, 40 °C, 60 °C, 40 °C, 20 °C]", "soak=30 min", "warm_up=0 s", "ramp_rate=3 °C/min", "gate=20 s",
)  # fmt: skip
SEEDS = range(1, 7)


def tumbles(folder, kind, form="normal"):
    bench = full_bench(folder / "config")
    alter_file(folder / "config/uut/quartz_flexure.yaml", kind)
    template = template_of(RunRequest("tumble_static", bench=str(bench), seed=0, settings=SHORT, runs=folder / "runs"))
    loaded = load_bench(bench).bench
    runs = [replayed(template, loaded, seed, form=form) for seed in SEEDS]
    return [Line(run.truth["seed"], tuple(METHODS["M4a"].found(run.truth, run.results))) for run in runs]


@pytest.fixture(scope="module")
def hysteretic(tmp_path_factory):
    return tumbles(tmp_path_factory.mktemp("hysteretic"), "hysteresis")


def test_a_unit_with_strong_hysteresis_is_measured_as_well_as_is_stated(hysteretic):
    found = {each.quantity: each for each in bars.judged(Cell("M4a", "hysteresis"), hysteretic)}
    assert found["K0/hysteresis"].held >= 7 / 8
    assert found["K0/model_residual"].held >= 7 / 8
    assert max(each.rms for each in found.values() if each.held is None) < 1.35 * math.sqrt(chi2.ppf(0.999, 8) / 8)


def test_hysteresis_makes_no_coefficient_uncertain(hysteretic):
    """With the residuals of the model in u, errors would be a tenth of it or less."""
    found = {each.quantity: each.rms for each in bars.judged(Cell("M4a", "hysteresis"), hysteretic)}
    assert min(found[name] for name in ("K0T1", "K0T2", "K0/temperature_coefficient")) > 0.3


FILES = {"imu": ImuFile, "imu_channels": ImuFile, "rate_gyro": GyroFile}


@pytest.mark.parametrize("unit", sorted({method.unit for method in METHODS.values()}))
def test_every_kind_is_a_unit_that_the_simulators_take(unit, tmp_path):
    found = []
    for kind in next(method.kinds for method in METHODS.values() if method.unit == unit):
        path = tmp_path / f"{kind}.yaml"
        shutil.copy(ROOT / "config/uut" / f"{unit}.yaml", path)
        alter_file(path, kind)
        found.append(load(read_document(path), FILES.get(unit, UnitFile)))
    assert len(found) >= 7
    assert all(a != b for a, b in itertools.combinations(found, 2))


@pytest.mark.parametrize("method", ["M4b", "M4d", "M1", "M2"])
def test_the_altered_unit_is_that_which_is_on_the_bench(method, tmp_path):
    loaded = load_bench(Path(str(Cell(method, "warm").request(tmp_path, 1).bench))).bench
    (unit,) = unit_files(loaded, None).values()
    assert unit.thermal.self_heating == 15.0


@pytest.mark.parametrize("kind", ["as shipped", "misaligned"])
def test_a_ramp_is_told_how_far_the_input_axes_of_a_kind_are_off(kind, tmp_path):
    request = Cell("M4b", kind).request(tmp_path, 1)
    stated = Path(request.sequence) if kind == "misaligned" else ROOT / "sequences" / f"{request.sequence}.yaml"
    (entry,) = read_document(stated).value["results"]
    unit = read_document(Path(str(request.bench)).parent / "uut/quartz_flexure.yaml").value
    assert unit["accelerometer"]["misalignment_o"]["sd"] == entry["settings"]["misalignment_u"]


def test_a_kind_changes_what_it_names(tmp_path):
    full_bench(tmp_path)
    path = tmp_path / "uut/quartz_flexure.yaml"
    shipped = read_document(path).value
    alter_file(path, "warm")
    found = read_document(path).value
    assert found["accelerometer"]["K0"]["linear"] == "50 µg/°C"
    assert found["thermal"]["self_heating"] == "15 °C"
    assert found["accelerometer"]["hysteresis"] == shipped["accelerometer"]["hysteresis"]
    assert times({"mean": "2 ppm", "sd": "0.5 ppm"}, -3) == {"mean": "-6 ppm", "sd": "1.5 ppm"}


@pytest.mark.parametrize("form", FORMS)
def test_every_form_of_errors_has_the_stated_standard_deviation(form, tmp_path):
    loaded = load_bench(full_bench(tmp_path)).bench
    files = unit_files(loaded, None)
    with bench_errors(form):
        offsets_c = [world_settings(loaded, files, seed).places["a"].thermometer.offset_c for seed in range(400)]
    drifted = math.sqrt(1 + DRIFT**2 / 3) if form == "drifting" else 1.0
    assert drifted * np.std(offsets_c) == pytest.approx(0.3, rel=0.1)
    assert np.max(np.abs(offsets_c)) <= {"rectangular": 0.52, "at the limit": 0.3001}.get(form, np.inf)


@pytest.mark.parametrize("name", ["simulated", "gyro", "channel_imu"])
def test_errors_that_drift_go_from_side_to_side_of_those_that_were_drawn(name, tmp_path):
    loaded = load_bench(full_bench(tmp_path, name)).bench
    world = World(world_settings(loaded, unit_files(loaded, None), 1, 3600.0), lambda: 0.0)
    (unit,) = (*world.units.values(), *world.gyros.values(), *world.imus.values())
    thermometer = unit._thermometers["accelerometers"] if name == "channel_imu" else unit._thermometer
    drawn_c, level_deg = thermometer._errors.offset_c, world.kinematics._level.middle_deg
    drifts = Drifts(world)
    for share in (-1.0, 1.0):
        drifts.go_to(share)
        assert thermometer._errors.offset_c == pytest.approx(drawn_c * (1 + DRIFT * share))
        assert thermometer._errors.drift_c == 0.0
        assert world.kinematics._level.at(100.0) == pytest.approx(level_deg * (1 + DRIFT * share))


def test_a_campaign_goes_on_where_it_was_stopped(tmp_path, monkeypatch):
    cell, ran = Cell("M4a", "as shipped"), []

    def found(cell, seeds, folder, processes):
        for seed in seeds:
            ran.append(seed)
            yield Line(seed, (Comparison(seed, 0, "K0", 1.0, 0.5, 0.5),))

    monkeypatch.setattr(cells, "lines_of", found)
    cells.run(cell, [1, 2], tmp_path, tmp_path)
    path = tmp_path / f"{cell.name}.jsonl"
    path.write_text(path.read_text("utf-8") + '{"seed": 3, "pro', "utf-8")  # as a stop leaves it
    lines = cells.run(cell, [1, 2, 3, 4], tmp_path, tmp_path)
    assert ran == [1, 2, 3, 4]
    assert [line.seed for line in lines] == [1, 2, 3, 4]
    assert lines[0].found[0] == Comparison(1, 0, "K0", 1.0, 0.5, 0.5)


def judged_of(ratios, interval=(-math.inf, math.inf), form="normal"):
    lines = [Line(n, (Comparison(n, 0, "K0", each, 0.0, 1.0, interval),)) for n, each in enumerate(ratios)]
    return bars.problems(Cell("M4a", "as shipped", form), lines)


def test_bars_tell_runs_that_lack_findings_of_others():
    lines = [Line(n, (Comparison(n, 0, "K0", (-1.0) ** n, 0.0, 1.0),)) for n in range(8)]
    assert bars.problems(Cell("M1", "as shipped"), lines) == []
    assert bars.problems(Cell("M1", "as shipped"), [*lines, Line(8)]) == ["1 of 9 seeds lack findings, 8 K0"]


def test_bars_tell_uncertainties_that_are_too_small_or_too_large():
    rng = np.random.default_rng(1)
    assert judged_of(rng.standard_normal(40)) == []
    assert judged_of(3.0 * rng.standard_normal(40))[0].startswith("K0: rms(error/u) ")
    assert judged_of(0.4 * rng.standard_normal(40))[0].startswith("K0: rms(error/u) ")
    assert judged_of(0.4 * rng.standard_normal(40), form="rectangular") == []
    assert judged_of(3.0 * rng.standard_normal(40), form="rectangular")[0].startswith("K0: U covers")
    assert judged_of([0.0] * 36 + [2.1] * 4, form="rectangular") == []
    assert judged_of([0.0] * 360 + [2.1] * 40, form="rectangular") == ["K0: U covers 90.0%"]
    assert judged_of([0.0] * 40, (0.5, 1.0)) == ["K0: 0.0% of the intervals hold the truth"]
    assert judged_of([0.0] * 40, (-1.0, 1.0)) == [], "40 of 40 may be 99 %"
    assert judged_of([0.0] * 400, (-1.0, 1.0)) == ["K0: 100.0% of the intervals hold the truth"]


def test_what_fails_by_chance_is_decided_by_fresh_seeds(tmp_path, monkeypatch):
    def run(cell, seeds, *_):
        by_chance = cell.seeds(40)[0] == seeds[0]
        rng = np.random.default_rng(seeds[0])
        scale = 2.0 if by_chance or cell.kind == "noisy" else 1.0
        return [Line(s, (Comparison(s, 0, "K0", scale * rng.standard_normal(), 0.0, 1.0),)) for s in seeds]

    monkeypatch.setattr(units, "run", run)
    options = dataclasses.make_dataclass("Options", ["decide", "records", "processes"])(400, tmp_path, 1)
    assert units.decided(Cell("M4a", "as shipped"), 40, options, tmp_path)[1] == []
    assert units.decided(Cell("M4a", "noisy"), 40, options, tmp_path)[1] != []
