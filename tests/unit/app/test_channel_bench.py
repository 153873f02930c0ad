"""What a bench file says of converters in the chamber and of the source that feeds them, and what is made of it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bench.app.laboratory import make_laboratory, unit_files
from bench.config.bench import load_bench, misfits
from bench.errors import InputError
from bench.metrology.acquisition import Currents
from bench.reduce.certificates import bench_record
from bench.reduce.corrections import corrections_of
from bench.sequence.estimate.estimate import estimate
from bench.sequence.load import load_judged_plan
from campaigns.truth.campaign import full_bench
from simulators.physics.source_errors import CurrentErrors
from tests.support.ammeter import CABLE, put_into_cable
from tests.support.sequences import ROOT

CERTIFICATE = """
    calibration:
      {certificate: SIM-2026-0105, laboratory: none, date: 2026-01-01, due: 2030-12-31, k: 2,
       U: {gain: 40 ppm, offset: 20 nA, drift: 2 ppm/h}}"""
THERMOMETER = """\
from: counter.Temperatures.Converter
    limits: {min: -55 °C, max: 105 °C}
    stale_after: 5 s
    calibration:
      {certificate: SIM-2026-0107, laboratory: none, date: 2026-01-01, due: 2030-12-31, k: 2,
       U: {offset: 0.6 °C, gain: 0.2 %, drift: 0.12 °C}}"""
SIMULATED = "sources: {source: {warm_up: 2 h, fresh: 5}}"


def edited(folder, *edits):
    path = full_bench(folder, "channel")
    text = path.read_text("utf-8")
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new)
    path.write_text(text, "utf-8")
    return path


def errors_of(bench, seed=1):
    laboratory = make_laboratory(bench, unit_files(bench, None), seed, lambda: 0.0)
    return laboratory.world.sources["source"].errors


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("    converter_temperature: converter_temperature", "    converter_temperature: converter_temperatur",
         "there is no reading 'converter_temperatur'; did you mean 'converter_temperature'?"),
        (THERMOMETER, "from: source.on_time", "'converter_temperature' is not a temperature"),
        (SIMULATED, "sources: {supply: {warm_up: 2 h}}", "'supply' is not a current source; expected source"),
        (SIMULATED, "sources: {source: {fresh: 0.5}}", "fresh: is 0.5, expected at least 1"),
    ],
    ids=["no such reading", "no temperature", "no source", "slower when fresh"],
)  # fmt: skip
def test_what_does_not_fit_together_is_told(tmp_path, old, new, problem):
    with pytest.raises(InputError) as caught:
        load_bench(edited(tmp_path, (old, new)))
    assert problem in str(caught.value)


def test_a_certificate_of_a_source_is_what_its_errors_are_drawn_from_and_what_a_reduction_knows(tmp_path):
    bench = load_bench(edited(tmp_path)).bench
    known = bench_record(bench).sources["source"]
    assert (known.gain_u, known.offset_u_a) == pytest.approx((20e-6, 10e-9))
    assert known.drift_u_per_s * 3600 == pytest.approx(1e-6)
    drawn = [errors_of(bench, seed) for seed in range(1, 200)]
    for name, sd in (("gain", 20e-6), ("offset_a", 10e-9), ("drift_per_h", 1e-6)):
        squares = [getattr(errors, name) ** 2 for errors in drawn]
        assert (sum(squares) / len(squares)) ** 0.5 == pytest.approx(sd, rel=0.2)


def test_a_source_gives_what_the_table_of_its_certificate_says(tmp_path):
    rows = "corrections: {current: [{at: -1 mA, add: 2 µA}, {at: 3 mA, add: -6 µA}]}, U: {gain"
    bench = load_bench(edited(tmp_path, ("U: {gain", rows))).bench
    known = corrections_of(bench)
    laboratory = make_laboratory(bench, unit_files(bench, None), 1, lambda: 0.0)
    feed = laboratory.world.sources["source"]
    exact = replace(feed, errors=CurrentErrors())
    for told_a, given_a in ((-5e-3, -4.998e-3), (-1e-3, -0.998e-3), (1e-3, 0.998e-3), (5e-3, 4.994e-3)):
        assert known.current_a("source", told_a) == pytest.approx(given_a, rel=1e-12)
        instrument = SimpleNamespace(feeds_a=told_a)
        assert replace(exact, source=instrument).current_a(np.zeros(1)) == pytest.approx([given_a], rel=1e-12)
    assert known.current_a("other", 1e-3) == 1e-3


def test_a_table_of_currents_rises(tmp_path):
    rows = "corrections: {current: [{at: 3 mA, add: 0 A}, {at: 1 mA, add: 0 A}]}, U: {gain"
    with pytest.raises(InputError, match=r"the rows rise, and 0.001 stands after 0.003"):
        load_bench(edited(tmp_path, ("U: {gain", rows)))


def test_without_a_certificate_the_simulation_says_how_a_source_errs_and_a_reduction_knows_nothing(tmp_path):
    stated = "sources: {source: {gain: 30 ppm, offset: 5 nA, drift: 3 ppm/h, fresh: 2}}"
    bench = load_bench(edited(tmp_path, (CERTIFICATE, ""), (SIMULATED, stated))).bench
    assert bench_record(bench).sources == {}
    errors = errors_of(bench)
    assert 0 < abs(errors.gain) < 150e-6
    assert errors.fresh == 2
    silent = load_bench(edited(tmp_path / "silent", (CERTIFICATE, ""), (SIMULATED, "sources: {}"))).bench
    assert (errors_of(silent).gain, errors_of(silent).offset_a, errors_of(silent).drift_per_h) == (0, 0, 0)


def test_a_plan_knows_how_long_a_source_warms_up_and_a_converter_follows(tmp_path):
    bench = load_bench(edited(tmp_path)).bench
    plan, warnings = load_judged_plan(ROOT / "sequences/channel_source.yaml", bench)
    assert warnings == ()
    spans = {span.step.id: span for span in estimate(plan, bench).spans}
    warm = spans["setup/then/wait_until"]
    assert warm.end_s == pytest.approx(7200, abs=1)
    back = spans["steps/level=1/soak"]
    assert 900 <= back.duration_s < 1800, "three time constants, and until the converter has followed"


# An ammeter in the cable of the source


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("    ammeter: dmm", "    ammeter: dm", "'dm' is not an ammeter; did you mean 'dmm'?"),
        ("    ammeter: dmm", "    ammeter: source", "'source' is not an ammeter; expected dmm"),
        (CABLE, "    #", "ammeter is for a place with a source, in whose cable it is"),
        ("ammeters: {dmm:", "ammeters: {source:", "'source' is not an ammeter; expected dmm"),
        ("ammeters: {dmm: {noise: 0 A}}", "ammeters: {dmm: {noise: 0 V}}", "noise: is in V, expected a quantity in A"),
    ],
)
def test_an_ammeter_that_does_not_fit_is_told(tmp_path, old, new, problem):
    path = put_into_cable(edited(tmp_path))
    text = path.read_text("utf-8")
    assert old in text
    path.write_text(text.replace(old, new), "utf-8")
    with pytest.raises(InputError) as caught:
        load_bench(path)
    assert problem in str(caught.value)


def test_an_ammeter_is_in_one_cable(tmp_path):
    bench = load_bench(put_into_cable(edited(tmp_path))).bench
    place = bench.places["a"]
    other = place.model_copy(update={"source": "calibrator", "channel": "y"})
    found = [problem for _, problem in misfits(bench.model_copy(update={"places": {"a": place, "b": other}}))]
    assert "'dmm' is in the cable of 'source' already" in found


def test_an_ammeter_that_is_to_be_believed_is_recorded(tmp_path):
    bench = load_bench(put_into_cable(edited(tmp_path))).bench
    with pytest.raises(
        InputError, match="'counter' alone is recorded here, without 'dmm', which must measure the current"
    ):
        load_judged_plan(ROOT / "tests/broken/rule_no_ammeter.yaml", bench)


def test_the_burden_of_an_ammeter_needs_compliance_too(tmp_path):
    bench = load_bench(put_into_cable(edited(tmp_path))).bench
    assert bench.burden_ohm("source") == pytest.approx(10)
    laboratory = make_laboratory(bench, unit_files(bench, None), 1, lambda: 0.0)
    assert laboratory.instruments["source"].load_ohm == pytest.approx(110)
    compliance = ("compliance=1.2 V", "levels=[10 g]")  # 11.3 mA through 100 Ω of the converter and 10 Ω of the meter
    with pytest.raises(InputError, match=r"needs 1\.243 V for it, the compliance is 1\.2 V"):
        load_judged_plan(ROOT / "sequences/channel_source.yaml", bench, settings=compliance)
    load_judged_plan(
        ROOT / "sequences/channel_source.yaml", load_bench(edited(tmp_path / "bare")).bench, settings=compliance
    )


def test_the_certificate_of_an_ammeter_is_what_its_errors_are_drawn_from_and_what_a_reduction_knows(tmp_path):
    stated = "gain: 20 ppm, offset: 8 nA, drift: 2 ppm/h}, corrections: {current: [{at: 1 mA, add: 50 nA}]"
    bench = load_bench(put_into_cable(edited(tmp_path), stated=stated)).bench
    known = bench_record(bench).sources["dmm"]
    assert (known.gain_u, known.offset_u_a) == pytest.approx((10e-6, 4e-9))
    assert known.u_a(1e-3) == pytest.approx(np.hypot(10e-9, 4e-9))
    inputs = [
        make_laboratory(bench, unit_files(bench, None), seed, lambda: 0.0).instruments["dmm"].connected
        for seed in range(1, 60)
    ]
    drawn = np.array([each.read(1e-3, 7200.0) - 1e-3 for each in inputs])
    assert np.mean(drawn) == pytest.approx(-50e-9, abs=8e-9), "what its certificate adds, it lacks"
    assert np.std(drawn) == pytest.approx(np.hypot(10e-9, 4e-9), rel=0.25)
    read = Currents(np.zeros(1), np.array([0.99995e-3]))
    assert corrections_of(bench).measured("dmm", read).values_a == pytest.approx([1e-3], rel=1e-9)


@pytest.mark.parametrize(("key", "to"), [("K1: 1.13 mA/g", "K1: -1.13 mA/g"), ("S: 10 kHz/mA", "S: -10 kHz/mA")])
def test_a_unit_whose_output_falls_asks_for_as_much_as_one_whose_output_rises(tmp_path, key, to):
    bench = load_bench(edited(tmp_path, (key, to), ("max_current: 25 mA", "max_current: 15 mA"))).bench
    assert bench.nominal_per_g("a") == pytest.approx(-11_300)
    with pytest.raises(InputError, match=r"is more than the 0\.015 A that the unit in place 'a' takes"):
        load_judged_plan(ROOT / "sequences/channel_source.yaml", bench, settings=("levels=[15 g]",))
