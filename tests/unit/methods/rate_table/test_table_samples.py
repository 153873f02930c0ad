"""From latched counts and encoder positions to samples, means over whole turns, and the play of a converter."""

from __future__ import annotations

import numpy as np
import pytest

from bench.methods.rate_table.reduction.bias_at_rest import RestReading, fit_rest
from bench.methods.rate_table.reduction.converter_hysteresis import too_few_pulses, without_hysteresis
from bench.methods.rate_table.reduction.intake import table_samples
from bench.methods.rate_table.reduction.samples import harmonics_u_dps, steady
from bench.methods.rate_table.reduction.sine_fit import fit_sine
from bench.metrology.acquisition import Motion
from tests.support.table_runs import UNIT, acquired


def turning(rate_dps, seconds=4.0, per_deg=100.0, wave=0.0, **more):
    time_s = np.arange(int(seconds * 1000) + 1) / 1000
    angle_deg = 31.0 + rate_dps * time_s
    charge = per_deg * rate_dps * time_s + wave * np.sin(np.radians(angle_deg))
    return table_samples(acquired(charge, angle_deg, motion=Motion("table", rate_dps), **more), UNIT)


# Samples


def test_counters_clocks_and_encoders_that_wrap_go_on():
    samples = turning(-400.0, first=2**24 - 50, bits=24)
    assert samples.problems == ()
    assert samples.time_s[-1] == pytest.approx(4.0)
    assert samples.angle_deg[-1] == pytest.approx(-1600, abs=2e-4)
    assert samples.total[-1] == pytest.approx(-160_000, abs=2)
    assert (samples.interval_s, samples.temperature.value_c) == (pytest.approx(1e-3), 20.5)


def test_what_follows_a_lost_latch_is_no_sample():
    samples = turning(200.0, lost=(100, 101, 700))
    block = samples.block(0.01)
    assert len(samples.time_s) == 4001 - 3
    assert len(block.time_s) == 4000 - 3 - 2
    assert block.scheduled == 4000
    assert block.output == pytest.approx(np.full(len(block.output), 200.0), abs=10.1)
    assert samples.summed(0.01).output[-1] == pytest.approx(800, abs=0.02)


def test_an_acquisition_without_an_encoder_cannot_be_used():
    time_s = np.arange(100) / 1000
    bare = acquired(1e3 * time_s, 0 * time_s, motion=Motion("table", 10.0))
    assert table_samples(bare, UNIT).problems == ()
    other = acquired(1e3 * time_s, 0 * time_s, motion=Motion("another", 10.0))
    assert "no_encoder" in table_samples(other, UNIT).problems


# Means over whole turns


def test_a_mean_over_whole_turns_is_free_of_what_comes_once_a_turn():
    found = steady(turning(200.0, wave=2000.0), 0.01)  # 2.2 turns; the wave adds up to 0.07 of the rate
    assert found.rate_dps == pytest.approx(200, abs=1e-4)
    assert found.output == pytest.approx(200, abs=0.02)
    assert found.u_output < 0.02


def test_noise_shows_in_the_uncertainty_and_the_steps_of_counting_do_once():
    quiet = steady(turning(200.0), 0.01)
    assert quiet.u_output == pytest.approx(0.408 / 3.6 * 0.01, rel=0.3)
    rng, errors, stated = np.random.default_rng(3), [], []
    for _ in range(60):
        time_s = np.arange(4001) / 1000
        noise = np.cumsum(rng.standard_normal(4001)) * 2.0
        angle_deg = 200.0 * time_s
        samples = table_samples(acquired(20_000 * time_s + noise, angle_deg, motion=Motion("table", 200.0)), UNIT)
        found = steady(samples, 0.01)
        errors.append(found.output - 200)
        stated.append(found.u_output)
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(np.sqrt(np.mean(np.square(stated))), rel=0.25)


@pytest.mark.parametrize("latches", [21, 30, 40])
def test_few_latches_have_an_uncertainty_too(latches):
    """Of white noise: each latch is a part of its own, where they are fewer than the parts of a long block."""
    rng, errors, stated = np.random.default_rng(5), [], []
    for _ in range(300):
        time_s = np.arange(latches) / 1000
        noise = np.cumsum(rng.standard_normal(latches)) * 20.0
        charge = 20_000 * time_s + noise - noise[0]
        samples = table_samples(acquired(charge, 200.0 * time_s, motion=Motion("table", 200.0)), UNIT)
        found = steady(samples, 0.01)
        errors.append(found.output - 200)
        stated.append(found.u_output)
        assert found.dof < latches
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(np.sqrt(np.mean(np.square(stated))), rel=0.25)


def seen_by_the_encoder(even_deg):
    """What truly turned, a little unevenly, and what an encoder with errors over a turn says; of even angles."""
    at = np.radians(even_deg)
    true_deg = even_deg + sum(np.degrees(1e-4 / order * np.sin(order * at + order)) for order in (1, 2, 24))
    return true_deg, true_deg + sum(2e-3 / order * np.cos(order * at - order) for order in range(1, 5))


@pytest.mark.parametrize("rate_dps", [50.0, 100.0, 180.0, 200.0, -300.0, 400.0, 982.4])
def test_neither_a_table_that_turns_unevenly_nor_its_encoder_is_noise_of_the_sensor(rate_dps):
    true_deg, read_deg = seen_by_the_encoder(rate_dps * np.arange(10_001) / 1000)
    samples = table_samples(acquired(4000 * true_deg, read_deg, motion=Motion("table", rate_dps), bits=32), UNIT)
    found = steady(samples, 1 / 4000)
    assert found.output == pytest.approx(found.rate_dps, abs=1e-4)
    assert found.u_output < 5e-5  # steps of counting are 1e-5


def test_the_errors_of_the_encoder_cancel_over_whole_turns_only():
    whole, part = turning(180.0), turning(45.0)
    assert harmonics_u_dps(whole, (1e-3, 1e-3)) < 1e-8
    assert harmonics_u_dps(part, (1e-3,)) == pytest.approx(2e-3 / 4, rel=1e-3)  # half a turn in 4 s


def test_a_sensor_at_its_clip_level_is_seen():
    assert steady(turning(200.0), 0.01, clip=200.0).saturated
    assert not steady(turning(200.0), 0.01, clip=210.0).saturated


# At rest


def readings(bias, tilt, drift, angles_deg, every_s=10.0):
    return [
        RestReading(i * every_s, at, bias + tilt * np.cos(np.radians(at - 40)) + drift * i * every_s, 1e-6, 29)
        for i, at in enumerate(angles_deg)
    ]


def test_a_tilt_and_a_drift_are_not_in_the_bias():
    found = fit_rest(readings(1e-3, 5e-5, 1e-7, [0, 90, 180, 270, 0, 90, 180, 270]))
    assert found.value + found.change(0.0) == pytest.approx(1e-3, abs=1e-9)
    assert found.drift_per_s == pytest.approx(1e-7)
    assert (found.dof, found.of_one_angle) == (4 + 8 * 29, False)


@pytest.mark.parametrize(("more", "low", "high"), [(1.0, 0.9, 1.1), (3.0, 0.9, 1.6)])
def test_the_uncertainty_of_the_bias_is_what_biases_scatter_by(more, low, high):
    """Readings that scatter as each tells, and three times more, of which a fit of eight readings tells a little."""
    rng = np.random.default_rng(6)
    ratios = []
    for _ in range(500):
        reported = 1e-6 * np.sqrt(rng.chisquare(29, 8) / 29)
        scatter = more * 1e-6 * rng.standard_normal(8)
        found = fit_rest([
            RestReading(10.0 * i, 90.0 * i, 1e-3 + error, u, 29)
            for i, (error, u) in enumerate(zip(scatter, reported, strict=True))
        ])  # fmt: skip
        ratios.append((found.value - 1e-3) / found.u)
    assert low < np.sqrt(np.mean(np.square(ratios))) < high


def test_what_a_wobble_makes_of_gravity_is_no_scatter():
    """An axis that tilts once a turn is in the readings of an accelerometer twice a turn."""
    angles_deg = [0, 90, 180, 270, 0, 90, 180, 270]
    twice = [
        RestReading(each.at_s, each.angle_deg, each.output + 2e-5 * np.cos(2 * np.radians(each.angle_deg)), 1e-6, 29)
        for each in readings(1e-3, 5e-5, 1e-7, angles_deg)
    ]
    taken, left = fit_rest(twice, axis_wobbles=True), fit_rest(twice)
    assert taken.value == pytest.approx(left.value) == pytest.approx(1e-3 + 1e-7 * 35)
    assert taken.drift_per_s == pytest.approx(1e-7)
    assert (taken.u, left.u) == (pytest.approx(1e-6 / np.sqrt(8), rel=0.02), pytest.approx(2e-5 / np.sqrt(4), rel=0.1))


def test_opposite_angles_are_enough_and_others_are_told():
    assert fit_rest(readings(1e-3, 5e-5, 0.0, [0, 180, 0, 180])).value == pytest.approx(1e-3, abs=1e-9)
    assert fit_rest(readings(1e-3, 5e-5, 0.0, [0, 0, 0])).of_one_angle
    assert fit_rest(readings(1e-3, 0.0, 0.0, [0])).u == pytest.approx(1e-6)
    with pytest.raises(ValueError, match="no reading"):
        fit_rest([])


# The play of a converter


def swung(amplitude, frequency_hz, drift=15.0, second=0.0, seconds=5.0):
    time_s = np.arange(int(seconds * 1000) + 1) / 1000
    phase = 2 * np.pi * frequency_hz * time_s + 0.7
    charge = amplitude * np.sin(phase) + second * np.sin(2 * phase + 1.0) + drift * time_s
    angle_deg = 0.05 * np.sin(phase)
    motion = Motion("table", amplitude_deg=0.05, frequency_hz=frequency_hz)
    return table_samples(acquired(charge, angle_deg, motion=motion), UNIT), phase


def gain_of(samples, phase, amplitude, frequency_hz, harmonic=1, lag=0.0):
    fit = fit_sine(samples.time_s, samples.total, frequency_hz, harmonics=2)
    return fit.phasors[harmonic - 1] / (amplitude * np.exp(1j * (harmonic * phase[0] + lag - np.pi / 2)))


@pytest.mark.parametrize(("amplitude", "frequency_hz"), [(20.0, 30.37), (40.0, 80.37), (200.0, 10.37)])
def test_the_play_is_taken_out_of_a_sine(amplitude, frequency_hz):
    samples, phase = swung(amplitude, frequency_hz)
    before = gain_of(samples, phase, amplitude, frequency_hz)
    after = gain_of(without_hysteresis(samples, frequency_hz, 1.0), phase, amplitude, frequency_hz)
    assert np.angle(before) == pytest.approx(-2 / np.pi / amplitude, rel=0.1)  # its describing function
    assert abs(after - 1) < max(abs(before - 1) / 30, 1.5e-4)


def test_the_play_is_taken_out_of_twice_the_frequency_too():
    samples, phase = swung(100.0, 0.5, second=10.0, seconds=40.0, drift=0.3)
    before, after = (
        gain_of(each, phase, 10.0, 0.5, harmonic=2, lag=1.0)
        for each in (samples, without_hysteresis(samples, 0.5, 1.0))
    )
    assert abs(after - 1) < 2e-3 < abs(before - 1)


@pytest.mark.lengthy
@pytest.mark.slow
def test_what_counts_with_play_are_off_is_in_the_uncertainty():
    """Where they turn round they stand still for a pulse: twice as far off as those of a counter without play."""
    ratios = []
    for amplitude in np.linspace(100, 101, 14):
        samples, _ = swung(float(amplitude), 0.5, drift=1.5, seconds=10.0)
        block = without_hysteresis(samples, 0.5, 1.0).swing(1.0)
        fit = fit_sine(block.time_s, block.output, 0.5, harmonics=2, step=block.step, behind=block.behind)
        ratios.append((abs(fit.phasors[0]) - amplitude) / fit.u[0])
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.1


@pytest.mark.lengthy
@pytest.mark.parametrize(("amplitude", "frequency_hz"), [(1.2, 90.37), (3.0, 10.37)])
def test_of_a_swing_of_few_pulses_the_uncertainty_holds_what_is_off(amplitude, frequency_hz):
    """The play is a third of it, or more than half."""
    ratios = []
    for drift in (5.3, 7.7, 9.1, 11.3, 12.9, 14.2):
        samples, _ = swung(amplitude, frequency_hz, drift=drift, seconds=10.0)
        block = without_hysteresis(samples, frequency_hz, 1.0).swing(1.0)
        fit = fit_sine(block.time_s, block.output, frequency_hz, step=block.step, behind=block.behind)
        assert fit.u[0] < 0.02 * amplitude
        ratios.append((abs(fit.phasors[0]) - amplitude) / fit.u[0])
    assert np.max(np.abs(ratios)) < 3
    assert np.sqrt(np.mean(np.square(ratios))) < 1.5


@pytest.mark.parametrize(("amplitude", "drift", "play"), [(20.0, 15.0, 0.0), (0.3, 15.0, 1.0), (20.0, 9000.0, 1.0)])
def test_without_play_or_without_reversals_nothing_changes(amplitude, drift, play):
    samples, _ = swung(amplitude, 30.37, drift=drift)
    assert without_hysteresis(samples, 30.37, play).total.tolist() == samples.total.tolist()


@pytest.mark.lengthy
@pytest.mark.slow
def test_of_a_stroke_of_too_few_pulses_nothing_is_right_and_of_more_everything():
    """Below 1.8 pulses the counts move by less than the play, and the fit finds a half of what there is."""
    rng = np.random.default_rng(5)
    of_few, of_enough = [], []
    for amplitude in np.concatenate([rng.uniform(0.55, 0.8, 12), rng.uniform(1.4, 3.0, 24)]):
        frequency_hz, drift = rng.uniform(10, 120), rng.uniform(4, 9) * rng.choice([-1, 1])
        samples, _ = swung(amplitude, frequency_hz, drift=drift)
        without = without_hysteresis(samples, frequency_hz, 1.0)
        block = without.swing(1.0)
        fit = fit_sine(block.time_s, block.output, frequency_hz, step=block.step, behind=block.behind)
        ratio = (abs(fit.phasors[0]) - amplitude) / fit.u[0]
        (of_few if too_few_pulses(without.stroke, 1.0) else of_enough).append(ratio)
    assert (len(of_few), len(of_enough)) == (12, 24)
    assert np.max(of_few) < -5
    assert np.max(np.abs(of_enough)) < 4
    assert 0.5 < np.sqrt(np.mean(np.square(of_enough))) < 1.3


def test_a_charge_that_hardly_moves_in_a_period_has_too_few_pulses():
    constant, _ = swung(0.0, 30.37, drift=0.0)
    slow, _ = swung(0.2, 30.37, drift=15.0)
    fast, _ = swung(0.2, 30.37, drift=900.0)
    strokes = [without_hysteresis(each, 30.37, 1.0).stroke for each in (constant, slow, fast)]
    assert strokes[0] == 0
    assert strokes[2] == pytest.approx(900 / 30.37, rel=1e-3)
    assert [too_few_pulses(stroke, 1.0) for stroke in strokes] == [True, True, False]
