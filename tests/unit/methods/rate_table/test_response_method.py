"""Frequency responses on counts that were made from a known sensor: what is found, left out and told."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from bench.methods.rate_table.method import ACCELEROMETER_RESPONSE, GYRO_RESPONSE
from bench.methods.rate_table.reduction.response import reduce_accelerometer, reduce_gyro
from bench.report.flag_words import flag_in_words
from simulators.physics.dynamics import Dynamics
from tests.support.flags import flag_of, texts
from tests.support.table_runs import BENCH, UNIT, at_rest, data, swinging

PER_DEG, PER_G = 4000.0, 1e5
SLOW = Dynamics(40.0, 0.6, 1e-3)
ARMS_M = (0.06, 0.05)
SWEEP_HZ = (10.37, 20.37, 30.37, 38.37, 42.37, 60.37)


def gyro_at(frequency_hz, dynamics=SLOW, amplitude_dps=20.0, **reported):
    response = dynamics.response(np.array([frequency_hz]))[0]
    reach = amplitude_dps / (2 * np.pi * frequency_hz) * PER_DEG

    def charge(phase, time_s):
        return reach * np.imag(response * np.exp(1j * phase)) + 20 * time_s

    return swinging(frequency_hz, charge, amplitude_dps, **reported)


def accelerometer_at(frequency_hz, amplitude_dps, arms_m=ARMS_M, drift=50.0):
    """The velocity that an input axis along X senses, in pulses; the rate is A cos of the phase."""
    x_m, y_m = arms_m
    once, twice = SLOW.response(np.array([frequency_hz, 2 * frequency_hz]))
    a_rps, omega = np.radians(amplitude_dps), 2 * np.pi * frequency_hz
    per_mps = PER_G / BENCH.gravity_mps2

    def charge(phase, time_s):
        tangential = -y_m * a_rps * np.real(once * np.exp(1j * phase))
        centripetal = -x_m * a_rps**2 / 2 * (time_s + np.imag(twice * np.exp(2j * phase)) / (2 * omega))
        return per_mps * (tangential + centripetal) + drift * time_s

    return swinging(frequency_hz, charge, amplitude_dps)


def gyro(*acquisitions, **settings):
    chosen = GYRO_RESPONSE.settings.model_validate({"scale": f"{PER_DEG} pulse/°"} | settings).model_dump()
    (unit,) = reduce_gyro(data(*acquisitions), chosen)
    return unit


def accelerometer(*acquisitions, unit=UNIT, **settings):
    given = {"scale": f"{PER_G} pulse/s/g", "lever_frequency": "1 Hz"} | settings
    chosen = ACCELEROMETER_RESPONSE.settings.model_validate(given).model_dump()
    (found,) = reduce_accelerometer(data(*acquisitions, unit=unit), chosen)
    return found


def values(unit, quantity):
    return [found.value for found in unit.findings if found.quantity == quantity]


def test_gain_phase_bandwidth_and_equation_of_a_gyro():
    unit = gyro(*map(gyro_at, reversed(SWEEP_HZ)))  # in any order
    response = SLOW.response(np.array(SWEEP_HZ))
    assert values(unit, "gain") == pytest.approx(np.abs(response), rel=1e-3)
    assert values(unit, "phase") == pytest.approx(np.degrees(np.unwrap(np.angle(response))), abs=0.05)
    (bandwidth,) = (found for found in unit.findings if found.quantity == "bandwidth")
    assert abs(bandwidth.value - 40.0) < 2 * bandwidth.u + 0.05
    (model,) = unit.models
    assert model.constants["f0"].value == pytest.approx(SLOW.natural_hz, abs=0.05)
    assert model.constants["delay"].value == pytest.approx(1e-3, abs=2e-5)
    assert model.constants["delay"].u > BENCH.encoder_skew_u_s
    assert (texts(unit.flags), unit.left_out) == ((), ())


def test_the_waveform_of_a_gyro_is_that_at_its_bandwidth_or_as_asked():
    wave = gyro(*map(gyro_at, SWEEP_HZ)).detail.waveform
    response = abs(SLOW.response(np.array([38.37]))[0])
    assert (wave.frequency_hz, wave.unit) == (38.37, "°/s")
    assert wave.gain == pytest.approx(response, rel=1e-3)
    assert np.max(wave.reference) == pytest.approx(20 * np.sinc(0.03837), rel=3e-3)
    assert np.max(wave.output) == pytest.approx(20 * response * np.sinc(0.03837), rel=3e-2)  # counts within 1 ms
    assert gyro(*map(gyro_at, SWEEP_HZ), waveform_at="59 Hz").detail.waveform.frequency_hz == 60.37
    assert gyro(*map(gyro_at, SWEEP_HZ[:3])).detail.waveform.frequency_hz == 30.37  # the bandwidth is not reached
    assert gyro(at_rest(1.0)).detail.waveform is None


def test_the_two_sample_reference_has_the_gain_of_an_accelerometer():
    swings = accelerometer_at(1.0, 100.0), *(accelerometer_at(hz, 100.0) for hz in SWEEP_HZ)
    unit = accelerometer(*swings, waveform_at="60.37 Hz")
    (gain,) = (found for found in unit.findings if found.quantity == "gain/two_sample")
    by_sines = next(
        f for f in unit.findings if f.quantity == "gain" and f.at["frequency_hz"] == gain.at["frequency_hz"]
    )
    over = abs(SLOW.response(np.array([60.37]))[0] / SLOW.response(np.array([1.0]))[0])
    assert gain.value == pytest.approx(over, rel=2e-3)
    assert gain.value == pytest.approx(by_sines.value, rel=2e-4)  # without the factor of the formula 1.2 % more
    assert gain.u == pytest.approx(by_sines.u, rel=1e-3)
    wave = unit.detail.waveform
    assert wave.unit == "m/s²"
    size = np.radians(100.0) * 2 * np.pi * 60.37 * 0.05
    assert np.ptp(wave.reference) / 2 == pytest.approx(size, rel=2e-2)


def test_the_budgets_name_what_is_shared():
    unit = gyro(*map(gyro_at, SWEEP_HZ))
    budgets = {found.quantity: found.budget for found in unit.findings}
    phase = next(line for line in budgets["phase"] if line.shared == "counter.encoder_skew")
    assert phase.u == pytest.approx(360 * SWEEP_HZ[-1] * 5e-5, rel=1e-6)
    assert any(line.shared == "table.harmonics" for line in budgets["gain"])
    assert any(line.source.startswith("straight line between") for line in budgets["bandwidth"])


def test_gains_may_be_over_that_at_the_lowest_frequency():
    doubled = [gyro_at(hz) for hz in SWEEP_HZ]
    unit = gyro(*doubled, scale=f"{PER_DEG / 2} pulse/°", gain_reference="lowest")
    assert values(unit, "gain")[0] == 1
    assert values(unit, "gain")[-1] == pytest.approx(
        abs(SLOW.response(np.array([60.37]))[0] / SLOW.response(np.array([10.37]))[0]), rel=1e-3
    )
    assert next(found for found in unit.findings if found.quantity == "gain").budget == ()


def test_a_bandwidth_that_is_not_reached_or_below_the_sweep_is_told():
    (above,) = gyro(*map(gyro_at, SWEEP_HZ[:3])).flags
    assert texts(gyro(*map(gyro_at, SWEEP_HZ[4:])).flags) == ("bandwidth_below_at_start",)
    assert str(above) == "bandwidth_not_reached"
    assert "above that" in flag_in_words(above)


def test_a_gain_that_falls_through_the_bandwidth_twice_is_told():
    dead, quick = Dynamics(8.0, 0.6, 1e-3), Dynamics(400.0, 0.6, 1e-3)
    swings = [(10.37, SLOW), (20.37, dead), (30.37, quick), (38.37, quick), (60.37, SLOW)]
    several = flag_of(gyro(*(gyro_at(hz, dynamics) for hz, dynamics in swings)).flags, "several_crossings")
    assert "several_crossings" not in texts(gyro(*map(gyro_at, SWEEP_HZ)).flags)
    assert "more than once" in flag_in_words(several)


def test_frequencies_that_tell_nothing_are_left_out_and_told():
    still = replace(at_rest(50.0), motion=gyro_at(25.37).motion)
    drooped = gyro_at(50.37, amplitude_dps=8.0)
    unit = gyro(*map(gyro_at, SWEEP_HZ), still, drooped, at_rest(1.0))
    assert texts(unit.flags) == ("steps/n=8/acquire: not_swinging", "25.37 Hz invalid", "50.37 Hz droop")
    assert unit.left_out == ("n=8/acquire", "25.37 Hz")
    assert len(values(unit, "gain")) == len(SWEEP_HZ)
    assert "less than half of the amplitude" in flag_in_words(flag_of(unit.flags, "50.37 Hz droop"))
    assert texts(gyro(at_rest(1.0)).flags) == ("steps/n=0/acquire: not_swinging", "no_response")


def test_a_swing_of_too_few_pulses_is_left_out_with_what_to_do():
    few = accelerometer_at(60.37, 0.3)  # of 2.1 pulses, which the converter counts as a few tenths
    unit = accelerometer(accelerometer_at(1.0, 100.0), *(accelerometer_at(hz, 40.0) for hz in SWEEP_HZ[:-1]), few)
    (flag,) = unit.flags
    assert str(flag) == "60.37 Hz few_pulses"
    assert "larger peak rate" in flag_in_words(flag)
    assert (unit.left_out, unit.verdict) == (("60.37 Hz",), "INCOMPLETE")
    assert len(values(unit, "gain")) == len(SWEEP_HZ) - 1
    assert values(unit, "bandwidth") == pytest.approx([40.0], abs=0.1)
    of_a_gyro = gyro(*(gyro_at(hz) for hz in SWEEP_HZ), gyro_at(25.37, amplitude_dps=0.03))
    assert texts(of_a_gyro.flags) == ("25.37 Hz few_pulses",)
    again = gyro_at(10.37, amplitude_dps=0.03), *map(gyro_at, SWEEP_HZ)
    assert gyro(*again).flags == ()  # the last one counts


def test_a_bandwidth_is_not_said_to_be_above_frequencies_that_are_left_out():
    """The response falls, and with it the pulses: the last one with enough of them is no end of the sweep."""
    small = [gyro_at(hz, amplitude_dps=0.1 * hz / 10.37) for hz in SWEEP_HZ[:2]]
    unit = gyro(*small, *(gyro_at(hz, amplitude_dps=0.0013 * hz) for hz in SWEEP_HZ[2:]))
    assert values(unit, "bandwidth") == []
    flag = flag_of(unit.flags, "bandwidth_left_out")
    assert "up to 20.37 Hz" in flag_in_words(flag)
    assert "bandwidth_not_reached" not in texts(unit.flags)
    drooped = gyro(*map(gyro_at, SWEEP_HZ[:3]), gyro_at(50.37, amplitude_dps=8.0))
    assert texts(drooped.flags) == ("50.37 Hz droop", "bandwidth_left_out")
    lower = gyro(gyro_at(10.37, amplitude_dps=0.01), *map(gyro_at, SWEEP_HZ[1:3]))
    assert texts(lower.flags) == ("10.37 Hz few_pulses", "bandwidth_not_reached")


def test_arms_of_too_few_pulses_are_no_arms():
    unit = accelerometer(accelerometer_at(1.0, 0.1, drift=2.0), *(accelerometer_at(hz, 40.0) for hz in SWEEP_HZ))
    assert texts(unit.flags) == ("1 Hz few_pulses", "no_response")
    assert (unit.findings, unit.left_out) == ((), ("1 Hz", "response"))


@pytest.mark.parametrize("play", ["0 pulse", "1 pulse"])
def test_a_dead_output_has_no_gain(play):
    dead = replace(gyro_at(25.37), counts=at_rest(0.0).counts)
    assert texts(gyro(*map(gyro_at, SWEEP_HZ), dead, play=play).flags) == ("25.37 Hz few_pulses",)


@pytest.mark.parametrize("frequency_hz", [100.0, 50.0, 44.0, 59.0, 71.0, 44.37])
def test_what_the_encoder_leaves_at_phases_that_repeat_is_in_the_uncertainty(frequency_hz):
    """An ideal sensor on an ideal encoder: errors at whole frequencies are those of its resolution alone."""
    ideal, ratios = Mock(response=np.ones_like), []
    for amplitude_dps in np.linspace(3.0, 3.2, 12):
        unit = gyro(gyro_at(frequency_hz, ideal, amplitude_dps))
        (gain,) = (found for found in unit.findings if found.quantity == "gain")
        own = np.linalg.norm([line.u for line in gain.budget if line.type == "A"])
        ratios.append((gain.value - 1) / own)
    assert np.max(np.abs(ratios)) < 3.5
    assert 0.4 < np.sqrt(np.mean(np.square(ratios))) < 1.5


def test_samples_that_see_few_phases_and_a_table_off_its_frequency_are_told():
    flags = gyro(gyro_at(10.37), gyro_at(100.0, amplitude_dps=12.0), gyro_at(30.42, told_hz=30.37)).flags
    assert "100 Hz few_phases" in texts(flags)
    assert "30.37 Hz off_frequency" in texts(flags)
    assert all(flag_in_words(flag) != str(flag) for flag in flags)


def test_an_accelerometer_finds_its_arms_and_its_gains_over_the_slow_swing():
    unit = accelerometer(accelerometer_at(1.0, 100.0), *(accelerometer_at(hz, 40.0) for hz in SWEEP_HZ))
    assert values(unit, "lever_arm/x") == pytest.approx([0.06], rel=2e-3)
    assert values(unit, "lever_arm/y") == pytest.approx([0.05], rel=2e-3)
    response = SLOW.response(np.array([1.0, *SWEEP_HZ]))
    assert values(unit, "gain") == pytest.approx(np.abs(response[1:] / response[0]), rel=2e-3)
    assert values(unit, "phase") == pytest.approx(np.degrees(np.unwrap(np.angle(response[1:]))), abs=0.1)
    (arm,) = (found for found in unit.findings if found.quantity == "lever_arm/y")
    leak = {line.source: line.u for line in arm.budget}
    assert leak["axis: level"] == pytest.approx(9.8 * np.radians(5e-4) / (2 * np.pi) ** 2, rel=1e-3)
    (found, *_) = (each for each in unit.findings if each.quantity == "gain")
    assert {line.shared for line in found.budget} >= {"fixture.level", "range/a/lever_arm/y"}


def test_an_arm_that_is_short_or_elsewhere_is_told():
    swings = [
        accelerometer_at(1.0, 100.0, (0.06, 0.003)),
        *(accelerometer_at(hz, 90.0, (0.06, 0.003)) for hz in SWEEP_HZ),
    ]
    assert "lever_arm_short" in texts(accelerometer(*swings).flags)
    elsewhere = replace(UNIT, arm_m=(0.06, -0.05, 0.0), arm_u_m=1e-4)
    unit = accelerometer(accelerometer_at(1.0, 100.0), accelerometer_at(10.37, 40.0), unit=elsewhere)
    assert "lever_arm_unlike_bench_file" in texts(unit.flags)
    where_it_is = replace(UNIT, arm_m=(*ARMS_M, 0.0), arm_u_m=1e-4)
    unit = accelerometer(accelerometer_at(1.0, 100.0), accelerometer_at(10.37, 40.0), unit=where_it_is)
    assert "lever_arm_unlike_bench_file" not in texts(unit.flags)


def test_without_the_slow_swing_there_is_no_response():
    unit = accelerometer(*(accelerometer_at(hz, 40.0) for hz in SWEEP_HZ))
    assert texts(unit.flags) == ("1 Hz invalid", "no_response")
    assert (unit.findings, unit.left_out) == ((), ("1 Hz", "response"))


def test_a_scale_that_warms_is_in_the_gains():
    cold, *warm = [accelerometer_at(1.0, 100.0), *(accelerometer_at(hz, 40.0) for hz in SWEEP_HZ)]
    warm = [replace(each, temperatures_c={"warm": np.array([25.5])}) for each in warm]
    (found, *_) = (each for each in accelerometer(cold, *warm).findings if each.quantity == "gain")
    line = next(line for line in found.budget if line.source.startswith("scale factor: temperature"))
    assert line.u == pytest.approx(5 * 6e-5, rel=0.05)


def test_the_calibration_takes_amplitude_and_phase_back_within_the_sweep():
    unit = gyro(*map(gyro_at, SWEEP_HZ))
    (known,) = unit.compensations
    assert known.channel.endswith("@response")
    frequency_hz = np.array([15.0, 45.0, 90.0])
    response = SLOW.response(frequency_hz)
    amplitude, phase_deg, beyond = known.apply(
        12 * PER_DEG * np.abs(response), 30 + np.degrees(np.angle(response)), frequency_hz
    )
    assert amplitude[:2] == pytest.approx([12, 12], rel=1e-3)
    assert phase_deg[:2] == pytest.approx([30, 30], abs=0.1)
    assert beyond.tolist() == [False, False, True]
    amplitude, phase_deg, _ = known.apply(np.ones(3), np.zeros(3), frequency_hz, "reject")
    assert np.isnan([amplitude[2], phase_deg[2]]).all()


def test_without_an_equation_there_is_no_calibration():
    assert gyro(*map(gyro_at, SWEEP_HZ[:3])).compensations == ()
