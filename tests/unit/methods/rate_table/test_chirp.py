"""Responses of continuous sweeps, against a sensor whose output is computed in small steps of time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from bench.methods.rate_table.method import ACCELEROMETER_RESPONSE, GYRO_RESPONSE
from bench.methods.rate_table.reduction import chirp
from bench.methods.rate_table.reduction.response import reduce_accelerometer, reduce_gyro
from bench.metrology.acquisition import Motion
from bench.report.flag_words import flag_in_words
from simulators.physics.dynamics import Dynamics
from tests.support.flags import texts
from tests.support.table_runs import BENCH, SENT, acquired, at_rest, data, sent

PER_DEG, FINE = 4000.0, 20
SLOW = Dynamics(40.0, 0.6)
SWEEP_S, FIRST_HZ, LAST_HZ, AMPLITUDE_DEG = 40.0, 10.0, 90.0, 0.05
FINE_S = np.arange(int(1000 * FINE * (SWEEP_S + 1)) + 1) / (1000 * FINE)  # the sweep begins half a second late
LATCHES = slice(None, None, FINE)


def angle_deg(amplitude_deg=AMPLITUDE_DEG):
    swept_s = np.clip(FINE_S - 0.5, 0, SWEEP_S)
    slope = (LAST_HZ - FIRST_HZ) / SWEEP_S
    turns = FIRST_HZ * FINE_S + slope * swept_s**2 / 2 + slope * SWEEP_S * np.maximum(FINE_S - 0.5 - SWEEP_S, 0)
    return amplitude_deg * np.sin(2 * np.pi * turns + 0.3)


def filtered(values):
    """Output of the sensor, a differential equation solved between points a twentieth of a millisecond apart."""
    omega = 2 * np.pi * SLOW.natural_hz
    system = [omega**2], [1, 2 * SLOW.damping * omega, omega**2]
    forward, backward, _ = signal.cont2discrete(system, FINE_S[1], "foh")
    return signal.lfilter(forward[0], backward, values)


def motion(**more):
    return Motion("table", amplitude_deg=AMPLITUDE_DEG, sweep_hz=(FIRST_HZ, LAST_HZ), sweep_s=SWEEP_S, **more)


def swept(charge, amplitude_deg=AMPLITUDE_DEG):
    return acquired((charge + 20 * FINE_S)[LATCHES], angle_deg(amplitude_deg)[LATCHES], motion=motion())


def gyro(*acquisitions, unit=None, **settings):
    chosen = {"scale": [f"{PER_DEG} pulse/°", "1000 code/(°/s)"]} | settings
    known = GYRO_RESPONSE.settings.model_validate(chosen).model_dump()
    found = data(*acquisitions) if unit is None else data(*acquisitions, unit=unit)
    (result,) = reduce_gyro(found, known)
    return result


def ratios(unit, quantity="gain"):
    """Errors over their standard uncertainties without those of the bench, which these data do not have."""
    found = [each for each in unit.findings if each.quantity == quantity]
    response = SLOW.response(np.array([each.at["frequency_hz"] for each in found]))
    true = np.abs(response) if quantity == "gain" else np.degrees(np.unwrap(np.angle(response)))
    own = [np.linalg.norm([line.u for line in each.budget if line.type == "A"]) for each in found]
    return (np.array([each.value for each in found]) - true) / own


def test_gain_and_phase_of_a_sweep_are_those_of_the_sensor():
    unit = gyro(swept(PER_DEG * filtered(angle_deg())))
    gains, phases = ratios(unit), ratios(unit, "phase")
    assert len(gains) > 15
    assert np.sqrt(np.mean(gains**2)) < 1.6
    assert np.sqrt(np.mean(phases**2)) < 1.6
    (bandwidth,) = (each for each in unit.findings if each.quantity == "bandwidth")
    assert bandwidth.value == pytest.approx(40.0, abs=0.05)
    assert (texts(unit.flags), unit.left_out) == ((), ())


@pytest.mark.slow
def test_a_fast_sweep_without_its_correction_is_seen(monkeypatch):
    monkeypatch.setattr(chirp, "_settled", lambda windows: np.array([each.output / each.angle for each in windows]))
    assert np.sqrt(np.mean(ratios(gyro(swept(PER_DEG * filtered(angle_deg())))) ** 2)) > 2.5


@pytest.mark.slow
def test_the_play_of_a_converter_is_taken_out_of_its_counts():
    few = swept(PER_DEG / 8 * filtered(angle_deg()))  # 6 to 25 pulses, counted with a play of one
    assert np.sqrt(np.mean(ratios(gyro(few, scale=f"{PER_DEG / 8} pulse/°")) ** 2)) < 1.8
    assert np.mean(ratios(gyro(few, scale=f"{PER_DEG / 8} pulse/°", play="0 pulse"))) < -3


@pytest.mark.slow
def test_windows_of_too_few_pulses_are_left_out_and_the_others_hold():
    """From 8 pulses down to 1: the play is a large part, and the same steps repeat from period to period."""
    few = swept(PER_DEG / 50 * filtered(angle_deg()))
    unit = gyro(few, scale=f"{PER_DEG / 50} pulse/°")
    found = [each.at["frequency_hz"] for each in unit.findings if each.quantity == "gain"]
    left_hz = [float(str(flag).partition(" Hz few_pulses")[0]) for flag in unit.flags]
    assert unit.left_out == tuple(f"{hz:g} Hz" for hz in left_hz)
    assert min(left_hz) > max(found) > 40
    assert unit.verdict == "INCOMPLETE"
    assert np.max(np.abs(ratios(unit))) < 3.5


@pytest.mark.parametrize("averaged", [True, False])
def test_samples_that_a_unit_sends_may_be_means_or_instants(averaged):
    rate = filtered(np.gradient(angle_deg(), FINE_S))
    summed = np.concatenate(([0.0], np.cumsum((rate[1:] + rate[:-1]) / 2))) / FINE
    values = 1000 * (np.diff(summed[LATCHES], prepend=0.0) if averaged else rate[LATCHES])
    unit = gyro(
        sent(values, angle_deg()[LATCHES], motion=motion(), averaged=averaged), unit=SENT, scale="1000 code/(°/s)"
    )
    found = [each for each in unit.findings if each.quantity == "gain"]
    response = np.abs(SLOW.response(np.array([each.at["frequency_hz"] for each in found])))
    assert [each.value for each in found] == pytest.approx(response, rel=2e-3)


def test_a_constant_frequency_and_a_sweep_make_one_response():
    hz = 61.37
    phase = 2 * np.pi * hz * FINE_S
    constant = AMPLITUDE_DEG * np.sin(phase)
    acquisition = acquired(
        (PER_DEG * filtered(constant))[LATCHES], constant[LATCHES],
        motion=Motion("table", amplitude_deg=AMPLITUDE_DEG, frequency_hz=hz),
    )  # fmt: skip
    unit = gyro(swept(PER_DEG * filtered(angle_deg())), acquisition)
    frequencies = [each.at["frequency_hz"] for each in unit.findings if each.quantity == "gain"]
    assert frequencies == sorted(frequencies)
    assert hz in frequencies
    assert np.sqrt(np.mean(ratios(unit) ** 2)) < 1.6


def test_what_was_not_swept_as_commanded_is_left_out_and_told():
    half = replace(swept(PER_DEG * filtered(angle_deg())), motion=motion()._replace(sweep_s=2 * SWEEP_S))
    unit = gyro(half, replace(at_rest(50.0), motion=motion()))
    assert texts(unit.flags) == ("steps/n=0/acquire: not_swept", "steps/n=1/acquire: not_swept", "no_response")
    assert "did not change as commanded" in flag_in_words(unit.flags[0])
    drooped = gyro(swept(PER_DEG * filtered(angle_deg(0.02)), 0.02))
    assert {text.partition(" Hz ")[2] for text in texts(drooped.flags)} == {"droop", ""}
    assert texts(drooped.flags)[-1] == "no_response"


def test_a_sweep_needs_the_arms_of_an_accelerometer():
    settings = ACCELEROMETER_RESPONSE.settings.model_validate({"scale": "1e5 pulse/s/g"}).model_dump()
    (unit,) = reduce_accelerometer(data(swept(PER_DEG * filtered(angle_deg()))), settings)
    assert [each.quantity for each in unit.findings] == []
    assert BENCH.gravity_mps2 > 9
