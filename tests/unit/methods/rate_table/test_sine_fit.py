import numpy as np
import pytest
from scipy.optimize import curve_fit
from scipy.signal import lfilter

from bench.methods.rate_table.reduction.sine_fit import find_frequency, fit_sine
from bench.metrology.least_squares import NotDetermined


@pytest.fixture
def rng():
    return np.random.default_rng(1057)


def samples(rng, f_hz, *, seconds=4.0, sample_hz=250.3, noise=0.0, phasor=2.0 - 1.0j):
    time_s = np.arange(round(seconds * sample_hz)) / sample_hz
    sine = np.real(phasor * np.exp(2j * np.pi * f_hz * time_s))
    return time_s, 5.0 - 0.3 * time_s + sine + noise * rng.standard_normal(len(time_s))


def test_a_phasor_is_what_it_says(rng):
    time_s, value = samples(rng, 7.3)
    value = value + np.real((0.1 + 0.2j) * np.exp(4j * np.pi * 7.3 * time_s))
    fit = fit_sine(time_s, value, 7.3, harmonics=2)
    assert fit.phasors == pytest.approx([2 - 1j, 0.1 + 0.2j], abs=1e-12)
    later = fit_sine(time_s, value, 7.3, harmonics=2, origin_s=0.5)
    turned = np.exp(2j * np.pi * 7.3 * 0.5)
    assert later.phasors == pytest.approx([(2 - 1j) * turned, (0.1 + 0.2j) * turned**2], abs=1e-12)
    assert (fit.dropped, fit.excessive) == (0, False)


def test_four_parameters_are_those_of_another_program(rng):
    time_s, value = samples(rng, 12.34, noise=0.2)

    def model(t, offset, slope, a, b, f):
        return offset + slope * t + a * np.cos(2 * np.pi * f * t) + b * np.sin(2 * np.pi * f * t)

    theirs, covariance = curve_fit(model, time_s, value, [5, 0, 2, 1, 12.33], ftol=1e-14, xtol=1e-14)
    f_hz = find_frequency(time_s, value, 12.2)
    assert f_hz == pytest.approx(theirs[4], rel=1e-9)
    fit = fit_sine(time_s, value, f_hz)
    assert fit.phasors[0] == pytest.approx(complex(theirs[2], -theirs[3]), rel=1e-6)
    # White noise: the uncertainty is that of the covariance of the fit, up to the scatter of its own estimate.
    a, b = theirs[2:4] / np.hypot(*theirs[2:4])
    direction = np.array([a, b])
    expected = np.sqrt(direction @ covariance[2:4, 2:4] @ direction)
    assert fit.u_random[0] == pytest.approx(expected, rel=0.4)


@pytest.mark.parametrize("off_hz", [-0.9, -0.11, 0.0, 0.05, 0.3, 0.97])
def test_a_frequency_that_is_off_is_found(rng, off_hz):
    time_s, value = samples(rng, 50 + off_hz, noise=0.05)
    assert find_frequency(time_s, value, 50.0) == pytest.approx(50 + off_hz, abs=5e-4)


@pytest.mark.parametrize("periods", [1.6, 3.2, 20.5])
def test_few_periods_suffice(rng, periods):
    time_s, value = samples(rng, periods / 4, noise=1e-3)
    assert find_frequency(time_s, value, periods / 4 * 1.03) == pytest.approx(periods / 4, rel=3e-3)


def test_a_constant_has_no_frequency(rng):
    time_s, value = samples(rng, 10.0, phasor=0)
    with pytest.raises(NotDetermined):
        find_frequency(time_s, value, 10.0)


@pytest.mark.parametrize("f_hz", [124.0, 200.0])
def test_what_is_sampled_too_slowly_could_be_another_frequency(rng, f_hz):
    time_s, value = samples(rng, f_hz)
    with pytest.raises(NotDetermined, match="frequency"):
        find_frequency(time_s, value, f_hz)


def test_a_frequency_far_off_is_none(rng):
    time_s, value = samples(rng, 10.0, phasor=0, noise=1.0)
    value += 30 * np.cos(2 * np.pi * 14 * time_s)
    try:
        found_hz = find_frequency(time_s, value, 10.0)
    except NotDetermined:
        return
    fit = fit_sine(time_s, value, found_hz)
    assert abs(fit.phasors[0]) < 5 * fit.u_random[0]


def test_glitches_are_left_out_and_counted(rng):
    time_s, value = samples(rng, 20.1, noise=0.01)
    clean = fit_sine(time_s, value, 20.1)
    value[::25] += 300 * rng.standard_normal(len(value[::25]))
    fit = fit_sine(time_s, value, 20.1)
    assert 35 <= fit.dropped <= 41
    assert not fit.excessive
    assert fit.phasors[0] == pytest.approx(clean.phasors[0], abs=1e-3)
    assert find_frequency(time_s, value, 20.0) == pytest.approx(20.1, abs=1e-3)
    value[::8] += 300 * rng.standard_normal(len(value[::8]))
    assert fit_sine(time_s, value, 20.1).excessive


def test_a_harmonic_at_half_the_sample_rate_is_not_determined():
    time_s = np.arange(400) / 200
    with pytest.raises(NotDetermined):
        fit_sine(time_s, np.cos(2 * np.pi * 50 * time_s), 50.0, harmonics=2)
    assert fit_sine(time_s, np.cos(2 * np.pi * 50 * time_s), 50.0).phasors == pytest.approx([1])


def test_a_small_part_of_a_period_determines_no_sine(rng):
    time_s, value = samples(rng, 1.0, seconds=0.1)
    with pytest.raises(NotDetermined):
        fit_sine(time_s, value, 1.0)


@pytest.mark.parametrize("f_hz", [6.1, 60.3])
def test_uncertainty_follows_the_noise_around_the_line(f_hz):
    rng = np.random.default_rng(3)
    errors, u, white = [], [], []
    for _ in range(120):
        time_s, value = samples(rng, f_hz, seconds=2.0)
        # Noise through a lag of 20 Hz is strong at 6 Hz and weak at 60 Hz.
        noise = lfilter([0.4], [1, -0.6], rng.standard_normal(len(time_s) + 50))[50:]
        fit = fit_sine(time_s, value + 0.1 * noise, f_hz)
        errors.append(abs(fit.phasors[0]) - np.sqrt(5))
        u.append(fit.u[0])
        white.append(0.1 * np.std(noise) * np.sqrt(2 / len(time_s)))
    assert np.sqrt(np.mean(np.square(errors) / np.square(u))) == pytest.approx(1, abs=0.15)
    ratio = np.mean(u) / np.mean(white)
    assert ratio > 1.5 if f_hz < 20 else ratio < 0.8


@pytest.mark.parametrize("floor", [0.0, 1.0])
def test_the_noise_of_a_rate_that_was_summed_up_is_told_about_a_low_frequency(floor):
    """Ten periods: there the noise around a line is far from what it is at the line."""
    rng, errors, u = np.random.default_rng(4), [], []
    for _ in range(250):
        time_s, value = samples(rng, 0.5, seconds=20.0, sample_hz=50.0)
        noise = 0.02 * np.cumsum(rng.standard_normal(len(time_s))) + floor * rng.standard_normal(len(time_s))
        fit = fit_sine(time_s, value + noise, 0.5)
        errors.append(abs(fit.phasors[0]) - np.sqrt(5))
        u.append(fit.u[0])
    assert np.sqrt(np.mean(np.square(errors)) / np.mean(np.square(u))) == pytest.approx(1, abs=0.12)


def worst_of_counting(f_hz, *, sample_hz=1000.0, seconds=0.5):
    """Rms error and rms stated uncertainty, relative, of the amplitude of a table of 3 deg/s behind its encoder."""
    rng = np.random.default_rng(0)
    time_s = np.arange(round(seconds * sample_hz)) / sample_hz
    counts = 3 / (2 * np.pi * f_hz) * 10_000  # 0.36 arcsec each
    errors, u = [], []
    for _ in range(200):
        read = np.round(counts * np.sin(2 * np.pi * f_hz * time_s + rng.uniform(0, 6.3)) + rng.uniform())
        fit = fit_sine(time_s, read, f_hz)
        errors.append(abs(fit.phasors[0]) / counts - 1)
        u.append(fit.u[0] / counts)
    return np.sqrt(np.mean(np.square(errors))), np.sqrt(np.mean(np.square(u)))


def test_counting_errors_that_repeat_do_not_average_out():
    repeated, u_repeated = worst_of_counting(100.0)
    spread, _ = worst_of_counting(101.3)
    assert repeated == pytest.approx(0.0030, rel=0.2)  # equations 5.3: 0.3 % rms
    assert u_repeated == pytest.approx(repeated, rel=0.25)
    assert spread < 3e-4


def test_three_phases_tell_nothing_of_what_repeats():
    time_s = np.arange(600) / 300
    assert np.isinf(fit_sine(time_s, np.round(40 * np.cos(2 * np.pi * 100 * time_s + 0.3)), 100.0).u[0])


def counted(rng, per_period):
    """Ten periods of a count that swings, and goes on by so much in each: both amplitudes' errors over u, and u."""
    time_s, size = np.arange(20_000) / 1000, rng.uniform(20, 200)
    turns = 0.5 * time_s
    swing = size * (np.cos(2 * np.pi * (turns + rng.uniform())) + 0.3 * np.cos(4 * np.pi * turns))
    found = fit_sine(time_s, np.floor(swing + per_period * turns + rng.uniform()), 0.5, harmonics=2, step=1.0)
    return (np.abs(found.phasors) - size * np.array([1.0, 0.3])) / found.u, found.u


@pytest.mark.lengthy
@pytest.mark.slow
def test_steps_of_counting_are_in_the_uncertainty(rng):
    """Whole numbers in a period are the trap: all periods have the same error, and nothing shows it."""
    for per_period, least, most in ((3.0, 0.6, 1.4), (2.5, 0.6, 1.4), (np.sqrt(8), 0.3, 1.4)):
        ratios, u = zip(*(counted(rng, per_period) for _ in range(25)), strict=True)
        assert least < np.sqrt(np.mean(np.square(ratios))) < most, per_period
        assert np.max(u) < 0.05
    assert np.mean(counted(rng, 3.0)[1]) > 2 * np.mean(counted(rng, np.sqrt(8))[1])


def counted_at_latches(rng, rate_pps, size, walk=0.0):
    """Five seconds of a swing, latched 1000 times a second: errors of it over u, along and across; u."""
    time_s, start = np.arange(5001) / 1000, rng.uniform(0, 2 * np.pi)
    charge = size * np.cos(2 * np.pi * 63.37 * time_s + start) + rate_pps * time_s
    charge += walk * np.cumsum(rng.standard_normal(len(time_s)))
    fit = fit_sine(time_s, np.round(charge + rng.uniform()), 63.37, step=1.0)
    error = size * (fit.phasors[0] / (size * np.exp(1j * start)) - 1)
    return error.real / fit.u[0], error.imag / fit.u_across[0], fit.u[0]


def test_steps_of_counting_that_latches_fold_onto_the_swing_are_in_the_uncertainty(rng):
    """142 times 63.37 Hz and 1.46 pulses a second are nine times 1000 Hz: a line of the saw tooth is on the swing."""
    u = {}
    for rate_pps, least in ((1.46, 0.7), (2.9, 0.6)):
        *ratios, of_amplitude = np.transpose([counted_at_latches(rng, rate_pps, 28.0) for _ in range(40)])
        for each in ratios:
            assert least < np.sqrt(np.mean(np.square(each))) < 1.25, rate_pps
        u[rate_pps] = np.mean(of_amplitude)
    assert u[1.46] > 1.5 * u[2.9]


def test_noise_that_is_summed_up_to_pulses_takes_the_lines_of_counting_elsewhere(rng):
    ratios = [counted_at_latches(rng, rate_pps, 200.0, 0.03)[:2] for rate_pps in np.linspace(1, 10, 60)]
    assert np.all(np.sqrt(np.mean(np.square(ratios), axis=0)) < 1.25)
