"""A current source that is wrong beside an ammeter that is good: whom the reduction believes decides what it finds.

On the perfect bench, where nothing else is wrong. The source is wrong by some 100 ppm and drifts, and its certificate
does not know; the ammeter errs as its certificate admits, and is noisy.
"""

import csv
from unittest import mock

import numpy as np
import pytest

from bench.methods.channel.method import ChannelSettings
from bench.methods.channel.reduction.run import reduce
from bench.methods.channel.reduction.transfer_meter import Metered
from bench.reduce.corrections import Corrections
from bench.reduce.stored_run import open_run
from bench.report.export.export import FORMATS
from campaigns.truth.campaign import perfect_bench
from campaigns.truth.channel import true_line
from tests.support.ammeter import put_into_cable
from tests.support.flags import texts
from tests.support.runs import ROOT, read_json, run_short

SETTINGS = (
    "low=20 °C", "high=27 °C", "ramp_rate=30 °C/h", "return_rate=3 °C/min", "time_constant=1 min", "point=1 min",
    "source_warm_up=0 s", "levels=[1 g]",
)  # fmt: skip
WRONG = "sources: {source: {gain: 100 ppm, offset: 100 nA, drift: 1000 ppm/h, fresh: 1}}"
CORRECTED = "gain: 8 ppm, offset: 4 nA}, corrections: {current: [{at: 1.1 mA, add: 30 nA}]"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("metered")
    bench = put_into_cable(perfect_bench(folder / "config", "channel"), stated=CORRECTED, noise="10 nA")
    text = bench.read_text("utf-8")
    reported = "sources: {source: {warm_up: 2 h, fresh: 5}}"
    assert text.count(reported) == 1
    bench.write_text(text.replace(reported, WRONG), "utf-8")
    asked = (ROOT / "sequences/channel_source.yaml").read_text("utf-8")
    assert asked.count("current_from: source ") == 1
    sequence = folder / "by_meter.yaml"
    sequence.write_text(asked.replace("current_from: source ", "current_from: meter "), "utf-8")
    return run_short(
        folder / "runs", bench=bench, sequence=str(sequence), settings=SETTINGS, speed="max", seed=4, no_report=False
    )


def findings(run, current_from="meter"):
    with open_run(run.path) as stored:
        settings = ChannelSettings.model_validate(stored.sequence.results[0].settings).model_dump()
        (unit,) = reduce(stored.data("channel"), settings | {"current_from": current_from})
    return {finding.id.removeprefix("channel/a/"): finding for finding in unit.findings}, texts(unit.flags)


def errors(run, current_from="meter"):
    """Rate and slope at the level against the truth, in standard uncertainties."""
    found, _ = findings(run, current_from)
    rate, slope = found["rate@src_1g"], found["rate/temperature_coefficient@src_1g"]
    reported = {"id": rate.id, "steps": rate.steps, "at": rate.at}
    true_rate, true_slope = true_line(read_json(run, "truth.json"), reported)
    return (rate.value - true_rate) / rate.u, (slope.value - true_slope) / slope.u


def test_the_run_has_its_verdict_by_the_meter(run):
    assert run.outcome.how == "completed"
    assert run.problems == []
    truth = read_json(run, "truth.json")["sources"]["source"]
    assert abs(truth["gain"]) > 50e-6
    assert abs(truth["drift_per_h"]) > 20e-6


def test_by_the_meter_the_truth_is_found_within_u(run):
    assert max(map(abs, errors(run))) < 3


def test_by_the_source_it_is_not(run):
    assert abs(errors(run, "source")[0]) > 10


def no_correction():
    return mock.patch.object(Corrections, "measured", lambda self, role, read: read)


def drift_left_in():
    return mock.patch.object(Metered, "without_drift", lambda self, run, reference_c: run)


def drift_the_wrong_way():
    honest = Metered.change_per_c
    return mock.patch.object(
        Metered, "change_per_c", lambda self, gates: (-honest(self, gates)[0], honest(self, gates)[1])
    )


@pytest.mark.parametrize("mistake", [no_correction, drift_left_in, drift_the_wrong_way])
def test_a_mistake_in_the_transfer_is_seen(run, mistake):
    with mistake():
        assert max(map(abs, errors(run))) > 3


def test_the_budget_names_the_meters_certificate_and_no_other(run):
    by_meter, _ = findings(run)
    by_source, _ = findings(run, "source")
    for name in ("rate@src_1g", "rate/temperature_coefficient@src_1g", "zero@src_0g"):
        sources = {line.source.partition(":")[0] for line in by_meter[name].budget}
        assert "dmm" in sources
        assert "source" not in sources
        assert "dmm" not in {line.source.partition(":")[0] for line in by_source[name].budget}
    lines = {line.source: line.u for line in by_meter["rate@src_1g"].budget}
    assert lines["dmm: gain"] == pytest.approx(4e-6 * 11300, rel=1e-3)
    assert lines["dmm: offset"] == pytest.approx(2e-9 * 1e7, rel=1e-3)


def test_levels_are_told_by_source_and_by_meter(run):
    (by_meter, flags), (by_source, _) = findings(run), findings(run, "source")
    truth = read_json(run, "truth.json")["sources"]["source"]
    for found in (by_meter, by_source):
        current, deviation = found["current@src_1g"], found["current/deviation@src_1g"]
        assert current.value == pytest.approx(1.13e-3 * (1 + deviation.value), rel=1e-9)
        wrong = truth["gain"] + truth["offset_a"] / 1.13e-3
        assert abs(deviation.value - wrong) < 3 * deviation.u + 2 * abs(truth["drift_per_h"])
        assert np.isfinite(current.u)
    assert by_meter["rate@src_1g"].at["current_a"] == by_meter["current@src_1g"].value
    assert by_source["rate@src_1g"].at["current_a"] == pytest.approx(1.13e-3, rel=1e-9)
    assert "src_1g:source_and_ammeter_differ" in flags
    page = (run.path / "report.html").read_text("utf-8")
    for words in (
        "SIM-2026-0109",
        "dmm: gain",
        "dmm: corrected by +30 nA at 1.1 mA",
        "Ammeter dmm",
        "the source says 1.13 mA",
        "current: deviation",
    ):
        assert words in page


def test_the_readings_of_the_ammeter_are_exported_as_they_were_read(run, tmp_path):
    with open_run(run.path) as stored:
        FORMATS["csv"](stored, tmp_path)
        corrected = np.concatenate([each.currents["dmm"].values_a for each in stored.data("channel").acquisitions])
    with (tmp_path / "currents.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["ammeter"] for row in rows} == {"dmm"}
    assert [float(row["value"]) + 30e-9 for row in rows] == pytest.approx(corrected.tolist(), abs=1e-15)
