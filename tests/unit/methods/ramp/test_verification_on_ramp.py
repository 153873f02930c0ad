"""A calibration applied to another ramp: what its curves leave, and its dynamic model, of units that lag or do not."""

from dataclasses import replace

import numpy as np
import pytest

from bench.methods.ramp.method import VERIFY_ON_RAMP
from bench.methods.ramp.reduction import verification
from bench.methods.ramp.reduction.left import LeftOnRamp, PartOfRamp
from bench.methods.ramp.reduction.run import parts_of
from bench.metrology.bench_uncertainty import TiltPairRecord
from bench.metrology.calibration.dynamic import DynamicBias
from bench.metrology.results.curves import Constant
from bench.metrology.run_data import ReleasedCalibration, RunData
from tests.support.flags import texts
from tests.unit.methods.ramp.test_temperature_ramp import (
    BENCH,
    HIGH_C,
    K1,
    LEG_S,
    LOW_C,
    UNIT,
    found,
    reduced,
    run,
    straight,
)

RATE_C_PER_S, LAG_S = (HIGH_C - LOW_C) / LEG_S, 240.0
HALF_LOOP_G = 12e-6 * RATE_C_PER_S * LAG_S
SETTINGS = VERIFY_ON_RAMP.settings.model_validate({}).model_dump()


def lagging(temperature_c, cycle, rising):
    """A bias that is behind the thermometer."""
    return straight(temperature_c - (1 if rising else -1) * RATE_C_PER_S * LAG_S, cycle, rising)


def known_of(bias):
    (known,) = reduced(run(bias)).compensations
    return known


@pytest.fixture(scope="module")
def of_lagging():
    return known_of(lagging)


def verified(acquisitions, known, bench=BENCH, gravity_mps2=9.8):
    unit = replace(UNIT, released=ReleasedCalibration({"x": known}, gravity_mps2))
    (result,) = verification.reduce(RunData("ramp", (unit,), tuple(acquisitions), bench), SETTINGS)
    return result


def test_a_ramp_releases_its_model_with_the_rate(of_lagging):
    dynamic = of_lagging.dynamic
    assert dynamic.rate.value == pytest.approx(-12e-6 * LAG_S / 60, rel=0.03)
    assert (dynamic.rate.unit, dynamic.bias.valid_c) == ("g·min/°C", of_lagging.bias.valid_c)
    assert dynamic.fastest_c_per_min == pytest.approx(60 * RATE_C_PER_S, rel=0.02)


def test_the_dynamic_model_takes_out_a_lag_that_the_curves_leave(of_lagging):
    result = verified(run(lagging), of_lagging)
    findings = found(result)
    static, dynamic = findings["K0/left_largest"], findings["K0/left_largest_dynamic"]
    assert static.value == pytest.approx(HALF_LOOP_G, abs=3 * static.u)
    assert dynamic.value < 0.35 * static.value, "no more than the resolution of a count"
    assert dynamic.interval.low == 0
    assert findings["tilt/verified"].value == pytest.approx(np.degrees(2 * HALF_LOOP_G), rel=0.3)
    assert findings["tilt/verified_dynamic"].value < 0.4 * findings["tilt/verified"].value
    assert findings["tilt/uncompensated"].value > 4 * findings["tilt/verified"].value
    assert texts(result.flags) == ()


def test_a_rate_of_the_other_sign_doubles_the_loop(of_lagging):
    dynamic = of_lagging.dynamic
    turned = replace(of_lagging, dynamic=replace(dynamic, rate=replace(dynamic.rate, value=-dynamic.rate.value)))
    findings = found(verified(run(lagging), turned))
    assert findings["K0/left_largest_dynamic"].value == pytest.approx(2 * HALF_LOOP_G, rel=0.25)


def test_every_result_of_a_unit_is_there_in_its_unit(of_lagging):
    units = {each.quantity: each.unit for each in verified(run(lagging), of_lagging).findings}
    assert units == {name: unit for name, unit in VERIFY_ON_RAMP.stated.items() if "of_two" not in name}


def test_what_has_changed_since_is_left_about_its_mean(of_lagging):
    """A slope that has changed by 2 µg/°C over ±25 °C, and a bias that has changed by 300 µg."""
    findings = found(
        verified(run(lambda at_c, *leg: straight(at_c, *leg) + 2e-6 * (at_c - 35) + 3e-4), known_of(straight))
    )
    assert findings["K0/left_largest"].value == pytest.approx(50e-6, abs=8e-6)
    assert findings["K0/left_mean"].value == pytest.approx(3e-4, abs=3e-6)


def test_without_a_dynamic_model_its_results_are_those_of_the_curves(of_lagging):
    result = verified(run(lagging), replace(of_lagging, dynamic=None))
    findings = found(result)
    assert findings["K0/left_largest_dynamic"].value == findings["K0/left_largest"].value
    assert texts(result.flags) == ("calibration:no_dynamic_model",)


def test_temperatures_and_rates_beyond_the_calibration_are_flagged(of_lagging):
    narrow = replace(of_lagging.bias, valid_c=(20.0, 50.0))
    slow = DynamicBias(replace(of_lagging.dynamic.bias, valid_c=(20.0, 50.0)), Constant(0.0, "g·min/°C"), 0.5)
    result = verified(run(lagging), replace(of_lagging, bias=narrow, dynamic=slow))
    assert texts(result.flags) == ("calibration:samples_extrapolated", "calibration:faster")


def test_a_ramp_too_short_for_a_rate_has_no_result(of_lagging):
    short = [replace(each, end_s=each.begin_s + 20) for each in run(lagging)]
    result = verified(short, of_lagging)
    assert result.findings == ()
    assert "K0:ill_conditioned" in texts(result.flags)


def test_a_calibration_in_another_local_g_leaves_nothing_more(of_lagging):
    """The same outputs in a g that is 0.1 % smaller: scale and bias of the file in it."""
    smaller = replace(
        of_lagging,
        scale=replace(of_lagging.scale, coefficients=tuple(c / 1.001 for c in of_lagging.scale.coefficients)),
        bias=replace(of_lagging.bias, coefficients=tuple(c * 1.001 for c in of_lagging.bias.coefficients)),
        dynamic=None,
    )
    findings = found(verified(run(lagging), smaller, gravity_mps2=9.8 / 1.001))
    same = found(verified(run(lagging), of_lagging))
    assert findings["K0/left_mean"].value == pytest.approx(same["K0/left_mean"].value, abs=2e-6)
    assert findings["K1/left_largest"].value == pytest.approx(same["K1/left_largest"].value, abs=5e-6)


def test_a_count_that_hides_its_scatter_has_that_of_its_resolution(of_lagging):
    parts = [PartOfRamp.of(legs) for legs in _legs_of_a_run()]
    of = LeftOnRamp(*parts, of_lagging, 1.0)
    resolution_g = 1 / np.sqrt(6) / 10 / K1
    assert of.scatter_u([np.zeros(50)], of.level) == pytest.approx(resolution_g, rel=2e-3)
    wide = 1e-4 * np.random.default_rng(1).standard_normal(200)
    assert of.scatter_u([wide], of.level) == pytest.approx(1e-4, rel=0.3)


def _legs_of_a_run():
    level, upright, _, _ = parts_of(RunData("ramp", (UNIT,), tuple(run(lagging)), BENCH), UNIT, 10.0)
    return level, upright


def test_a_drifting_level_is_in_the_budget(of_lagging):
    drifting = replace(BENCH, level_drift=replace(BENCH.level_drift, u=10 / 3600))
    findings = found(verified(run(lagging), of_lagging, drifting))
    for quantity in ("K0/left_largest", "K0/left_largest_dynamic", "tilt/verified"):
        lines = {line.source: line.u for line in findings[quantity].budget}
        assert lines["fixture: level: drift within the run"] > 0.1 * findings[quantity].u, quantity


# Two accelerometers

PAIR = TiltPairRecord("a", "b", 0.0, 1e-3)
SECOND = replace(UNIT, place="b", serial="QF-8", mount_angle_deg=90.0)


def tilted(known, pair=PAIR, second=SECOND):
    """Both read the same channel, 90° apart: the second sees at a position what the first sees 90° later."""
    legs = {each.step: each for each in run(lagging, positions=(1.0, 89.0, 91.0, 179.0))}
    acquisitions = []
    for at, ahead_at in (("position=1/", "position=91/"), ("position=89/", "position=179/")):
        for each in (each for step, each in legs.items() if at in step):
            ahead = legs[each.step.replace(at, ahead_at)]
            then = replace(ahead.counts["x"], host_s=ahead.counts["x"].host_s - ahead.begin_s + each.begin_s)
            acquisitions.append(replace(each, counts={"x": each.counts["x"], "y": then}))
    released = ReleasedCalibration({"x": known}, 9.8)
    units = (replace(UNIT, released=released), replace(second, channel="y", released=released))
    bench = replace(BENCH, tilt_pairs=(pair,))
    first, _ = verification.reduce(RunData("ramp", units, tuple(acquisitions), bench), SETTINGS)
    return first


def test_the_tilt_by_both_is_compensated_by_both(of_lagging):
    findings = found(tilted(of_lagging))
    assert {each for each in findings if "of_two" in each} == {
        name for name in VERIFY_ON_RAMP.stated if "of_two" in name
    }
    raw, static, dynamic = (
        findings[f"tilt_of_two/{name}"] for name in ("uncompensated", "verified", "verified_dynamic")
    )
    assert raw.value == pytest.approx(np.degrees(12e-6 * 50), rel=0.2)
    assert static.value == pytest.approx(np.degrees(2 * HALF_LOOP_G), rel=0.3)
    assert dynamic.value < 0.5 * static.value


def test_the_skew_is_in_the_tilt_of_another_position_and_not_in_that_of_one(of_lagging):
    findings, stated = found(tilted(of_lagging)), found(tilted(of_lagging, PAIR._replace(skew_rad=5e-3)))
    largest = findings["tilt_of_two/left_largest"]
    assert {line.source: line.u for line in largest.budget}["skew between the input axes"] == pytest.approx(
        np.degrees(1e-3), rel=0.5
    )
    assert stated["tilt_of_two/left_largest"].value == pytest.approx(np.degrees(5e-3), rel=0.2)
    assert stated["tilt_of_two/verified"].value == pytest.approx(findings["tilt_of_two/verified"].value, rel=0.05)


def test_a_pair_that_is_exchanged_has_no_tilt(of_lagging):
    result = tilted(of_lagging, second=replace(SECOND, mount_angle_deg=270.0))
    assert "tilt_of_two:not_determined" in texts(result.flags)
    assert not any("of_two" in each.quantity for each in result.findings)
