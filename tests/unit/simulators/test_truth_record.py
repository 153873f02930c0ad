"""The truth against the reductions: a bench without errors finds it exactly, and each error shows where it should."""

import dataclasses
import json
import math
from typing import Any

import numpy as np
import pytest

from bench.methods.tumble.reduction.solution import Tumble, solve_tumble
from bench.metrology.acquisition import Counts
from bench.metrology.pulse_counts import mean_rate
from drivers.dialects.can_counter.wire import decode_counts
from simulators.physics.motion import AxisErrors
from simulators.truth.constants import DwellAsMeasured, Orientation, channel_constants, in_one_plane, truth_record
from simulators.units.accelerometer import draw_unit
from simulators.units.unit_file import UnitFile
from simulators.units.unit_temperatures import ThermometerErrors
from tests.support.laboratory import ARCSEC_DEG, Laboratory, counter_form, place, unit
from tests.support.planar import planar

FOUR_DEG = (0.0, 90.0, 180.0, 270.0)
TILTED_DEG = (1.0, 91.0, 181.0, 271.0)
ARCSEC = math.radians(ARCSEC_DEG)
LIKE_REAL: dict[str, Any] = {
    "accelerometer": {
        "K0": {"at_reference": "0.8 mg", "linear": "10 µg/°C"}, "K1": {"at_reference": "1.13 mA/g"}, "K2": "20 µg/g²",
        "K3": "0.05 µg/g³", "Kip": "5 µg/g²", "misalignment_o": "0.3 mrad", "misalignment_p": "-0.5 mrad",
    },
    "converter": {
        "S": "10 kHz/mA", "full_scale": "25.6 mA", "max_rate": "256 kHz", "asymmetry": "30 ppm", "zero": "2 pulse/s",
        "nonlinearity": "30 ppm", "dead_band": "20 nA",
    },
}  # fmt: skip


def powered(unit_file: UnitFile, **settings: Any) -> Laboratory:
    lab = Laboratory(place(unit=unit_file), **settings)
    lab.world.power("supply", True)
    return lab


def tumbled(lab: Laboratory, head_deg: tuple[float, ...], sense: int = 1, offset_deg: float = 0.0) -> Tumble:
    """The charge at each position, solved as a dwell is: at the angles that the head indicates."""
    rates = []
    for angle_deg in head_deg:
        lab.world.move(angle_deg, 20)
        lab.wait(20)
        lab.world.units["a"].charge_pulses(np.array([lab.world.now() - 1, lab.world.now()]))
        rates.append(lab.rate_pps())
    return solve_tumble(np.radians(sense * np.array(head_deg) + offset_deg), np.array(rates))


def constants(found: Tumble) -> dict[str, float]:
    return {"K0": found.k0_g, "K1": found.k1, "K2": found.k2_g_per_g2, "misalignment": found.misalignment_rad}


def difference(found: Tumble, truth: dict[str, float]) -> dict[str, float]:
    """Found less true; K1 relative."""
    values = constants(found)
    return {key: (value - truth[key]) / (truth[key] if key == "K1" else 1) for key, value in values.items()}


def true_constants(lab: Laboratory, axis_deg: tuple[float, ...], temperature_c: float = 20.0) -> dict[str, float]:
    settings, truth = lab.world.settings, lab.world.units["a"].truth
    return channel_constants(truth, settings.gravity_mps2, in_one_plane(axis_deg), temperature_c, 0.0)


# A perfect bench


@pytest.mark.parametrize("head_deg", [FOUR_DEG, TILTED_DEG, TILTED_DEG + TILTED_DEG[::-1]])
@pytest.mark.parametrize(("sense", "offset_deg"), [(1, 0.0), (-1, 90.0)])
def test_a_perfect_bench_finds_the_truth_exactly(head_deg: tuple[float, ...], sense: int, offset_deg: float) -> None:
    lab = powered(unit(**LIKE_REAL), fixture=planar(sense, offset_deg))
    axis_deg = tuple(sense * angle + offset_deg for angle in head_deg)
    error = difference(tumbled(lab, head_deg, sense, offset_deg), true_constants(lab, axis_deg))
    assert error == pytest.approx(dict.fromkeys(error, 0), abs=1e-12)


def test_a_perfect_bench_that_counts_finds_it_within_a_count() -> None:
    lab = powered(unit(**LIKE_REAL))
    counter, rates, gate_s = lab.counter(), [], 200
    for angle_deg in TILTED_DEG:
        lab.world.move(angle_deg, 20)
        lab.wait(20)
        counter.take()
        lab.wait(gate_s)
        raw = decode_counts(counter_form(), "x", counter.take())
        rates.append(mean_rate(as_counts(raw)).net_pps)
    error = difference(solve_tumble(np.radians(TILTED_DEG), np.array(rates)), true_constants(lab, TILTED_DEG))
    worst = 1 / (gate_s - 0.1) / 11_300
    assert {key: abs(value) < 3 * worst for key, value in error.items()} == dict.fromkeys(error, True)


def as_counts(raw: Any) -> Counts:
    names = {field.name for field in dataclasses.fields(Counts)} - {"tick_period_s", "max_rate_pps", "shift"}
    return Counts(**{name: getattr(raw, name) for name in names}, tick_period_s=1e-6, max_rate_pps=256_000)


def test_the_constants_are_those_of_the_channel() -> None:
    """K1 holds K3, K0 the converter's zero, K2 its asymmetry (equations 8.8)."""
    truth = draw_unit(unit(converter={"S": "10 kHz/mA", "full_scale": "25 mA", "max_rate": "256 kHz",
                                      "zero": "2 pulse/s", "asymmetry": "30 ppm"},
                           accelerometer={"K0": {"at_reference": "0 g"}, "K1": {"at_reference": "1.13 mA/g"},
                                          "K3": "0.05 µg/g³"}), 1, "a")  # fmt: skip
    found = channel_constants(truth, 9.8, in_one_plane(FOUR_DEG), 20.0, 1e-6)
    k1 = 11_300 * (1 + 5e-8)
    assert found["K1"] == pytest.approx(k1, rel=1e-9)
    assert found["K1_si"] == pytest.approx(k1 / 9.8, rel=1e-9)
    assert found["K0"] == pytest.approx(2 / 11_300 + 1e-6, rel=1e-6)  # 177 µg
    assert found["K2"] == pytest.approx(15e-6, rel=1e-3)
    assert found["misalignment"] == pytest.approx(0, abs=1e-12)


# Each error of a bench, where equations 1.9 says


def bench_error(head_deg: tuple[float, ...] = FOUR_DEG, **settings: Any) -> dict[str, float]:
    lab = powered(unit(), **settings)
    return difference(tumbled(lab, head_deg), true_constants(lab, head_deg))


@pytest.mark.parametrize(
    "settings", [{"axes": {"head": AxisErrors(zero_deg=5 * ARCSEC_DEG)}}, {"level_deg": 5 * ARCSEC_DEG}]
)
def test_zero_and_level_errors_go_into_the_misalignment(settings: Any) -> None:
    error = bench_error(**settings)
    assert error["misalignment"] == pytest.approx(5 * ARCSEC, rel=1e-6)
    assert [error["K0"], error["K1"], error["K2"]] == pytest.approx([0, 0, 0], abs=1e-9)


def test_a_first_harmonic_in_cosine_goes_into_the_bias() -> None:
    error = bench_error(axes={"head": AxisErrors(cosines=(1 * ARCSEC_DEG,), sines=(0.0,))})
    assert error["K0"] == pytest.approx(4.848e-6, rel=1e-3)
    assert error["K2"] == pytest.approx(-4.848e-6, rel=1e-3)
    assert [error["K1"], error["misalignment"]] == pytest.approx([0, 0], abs=1e-9)


def test_a_second_harmonic_in_cosine_goes_into_the_misalignment() -> None:
    error = bench_error(axes={"head": AxisErrors(cosines=(0.0, 1 * ARCSEC_DEG), sines=(0.0, 0.0))})
    assert error["misalignment"] == pytest.approx(ARCSEC, rel=1e-6)
    assert error["K0"] == pytest.approx(0, abs=1e-9)


def test_the_device_clock_goes_into_the_scale_factor_one_to_one() -> None:
    lab = powered(unit(), device_clock=10e-6, host_clock=50e-6)
    lab.world.move(90, 20)
    lab.wait(20)
    counter = lab.counter()
    lab.wait(10_000)
    rate = mean_rate(as_counts(decode_counts(counter_form(), "x", counter.take())))
    assert rate.net_pps / 10_000 - 1 == pytest.approx(-10e-6, abs=1e-8)


def test_gravity_goes_into_the_scale_factor_per_metre_per_second_squared_alone() -> None:
    here, there = (powered(unit(**LIKE_REAL), gravity_mps2=g) for g in (9.8, 9.8 * (1 + 1e-5)))
    first, second = (true_constants(lab, TILTED_DEG) for lab in (here, there))
    assert second.pop("K1_si") / first.pop("K1_si") - 1 == pytest.approx(-1e-5, rel=1e-4)
    assert first == second
    assert constants(tumbled(here, TILTED_DEG)) == constants(tumbled(there, TILTED_DEG))


def test_a_thermometer_goes_into_the_temperature_at_which_the_truth_is_told() -> None:
    lab = powered(unit(**LIKE_REAL))
    warmer = true_constants(lab, TILTED_DEG, 20.5)
    assert warmer["K0"] - true_constants(lab, TILTED_DEG, 20.0)["K0"] == pytest.approx(5e-6, rel=1e-3)


# The record of a run


def test_a_dwell_has_the_hysteresis_drift_and_warm_up_of_its_middle_though_the_unit_is_off_by_now() -> None:
    slow = {
        "hysteresis": {"amplitude": "60 µg", "thresholds": ["5 °C", "10 °C"]}, "drift": "8.64 mg/day",
        "warm_up": {"amplitude": "50 µg", "time_constant": "20 min"},
    }  # fmt: skip
    lab = Laboratory(place(unit=unit(accelerometer=slow), mount_angle_deg=2.0), host_clock=1e-4)
    counter = lab.counter()
    lab.wait(5000)
    lab.world.power("supply", True)
    lab.world.ramp(60, 3 / 60)
    for _ in range(700):
        lab.wait(10)
        counter.take()
    lab.world.power("supply", False)
    lab.wait(5000)
    counter.take()
    dwell = DwellAsMeasured(
        "tumble/a@temperature=60",
        "a",
        8600.0,
        60.25,
        tuple(Orientation((angle,)) for angle in (1.0, 91.0, 181.0, 271.0)),
    )
    record = json.loads(json.dumps(truth_record(lab.world, [dwell])))
    found = record["dwells"]["tumble/a@temperature=60"]
    true_s = 8600 * (1 + 1e-4)
    drifted_g = 60e-6 + 1e-7 * true_s + 50e-6 * math.exp(-(true_s - 5000.5) / 1200)
    assert found["drifted_g"] == pytest.approx(drifted_g, abs=1e-10)
    assert np.array(found["forces_g"]) == pytest.approx(in_one_plane([3.0, 93.0, -177.0, -87.0]), abs=1e-12)
    assert found["temperature_c"] == 60.25
    assert found["K0"] == pytest.approx(drifted_g, rel=1e-9)
    assert found["K1_si"] == pytest.approx(10_000 / 9.8)


def test_the_record_tells_the_errors_of_the_bench_and_the_unit_as_drawn() -> None:
    axis = AxisErrors(zero_deg=0.001, cosines=(0.002,), sines=(0.003,), backlash_deg=0.004, repeatability_deg=0.005)
    lab = Laboratory(
        place(unit=unit(**LIKE_REAL), thermometer=ThermometerErrors(0.3, 0.001)),
        seed=7, device_clock=1e-6, host_clock=2e-5, level_deg=0.006, axes={"head": axis},
    )  # fmt: skip
    record = json.loads(json.dumps(truth_record(lab.world, [])))
    assert record["schema"] == "itb-truth/1"
    assert record["seed"] == 7
    assert record["bench"] == {
        "gravity_mps2": 9.8, "host_clock": 2e-5, "device_clock": 1e-6, "level_deg": 0.006, "level_drift_deg": 0.0,
        "axes": {"head": {"zero_deg": 0.001, "cosines": [0.002], "sines": [0.003], "backlash_deg": 0.004,
                          "repeatability_deg": 0.005, "table": [[], []]}},
        "thermometers": {"a": {"offset_c": 0.3, "gain": 0.001, "drift_c": 0.0, "table": [[], []]}},
    }  # fmt: skip
    assert record["units"]["a"]["k2"] == pytest.approx(20e-6)
    assert record["dwells"] == {}
