"""Thermostats, converters in the chamber, and current sources that err."""

from __future__ import annotations

import numpy as np
import pytest

from bench.config.load import load_file
from simulators.physics.source_errors import CurrentErrors, Feed
from simulators.physics.thermal import ChamberPhysics, Thermal, UnitPhysics
from simulators.units.accelerometer import Decoding, draw_unit
from simulators.units.unit_file import ThermostatModel, UnitFile
from simulators.units.unit_temperatures import Board, Thermostat, UnitTemperatures
from tests.support.sequences import ROOT

MODEL = ThermostatModel.model_validate(
    {"set_point": "65 °C", "band": "0.02 °C", "least_rise": "2 °C", "most_rise": "82 °C"}
)
CHANNEL = load_file(ROOT / "config/uut/if_channel.yaml", UnitFile)


def after(case_c, hours=2.0, start_c=20.0, powered=True, looks=100):
    thermostat = Thermostat(MODEL, sensor_s=60.0, thermometer_s=20.0, start_c=start_c)
    for at_s in np.linspace(0, 3600 * hours, looks + 1)[1:]:
        thermostat.advance(float(at_s), case_c, powered)
    return thermostat


@pytest.mark.parametrize("case_c", [-16.0, 10.0, 40.0, 62.9])
def test_it_holds_its_set_point_within_its_band(case_c):
    assert abs(after(case_c).sensor_c - 65) <= 0.02
    assert after(case_c).thermometer_c == pytest.approx(after(case_c).sensor_c, abs=1e-6)


@pytest.mark.parametrize("case_c", [63.5, 70.0])
def test_it_heats_only_and_loses_control_above_two_degrees_below_its_set_point(case_c):
    assert after(case_c).sensor_c == pytest.approx(case_c + 2)


def test_it_is_not_strong_enough_for_any_cold():
    assert after(-30.0).sensor_c == pytest.approx(52.0)


def test_without_power_it_is_as_warm_as_the_case():
    assert after(10.0, start_c=65.0, powered=False).sensor_c == pytest.approx(10.0)


def test_a_warmer_case_makes_it_warmer_by_a_two_thousandth():
    assert after(50.0).sensor_c - after(10.0).sensor_c == pytest.approx(40 / 2001, rel=1e-6)


def test_how_often_somebody_looks_changes_nothing():
    assert after(30.0, 0.02, looks=1).sensor_c == pytest.approx(after(30.0, 0.02, looks=500).sensor_c)


def test_a_board_in_the_chamber_lags_behind_a_ramp_by_its_time_constants():
    still = ChamberPhysics(limit_cycle_c=0.0)
    world = Thermal(still, (UnitPhysics(180, 60, 0, 20), UnitPhysics(180, 60, 0, 20, board_s=120)), 0.0)
    world.ramp(60.0, 25 / 3600)
    world.advance(3600.0)
    air_c, rate = world.air_c, 25 / 3600
    assert world.board_c(1) == pytest.approx(air_c - 120 * rate, abs=1e-6)
    assert world.board_thermometer_c(1) == pytest.approx(air_c - 140 * rate, abs=1e-6)
    assert world.sensor_c(0) == world.sensor_c(1)


def test_a_converter_drifts_as_its_file_says():
    truth = draw_unit(CHANNEL, 1, "a")
    current = np.array([1.13e-3])
    cold, at_25, warm = (truth.rate_pps(current, np.array([at_c]))[0] for at_c in (15.0, 25.0, 35.0))
    s, i = truth.pulses_per_a, float(current[0])
    slope, bend = (warm - cold) / 20, (warm - 2 * at_25 + cold) / 200
    assert slope == pytest.approx(s * i * (1 + truth.asymmetry / 2) * truth.alpha + truth.zero_drift_pps, rel=1e-9)
    assert bend == pytest.approx(s * i * (1 + truth.asymmetry / 2) * truth.alpha2, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "through", "scale", "terms"),
    [
        ("volts_channel", 500.0, 500.0, ("resistor_alpha", "resistor_alpha2", "zero_v", "zero_drift_v")),
        ("digital_channel", Decoding(), None, ("code_alpha", "code_alpha2", "zero_code", "zero_drift_code")),
    ],
)
def test_a_converter_that_makes_volts_or_codes_drifts_as_its_file_says(name, through, scale, terms):
    truth = draw_unit(load_file(ROOT / f"config/uut/{name}.yaml", UnitFile), 1, "a")
    scale, current_a = scale or truth.codes_per_a, 1.13e-3
    alpha, alpha2, zero, zero_drift = (getattr(truth, term) for term in terms)
    assert 0 not in (alpha, alpha2, zero, zero_drift)
    for warm_c in (-10.0, 0.0, 15.0):
        made = truth.output(np.array([current_a]), through, np.array([25.0 + warm_c]))
        due = scale * current_a * (1 + alpha * warm_c + alpha2 * warm_c**2) + zero + zero_drift * warm_c
        assert made[0] == pytest.approx(due, rel=1e-12)
    assert truth.output(np.array([current_a]), through) == pytest.approx(scale * current_a + zero, rel=1e-12)


def test_a_board_was_a_moment_ago_where_its_rate_says_however_long_nobody_looked():
    ramped = Thermal(ChamberPhysics(limit_cycle_c=0.0), (UnitPhysics(180, 60, 0, 20, 120),), 0.0)
    unit = load_file(ROOT / "config/uut/volts_channel.yaml", UnitFile)
    warmth = UnitTemperatures(ramped, 0, unit, 20.0, 20.0)
    board = Board(warmth)
    ramped.ramp(60.0, 25 / 3600)
    ramped.advance(3600.0)
    rate = 25 / 3600
    assert board.just_before_c(3600.0, 1.0, 0.0) == pytest.approx(ramped.board_c(0) - rate, abs=1e-6)
    (state,) = board.history.rows.tolist()
    assert state[:2] == [3600.0, ramped.board_c(0)]


def test_a_source_drifts_faster_until_it_is_warm_and_not_at_zero():
    errors = CurrentErrors(gain=20e-6, offset_a=1e-8, drift_per_h=1e-6)
    hours = np.array([0.0, 1.0, 2.0, 3.0])
    relative = (errors.current_a(1e-3, 3600 * hours) - 1e-8) / 1e-3 - 1
    assert relative == pytest.approx([10e-6, 15e-6, 20e-6, 21e-6], abs=1e-12)
    assert errors.current_a(0.0, 3600 * hours) == pytest.approx([1e-8] * 4)


def test_a_source_that_is_off_gives_nothing_not_even_its_offset():
    class Off:
        feeds_a = None

    assert Feed(Off(), CurrentErrors(offset_a=1e-8)).current_a(np.zeros(3)).tolist() == [0, 0, 0]
