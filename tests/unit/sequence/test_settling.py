"""When a unit has settled: a chain of lags against the simulated chamber, and soaks and waits that end with it."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from bench.config.bench import load_bench
from bench.sequence.estimate.lags import after_its_end, followed, gain, lag_poles, loop_poles, over_after_s
from bench.sequence.estimate.settling import Settling
from bench.sequence.steps.waits import Soak, WaitUntil
from simulators.physics.thermal import ChamberPhysics, Thermal, UnitPhysics
from tests.support.runs import copy_bench
from tests.support.sequences import BENCH, ROOT

LAGS_S = (180.0, 60.0, 20.0)  # case, sensor, thermometer, as the shipped unit has them
HEATING_C = 5.0
AT_S = np.arange(1.0, 7200.0, 7.0)
SOAK = {"soak": "unit_temperature", "at_least": "1 min", "give_up_after": "4 h"}
STABLE = {"band": "0.2 °C", "slope": "1 °C/h", "hold": "10 min"}


def simulated(at_s, damping=0.5, lags_s=LAGS_S, act=lambda _thermal: None):
    """Air and thermometer of the simulated chamber at times, after something was done at time 0."""
    unit = UnitPhysics(lags_s[0], lags_s[1], HEATING_C, lags_s[2])
    thermal = Thermal(ChamberPhysics(damping=damping, limit_cycle_c=0.0), (unit,), 0.0)
    act(thermal)
    found = []
    for time_s in at_s:
        thermal.advance(time_s)
        found.append((thermal.air_c, thermal.thermometer_c(0)))
    return np.array(found).T


@pytest.mark.parametrize("damping", [0.5, 1.0, 2.0])
def test_the_chain_follows_a_ramp_as_the_simulated_chamber_does(damping):
    air_c, unit_c = simulated(AT_S, damping, act=lambda thermal: thermal.ramp(70.0, 1 / 60))
    air, lags = loop_poles(360.0, damping), lag_poles(LAGS_S)
    np.testing.assert_allclose([20 + 50 * followed(air, at_s, 3000.0) for at_s in AT_S], air_c, atol=2e-3)
    np.testing.assert_allclose([20 + 50 * followed((*air, *lags), at_s, 3000.0) for at_s in AT_S], unit_c, atol=5e-3)


@pytest.mark.parametrize("lags_s", [LAGS_S, (60.0, 60.0, 60.0)])
def test_the_chain_follows_a_step_as_the_simulated_unit_does(lags_s):
    _, unit_c = simulated(AT_S, lags_s=lags_s, act=lambda thermal: thermal.power(0, True))
    poles = lag_poles(lags_s)
    np.testing.assert_allclose([20 + HEATING_C * followed(poles, at_s, 0.0) for at_s in AT_S], unit_c, atol=1e-3)


def test_before_a_change_nothing_is_followed_and_long_after_it_all():
    poles = lag_poles(LAGS_S)
    for duration_s in (0.0, 600.0):
        assert followed(poles, -1.0, duration_s) == 0
        assert followed(poles, 7000.0, duration_s) == pytest.approx(1, abs=1e-12)
        assert over_after_s(poles, duration_s) == duration_s + 40 * 180


@pytest.mark.parametrize("duration_s", [0.0, 3000.0])
def test_after_its_end_a_change_is_followed_by_exponentials_alone(duration_s):
    poles = (*loop_poles(360.0, 0.5), *lag_poles(LAGS_S))
    terms = list(after_its_end(poles, duration_s))
    for since_s in (1.0, 100.0, 5000.0):
        left = sum((part * np.exp(pole * since_s)).real for pole, part in terms)
        assert 1 + left == pytest.approx(followed(poles, duration_s + since_s, duration_s), abs=1e-9)


def test_a_lag_lets_little_of_a_fast_swing_through():
    assert gain(lag_poles([10.0]), 2 * np.pi * 10.0) == pytest.approx(1 / np.sqrt(2))  # at its corner
    assert gain((), 90.0) == 1


def soak(**changes):
    return Soak.model_validate(SOAK | {"until_stable": STABLE} | changes)


def wait(**changes):
    given = {"wait_until": "unit_temperature", "give_up_after": "2 h"} | changes
    return WaitUntil.model_validate(given)


def looked_at(step, at_s, act):
    """How long a soak takes on the temperatures of the simulated chamber, looked at as a run does."""
    grid_s = np.arange(0.0, at_s + step.give_up_after_s, 5.0)
    _, unit_c = simulated(grid_s, act=act)
    stable = step.until_stable
    for begin_s in itertools.count(at_s + step.at_least_s, 5.0):
        window = (grid_s >= begin_s - stable.hold_s) & (grid_s <= begin_s)
        slope = np.polyfit(grid_s[window] / 3600, unit_c[window], 1)[0]
        if np.ptp(unit_c[window]) <= stable.band_c and abs(slope) <= stable.slope_c_per_h:
            return begin_s - at_s
    raise AssertionError


def test_a_soak_ends_when_the_simulated_unit_is_stable():
    settling = Settling(BENCH)
    settling.ramp(20.0, 50.0, 0.0, 600.0)
    expected_s = looked_at(soak(), 600.0, lambda thermal: thermal.ramp(50.0, 3 / 60))
    assert 20 * 60 < expected_s < 30 * 60
    assert settling.soak_s(soak(), 600.0) == pytest.approx(expected_s, abs=30)  # noise takes a part of the band


def test_a_unit_that_warms_itself_has_to_settle_too_and_cools_when_it_is_switched_off():
    settling = Settling(BENCH)
    begin_s = 2 * 3600.0
    assert settling.soak_s(soak(), begin_s) == 60
    settling.power("supply", True, begin_s)
    warmed_s = settling.soak_s(soak(), begin_s)
    settling.power("supply", True, begin_s)
    assert settling.soak_s(soak(), begin_s) == warmed_s, "it was on already"
    assert warmed_s > 20 * 60
    settling.power("supply", False, 2 * begin_s)
    assert settling.soak_s(soak(), 2 * begin_s) == warmed_s


def test_a_soak_takes_its_least_time_when_all_is_still_by_then():
    settling = Settling(BENCH)
    settling.ramp(20.0, 50.0, 0.0, 600.0)
    assert settling.soak_s(soak(at_least="1 h"), 600.0) == 3600
    assert settling.soak_s(Soak.model_validate({"soak": "unit_temperature", "at_least": "5 min"}), 600.0) == 300


def test_stable_is_what_readings_have_shown_for_the_hold_time_which_begin_with_the_run():
    assert Settling(BENCH).soak_s(soak(at_least="5 s"), 0.0) == 570  # 95 % of 10 min
    assert Settling(BENCH).soak_s(soak(at_least="5 s"), 300.0) == 270
    assert Settling(BENCH).soak_s(soak(at_least="5 s"), 3600.0) == 5


def test_a_soak_that_nothing_lets_end_takes_as_long_as_it_may(tmp_path):
    assert Settling(BENCH).soak_s(soak(until_stable=STABLE | {"band": "0.02 °C"}), 0.0) == 4 * 3600  # of 0.03 °C noise
    restless = load_bench(copy_bench(tmp_path / "config", ("limit_cycle: 0.2 °C", "limit_cycle: 20 °C"))).bench
    assert Settling(restless).soak_s(soak(), 0.0) == 4 * 3600


def test_a_long_hold_time_is_looked_at_less_often():
    assert Settling(BENCH).soak_s(soak(until_stable=STABLE | {"hold": "3 h"}), 3600.0) == pytest.approx(
        0.95 * 3 * 3600 - 3600, abs=60
    )


def test_a_slower_unit_takes_longer(tmp_path):
    bench = load_bench(copy_bench(tmp_path / "config", ("[3 min, 1 min]", "[15 min, 4 min]"))).bench
    imu, bare = Settling(bench), Settling(BENCH)
    for settling in (imu, bare):
        settling.ramp(20.0, 30.0, 0.0, 600.0)
    assert imu.soak_s(soak(), 600.0) > 2.5 * bare.soak_s(soak(), 600.0)


def test_a_unit_of_which_nothing_is_stated_counts_as_a_bare_accelerometer():
    stated, usual = Settling(BENCH), Settling(load_bench(ROOT / "config/rate_table.yaml").bench)
    for settling in (stated, usual):
        settling.ramp(20.0, 30.0, 0.0, 600.0)
    assert stated.soak_s(soak(), 600.0) == usual.soak_s(soak(), 600.0)


@pytest.mark.parametrize(("hold", "later_s"), [("0 s", 0), ("1 min", 60), ("10 min", 570)])
def test_a_wait_ends_when_the_simulated_unit_is_warm_and_has_been_so_for_its_time(hold, later_s):
    settling = Settling(BENCH)
    settling.ramp(20.0, 50.0, 0.0, 600.0)
    grid_s = np.arange(0.0, 7200.0, 5.0)
    _, unit_c = simulated(grid_s, act=lambda thermal: thermal.ramp(50.0, 3 / 60))
    first_s = grid_s[np.argmax(unit_c > 45.0)]
    assert settling.wait_s(wait(above="45 °C", hold=hold), 0.0) == pytest.approx(first_s + later_s, abs=5)


def test_a_wait_for_what_is_so_already_takes_its_hold_time_and_one_in_vain_as_long_as_it_may():
    settling = Settling(BENCH)
    assert settling.wait_s(wait(below="30 °C"), 0.0) == 0
    assert settling.wait_s(wait(below="30 °C", hold="1 min"), 0.0) == 60
    assert settling.wait_s(wait(above="30 °C"), 0.0) == 7200
    assert settling.wait_s(wait(above="10 °C", below="15 °C", hold="119 min"), 0.0) == 7200


def test_what_will_never_be_so_is_not_looked_for_until_it_is_given_up():
    settling = Settling(BENCH)
    settling.ramp(20.0, 50.0, 0.0, 600.0)
    years = "100000 h"
    in_vain = soak(until_stable=STABLE | {"band": "0.02 °C"}, give_up_after=years)
    assert settling.soak_s(in_vain, 600.0) == settling.wait_s(wait(above="80 °C", give_up_after=years), 0.0) == 3.6e8
    held = wait(above="45 °C", hold="9000 h", give_up_after=years)
    assert settling.wait_s(held, 0.0) == pytest.approx(0.95 * 9000 * 3600, rel=1e-4)
    assert settling.wait_s(wait(above="45 °C", hold="9000 h", give_up_after="9001 h"), 0.0) < 9001 * 3600


def test_the_air_is_there_before_the_unit():
    settling = Settling(BENCH)
    settling.ramp(20.0, 50.0, 0.0, 600.0)
    air_s = settling.wait_s(wait(wait_until="chamber.process_value", above="45 °C"), 0.0)
    assert 500 < air_s < settling.wait_s(wait(above="45 °C"), 0.0) - 120


def test_a_soak_on_the_air_has_its_limit_cycle_in_the_band(tmp_path):
    reading = "readings:\n  air: {from: chamber.process_value}\n"
    settling = Settling(load_bench(copy_bench(tmp_path / "config", ("readings:\n", reading))).bench)
    stable = STABLE | {"slope": "10 °C/h"}
    assert settling.soak_s(soak(soak="air", until_stable=stable | {"band": "0.5 °C"}), 3600.0) == 4 * 3600
    assert settling.soak_s(soak(soak="air", until_stable=stable | {"band": "0.6 °C"}), 3600.0) == 60


@pytest.mark.parametrize("reading", ["supply.current", "counter.x", "counter.Temperatures.Converter", "nothing.at_all"])
def test_of_other_readings_only_the_hold_time_is_known(reading):
    unit = {"supply.current": "A", "counter.x": "pulse/s"}.get(reading, "°C")
    assert Settling(BENCH).wait_s(wait(wait_until=reading, above=f"1 {unit}", hold="1 min"), 0.0) == 60
