"""Tests on a rate table by what a unit sends or a voltmeter reads, made of known constants: found, taken out, told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.methods.rate_table.method import ACCELEROMETER_RESPONSE, GYRO_RANGE, GYRO_RESPONSE
from bench.methods.rate_table.reduction import range as range_method
from bench.methods.rate_table.reduction import response as response_method
from bench.methods.rate_table.reduction.intake import table_samples
from bench.methods.rate_table.reduction.samples import steady
from bench.metrology.acquisition import Motion
from bench.report.flag_words import flag_in_words
from simulators.physics.dynamics import Dynamics
from tests.support.flags import texts
from tests.support.table_runs import BENCH, READ, SENT, TIME_S, data, read, sent

PER_DPS, PER_G, PERIOD_S = 1000.0, 1e6, 1e-3
SLOW = Dynamics(40.0, 0.6, 1e-3)
SWEEP_HZ = (10.37, 20.37, 30.37, 38.37, 42.37, 60.37)
NOISE = np.random.default_rng(7)
RANGE = {"scale": ["4000 pulse/°", "1000 code/(°/s)", "10 mV/(°/s)"], "full_scale": "400 °/s", "clip": "420 °/s"}


def swing(frequency_hz, *, averaged=True, lost=(), amplitude_dps=20.0, beside=False, steps=1.0):
    """A gyro that follows slowly; its samples are means over their periods, or instants."""
    phase = 2 * np.pi * frequency_hz * TIME_S + 0.4
    angle_deg = amplitude_dps / (2 * np.pi * frequency_hz) * np.sin(phase)
    (kept,) = SLOW.response(np.array([frequency_hz]))
    if averaged:
        kept *= np.sinc(frequency_hz * PERIOD_S) * np.exp(-1j * np.pi * frequency_hz * PERIOD_S)
    noise = NOISE.standard_normal(len(TIME_S))
    output = PER_DPS * (amplitude_dps * np.real(kept * np.exp(1j * phase)) + 0.3) + noise
    motion = Motion("table", amplitude_deg=1.0, frequency_hz=frequency_hz)
    return sent(output, angle_deg, motion=motion, lost=lost, averaged=averaged, beside=beside, step=steps)


def gyro(*swings, unit=SENT, **settings):
    chosen = GYRO_RESPONSE.settings.model_validate({"scale": "1000 code/(°/s)"} | settings).model_dump()
    (found,) = response_method.reduce_gyro(data(*swings, unit=unit), chosen)
    return found


def values(unit, quantity):
    return [found.value for found in unit.findings if found.quantity == quantity]


# Responses


@pytest.mark.parametrize("averaged", [True, False])
def test_a_sample_is_an_instant_or_half_a_period_late_and_both_are_known(averaged):
    unit = gyro(*(swing(hz, averaged=averaged) for hz in SWEEP_HZ))
    response = SLOW.response(np.array(SWEEP_HZ))
    assert values(unit, "gain") == pytest.approx(np.abs(response), rel=3e-4)
    assert values(unit, "phase") == pytest.approx(np.degrees(np.unwrap(np.angle(response))), abs=0.03)
    assert (texts(unit.flags), unit.left_out) == ((), ())
    phase = next(found for found in unit.findings if found.quantity == "phase")
    reported = {line.source: line for line in phase.budget}
    assert reported["encoder: time to the end of the sample"].u == pytest.approx(360 * SWEEP_HZ[0] * 2e-5, rel=1e-6)
    assert reported["encoder: time to the end of the sample"].shared == "telemetry.encoder_skew"
    half = "sample: half of its period, taken out"
    assert (half in reported) is averaged
    assert not averaged or reported[half].u == pytest.approx(360 * SWEEP_HZ[0] * PERIOD_S / 2 * 5e-6, rel=1e-3)


def test_the_wrong_kind_of_sample_is_half_a_period_wrong():
    taken = [replace(each, codes={"x": replace(each.codes["x"], averaged=False)}) for each in map(swing, SWEEP_HZ)]
    late = np.array(values(gyro(*taken), "phase")) - values(gyro(*map(swing, SWEEP_HZ)), "phase")
    assert late == pytest.approx(-180 * np.array(SWEEP_HZ) * PERIOD_S, abs=0.05)


def test_lost_samples_are_left_out_and_the_steps_of_codes_are_in_the_budget():
    lost = tuple(range(300, 340))
    whole, holed = gyro(*map(swing, SWEEP_HZ)), gyro(*(swing(hz, lost=lost) for hz in SWEEP_HZ))
    assert values(holed, "gain") == pytest.approx(values(whole, "gain"), rel=3e-4)
    coarse = gyro(*(swing(hz, steps=300.0) for hz in SWEEP_HZ))
    gains = [[found for found in unit.findings if found.quantity == "gain"] for unit in (coarse, whole)]
    assert all(rough.u > 2 * fine.u for rough, fine in zip(*gains, strict=True))
    errors = [(rough.value - fine.value) / rough.u for rough, fine in zip(*gains, strict=True)]
    assert np.max(np.abs(errors)) < 3
    (first, *_) = gains[0]
    assert {"sensor: noise and steps of codes", "telemetry: time base"} <= {line.source for line in first.budget}


def test_a_swing_whose_output_has_another_clock_tells_nothing():
    unit = gyro(*(swing(hz, beside=True) for hz in SWEEP_HZ[:2]))
    assert texts(unit.flags)[:2] == ("steps/n=0/acquire: no_common_clock", "steps/n=1/acquire: no_common_clock")
    assert "shares no clock" in flag_in_words(unit.flags[0])
    assert unit.left_out[-1] == "response"


def test_an_accelerometer_finds_its_arms_by_codes():
    def at(frequency_hz, amplitude_dps):
        phase = 2 * np.pi * frequency_hz * TIME_S + 0.4
        omega, a_rps = 2 * np.pi * frequency_hz, np.radians(amplitude_dps)
        once, twice = SLOW.response(np.array([frequency_hz, 2 * frequency_hz]))
        wide = [np.sinc(f * PERIOD_S) * np.exp(-1j * np.pi * f * PERIOD_S) for f in (frequency_hz, 2 * frequency_hz)]
        once, twice = once * wide[0], twice * wide[1]
        along = 0.05 * omega * a_rps * np.imag(once * np.exp(1j * phase))
        across = -0.06 * a_rps**2 / 2 * (1 + np.real(twice * np.exp(2j * phase)))
        output = PER_G * (along + across) / BENCH.gravity_mps2 + NOISE.standard_normal(len(TIME_S))
        angle_deg = amplitude_dps / omega * np.sin(phase)
        return sent(output, angle_deg, motion=Motion("table", amplitude_deg=1.0, frequency_hz=frequency_hz))

    given = {"scale": "1e6 code/g", "lever_frequency": "1 Hz"}
    chosen = ACCELEROMETER_RESPONSE.settings.model_validate(given).model_dump()
    swings = [at(1.0, 100.0), *(at(hz, 40.0) for hz in SWEEP_HZ)]
    (unit,) = response_method.reduce_accelerometer(data(*swings, unit=SENT), chosen)
    assert values(unit, "lever_arm/x") == pytest.approx([0.06], rel=2e-3)
    assert values(unit, "lever_arm/y") == pytest.approx([0.05], rel=2e-3)
    response = SLOW.response(np.array([1.0, *SWEEP_HZ]))
    assert values(unit, "gain") == pytest.approx(np.abs(response[1:] / response[0]), rel=2e-3)
    (how,) = unit.compensations
    assert (how.output_unit, how.scale.unit) == ("code", "code/g")


# Ranges


def turning(rate_dps, *, beside=False):
    output = PER_DPS * (1.0005 * rate_dps + 0.2) + NOISE.standard_normal(len(TIME_S))
    return sent(output, rate_dps * TIME_S, motion=Motion("table", rate_dps) if rate_dps else None, beside=beside)


def at_volts(rate_dps):
    at_s = np.arange(0.02, 3.0, 0.04) * (1 + 2e-5)
    volts = 0.01 * (1.0005 * rate_dps + 0.2) + 1e-6 * NOISE.standard_normal(len(at_s))
    return read(at_s, volts, rate_dps * TIME_S, motion=Motion("table", rate_dps) if rate_dps else None)


def ranged(*acquisitions, unit):
    chosen = GYRO_RANGE.settings.model_validate(RANGE).model_dump()
    (found,) = range_method.reduce_gyro(data(*acquisitions, unit=unit), chosen)
    return found


@pytest.mark.parametrize("beside", [True, False])
def test_the_errors_of_a_gyro_by_codes_with_the_encoder_on_its_clock_or_on_another(beside):
    rates = (0.0, 0.0, 100.0, -300.0)
    unit = ranged(*(turning(rate, beside=beside) for rate in rates), unit=SENT)
    assert unit.left_out == ()
    assert values(unit, "rest_rate") == pytest.approx([0.2], abs=1e-4)
    assert values(unit, "rate_error") == pytest.approx([0.05, -0.15], abs=2e-3)
    (error, *_) = (found for found in unit.findings if found.quantity == "rate_error")
    reported = {line.source: line.u for line in error.budget}
    assert reported["telemetry: time base"] == pytest.approx(100.0 * 5e-6, rel=1e-3)


def test_the_errors_of_a_gyro_by_volts():
    unit = ranged(*map(at_volts, (0.0, 0.0, 100.0, -300.0)), unit=READ)
    assert values(unit, "rest_rate") == pytest.approx([0.2], abs=1e-4)
    assert values(unit, "rate_error") == pytest.approx([0.05, -0.15], abs=2e-3)
    (error, *_) = (found for found in unit.findings if found.quantity == "rate_error")
    reported = {line.source: line for line in error.budget}
    assert reported["voltmeter: gain"].u == pytest.approx(100.0 * 4e-6, rel=1e-3)
    assert reported["voltmeter: gain"].shared == "dvm.gain"
    (rest,) = (found for found in unit.findings if found.quantity == "rest_rate")
    assert next(line.u for line in rest.budget if line.source == "voltmeter: offset") == pytest.approx(1e-4)
    assert unit.compensations[0].scale.unit == "V/(°/s)"


def test_a_mean_by_codes_is_over_whole_turns_and_lost_samples_bend_it_little():
    lost = tuple(range(1000, 1100))
    tilted = 500 * np.sin(np.radians(400 * TIME_S))
    acquired = sent(4e4 + tilted, 400 * TIME_S, motion=Motion("table", 400.0), lost=lost)
    assert steady(table_samples(acquired, SENT), 1.0).output == pytest.approx(4e4, abs=1)


def test_what_there_is_too_little_of_is_told():
    few = read(TIME_S[:1], TIME_S[:1], 0 * TIME_S)
    assert set(table_samples(few, READ).problems) == {"too_few_voltages", "too_few_latches"}
    assert table_samples(replace(turning(0.0), codes={}), SENT).problems == ("too_few_codes",)
    assert "no_encoder" in table_samples(replace(at_volts(0.0), positions={}), READ).problems


@pytest.mark.parametrize(
    ("scale", "problem"),
    [
        ("4000 pulse/s", "expected a quantity in one of pulse/s/(°/s), V/(°/s), code/(°/s)"),
        (["4000 pulse/°", "3 pulse/°"], "two scale factors of an output in pulse/s"),
        ("0 code/(°/s)", "expected a quantity other than 0"),
        ("1 codes", "is not a known unit"),
        ([], "is not a quantity"),
    ],
)
def test_a_scale_factor_that_is_none_is_refused(scale, problem):
    with pytest.raises(ValueError, match=problem.replace("(", r"\(").replace(")", r"\)")):
        GYRO_RESPONSE.settings.model_validate({"scale": scale})


def test_a_decoded_output_has_a_scale_of_its_own_unit():
    settings = GYRO_RESPONSE.settings.model_validate({"scale": "1.002"}).model_dump()
    assert settings["scale"] == {"°/s": 1.002}


def test_the_gain_of_a_voltmeter_is_one_error_of_all_rates_and_none_of_their_asymmetry():
    rates = (0.0, 0.0, 100.0, -100.0, 200.0, -200.0, 300.0, -300.0)
    unit = ranged(*map(at_volts, rates), unit=READ)
    reported = {
        found.quantity: {line.source: line.u for line in found.budget}.get("voltmeter: gain", 0.0)
        for found in unit.findings
    }
    assert reported["scale_error"] == pytest.approx(4e-6, rel=1e-3)
    assert max(reported["asymmetry"], reported["nonlinearity/cubic"]) < 1e-8
