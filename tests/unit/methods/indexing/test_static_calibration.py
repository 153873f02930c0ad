import numpy as np
import pytest

from bench.methods.indexing.reduction.model import TERMS, fit_sweeps, output
from bench.methods.indexing.reduction.residual_spectrum import conspicuous_periods
from bench.methods.indexing.reduction.sweep import SweepRecord, fit_line, reduce_end
from bench.methods.indexing.reduction.two_ends import Agreement, Mounting, combine, fit_clocking
from bench.metrology.least_squares import NotDetermined, least_squares
from bench.metrology.propagation import Estimate, Measured, inputs, weighted


def swept(largest_deg, ends):
    """Angles in rad and sides of 21 readings per end."""
    angle_rad = np.radians(np.linspace(-largest_deg, largest_deg, 21))
    return np.tile(angle_rad, len(ends)), np.repeat(np.array(ends, dtype=float), 21)


def design(largest_deg, ends, terms):
    angle_rad, side = swept(largest_deg, ends)
    return output(np.array([0.0, 1, 0, 0, 0, 0]), angle_rad, side)[1][:, [TERMS.index(term) for term in terms]]


@pytest.mark.parametrize(
    ("largest_deg", "one_end", "sigma_k2", "sigma_k3"),
    [(1, 4.0e4, 1.6e3, 1.7e5), (5, 1.6e3, 62, 1.4e3), (10, 4.0e2, 16, 1.7e2), (30, 43, 1.9, 7.2)],
)
def test_what_small_angles_tell_is_as_published(largest_deg, one_end, sigma_k2, sigma_k3):
    def fit(ends, terms):
        return least_squares(design(largest_deg, ends, terms), np.zeros(21 * len(ends)), condition_limit=1e9)

    assert fit([1], ("c0", "c1", "delta")).condition == pytest.approx(one_end, rel=0.015)
    assert fit([1, -1], ("c0", "c1", "delta", "cxz")).condition == pytest.approx(1.0, abs=1e-9)
    u = np.sqrt(np.diag(fit([1, -1], TERMS).unscaled_covariance))
    assert u[2:4] == pytest.approx([sigma_k2, sigma_k3], rel=0.04)


def test_derivatives_are_those_of_the_output():
    angle_rad, side = swept(40, [1, -1])
    every = np.array([0.3, 1.1, 0.2, -0.1, 0.05, 0.2])
    step = 1e-6
    differences = [
        (output(every + step * one, angle_rad, side)[0] - output(every - step * one, angle_rad, side)[0]) / (2 * step)
        for one in np.eye(6)
    ]
    assert output(every, angle_rad, side)[1] == pytest.approx(np.array(differences).T, abs=1e-9)


@pytest.mark.parametrize("scale", [1e-6, 1.13, 1e6])
def test_the_model_is_found_from_far_away(scale):
    angle_rad, side = swept(30, [1, -1])
    every = scale * np.array([0.2, 1.0, 0.05, -0.1, 0.03, 0.1 / scale])
    model = fit_sweeps(angle_rad, side, output(every, angle_rad, side)[0], TERMS, condition_limit=1e3)
    assert model.fit.parameters == pytest.approx(every, rel=1e-9)
    assert model.fit.iterations <= 6


def test_a_scale_factor_that_is_not_asked_for_is_one():
    angle_rad, side = swept(10, [1, -1])
    output_g = output(np.array([1e-3, 1.0, 0, 0, 0, 5e-4]), angle_rad, side)[0]
    model = fit_sweeps(angle_rad, side, output_g, ("c0", "delta"), condition_limit=1e3)
    assert model.fit.parameters == pytest.approx([1e-3, 5e-4], rel=1e-9)
    assert model.value("c1") is None


def test_no_reading_at_all_determines_nothing():
    empty = np.zeros(0)
    model = fit_sweeps(empty, empty, empty, ("c0", "c1"), condition_limit=1e3)
    assert model.fit is None
    assert model.doubt.names == ("c0", "c1")


def test_readings_that_are_not_finite_have_no_model():
    angle_rad, side = swept(10, [1, -1])
    with np.errstate(over="ignore"):
        model = fit_sweeps(angle_rad, side, 1e300 * np.sin(angle_rad), ("c0", "c1"), condition_limit=1e3)
    assert model.fit is None
    assert str(model.problem) == "the model has no finite values where the fit begins"


def dwells(angles_deg, stand, seed, wrong_g=0.0):
    """Dwells of one end on stands whose angles the table has to 0.2 arcsec; readings of one stand agree far better."""
    rng, count = np.random.default_rng(seed), len(stand)
    angle_g = np.sin(np.radians(angles_deg)) + rng.normal(0, 1e-6, len(angles_deg))
    output_v = angle_g[stand] + rng.normal(0, 2e-8, count)
    output_v[4] += wrong_g
    side = np.where(np.diff(angles_deg, prepend=-90.0) > 0, "below", "above")
    return SweepRecord(
        end=np.full(count, "up"), direction=np.full(count, "fwd"), sequence=np.arange(float(count)),
        angle_deg=angles_deg[stand], output_v=output_v, stable=np.ones(count, dtype=bool),
        temperature_c=np.full(count, 23.0), side=side[stand], stand=stand,
    )  # fmt: skip


def test_few_dwells_whose_angles_are_a_little_off_are_no_outliers():
    angles_deg = np.array([0.0, 0.2, 0.4, 0.2, 0.0, -0.2, -0.4, -0.2, 0.0])
    stand = np.repeat(np.arange(9), [1, 1, 2, 1, 2, 1, 2, 1, 1])
    found = [reduce_end(dwells(angles_deg, stand, seed), outlier_k=6).outliers for seed in range(200)]
    assert sum(each > 0 for each in found) <= 2


def test_one_of_many_dwells_that_is_far_off_is_an_outlier():
    angles_deg = np.concatenate([np.linspace(-10, 10, 21), np.linspace(10, -10, 21)])
    for seed in range(20):
        found = reduce_end(dwells(angles_deg, np.arange(42), seed, wrong_g=1e-4), outlier_k=6)
        assert found.outliers == 1
        assert 4 not in found.dwells.sequence


def end(angles_deg, b, g, *, noise=None):
    angle_deg = np.asarray(angles_deg, dtype=float)
    sine, cosine = np.sin(np.radians(angle_deg)), np.cos(np.radians(angle_deg))
    count = len(angle_deg)
    output_v = b[0] + b[1] * cosine + g[0] * sine + g[1] * sine * cosine
    if noise is not None:
        output_v = output_v + noise
    return fit_line(
        SweepRecord(
            end=np.full(count, "up"), direction=np.full(count, "fwd"), sequence=np.arange(float(count)),
            angle_deg=angle_deg, output_v=output_v, stable=np.ones(count, dtype=bool),
            temperature_c=np.full(count, np.nan), side=np.full(count, "below"), stand=np.arange(count),
        )
    )  # fmt: skip


def test_both_ends_are_combined_by_the_published_formulas():
    angles_deg = np.linspace(-10, 10, 21)
    up = end(angles_deg, (8e-4, 1.13 * 6e-4), (1.13, 2e-5))
    down = end(angles_deg, (8e-4, -1.13 * 6e-4), (1.13, -2e-5))
    sine, cosine = np.sin(np.radians(angles_deg)), np.cos(np.radians(angles_deg))
    c_bar, k_bar = np.polyfit(sine, cosine, 1)[1], np.polyfit(sine, sine * cosine, 1)[0]
    both = combine(up, down, Mounting())
    g = (up.scale_v_per_g + down.scale_v_per_g) / 2
    assert both.scale_v_per_g.value == pytest.approx(g, rel=1e-14)
    assert both.bias_v.value == pytest.approx((up.bias_v + down.bias_v) / 2, rel=1e-12)
    assert both.misalignment_rad.value == pytest.approx((up.bias_v - down.bias_v) / (2 * g * c_bar), rel=1e-12)
    coupling = (up.scale_v_per_g - down.scale_v_per_g) / (2 * k_bar)
    assert both.coupling_v_per_g2.value == pytest.approx(coupling, rel=1e-6)
    assert k_bar == pytest.approx(0.990, abs=0.001)  # worked by hand


@pytest.mark.parametrize(
    ("up_deg", "down_deg"), [(np.linspace(0, 10, 11), np.linspace(0, 10, 11)), (np.linspace(-10, 10, 21), [0, 2, 5])]
)
def test_any_angles_are_taken_apart(up_deg, down_deg):
    both = combine(
        end(up_deg, (8e-4, 1.13 * 6e-4), (1.13, 2e-5)), end(down_deg, (8e-4, -1.13 * 6e-4), (1.13, -2e-5)), Mounting()
    )
    assert both.bias_v.value == pytest.approx(8e-4, rel=1e-9)
    assert both.scale_v_per_g.value == pytest.approx(1.13, rel=1e-12)
    assert both.misalignment_rad.value == pytest.approx(6e-4, rel=1e-9)
    assert both.coupling_v_per_g2.value == pytest.approx(2e-5, rel=1e-6)


def test_scale_factors_agree_within_the_larger_tolerance():
    difference = Measured(1e-4, 3e-5)
    assert Agreement().judge(difference, 1.0) == "repeat"
    assert Agreement(k=4).judge(difference, 1.0) == "accept"
    assert Agreement(relative=1e-4).judge(difference, -1.0) == "accept"
    assert Agreement(repeats=3).judge(difference, 1.0) == "marginal"
    assert Agreement().judge(Measured(-1e-4, 3e-5), 1.0) == "repeat"


def test_clocking_finds_the_tilt_of_the_seat():
    psi_rad = np.radians([0, 90, 180, 270])
    seat = fit_clocking(psi_rad, 0.5 + 3e-4 * np.cos(psi_rad) - 4e-4 * np.sin(psi_rad))
    assert (seat.p_v, seat.q_v) == pytest.approx((3e-4, -4e-4))
    assert seat.u_per_reading == pytest.approx(np.sqrt(0.5))
    half = fit_clocking(np.radians([0, 180]), np.array([0.7, 0.3]))
    assert (half.p_v, half.q_v, half.u_per_reading) == (pytest.approx(0.2), None, pytest.approx(np.sqrt(0.5)))
    with pytest.raises(NotDetermined, match="mean, cos ψ and sin ψ"):
        fit_clocking(np.radians([0, 90]), np.ones(2))


def test_uncertainty_is_propagated_with_its_correlations():
    a, b, angle = inputs(np.array([2.0, 4.0, 0.3]))
    covariance = np.array([[0.04, 0.03, 0], [0.03, 0.09, 0], [0, 0, 1e-4]])
    assert (a + b).measured(covariance) == Measured(6.0, pytest.approx(np.sqrt(0.04 + 0.09 + 0.06)))
    assert (a - b).measured(covariance) == Measured(-2.0, pytest.approx(np.sqrt(0.04 + 0.09 - 0.06)))
    assert (a * b).measured(covariance).u == pytest.approx(np.sqrt(16 * 0.04 + 4 * 0.09 + 2 * 8 * 0.03))
    ratio = (a / b).measured(covariance)
    assert ratio == Measured(0.5, pytest.approx(0.5 * np.sqrt(0.04 / 4 + 0.09 / 16 - 2 * 0.03 / 8)))
    assert angle.sine().measured(covariance).u == pytest.approx(np.cos(0.3) * 0.01)
    assert weighted(np.array([0.5, 0.5]), [a, b]) == Estimate(3.0, pytest.approx(np.array([0.5, 0.5, 0])))


def test_noise_has_no_conspicuous_line_and_a_beat_has_one():
    rng = np.random.default_rng(1)
    assert sum(conspicuous_periods(rng.standard_normal(21)) is not None for _ in range(2000)) <= 2
    assert conspicuous_periods(np.cos(2 * np.pi * 5 * np.arange(21) / 21) + 0.2 * rng.standard_normal(21)) == 5


@pytest.mark.parametrize("residuals", [np.zeros(21), np.array([1.0, -1, 1, -1]), np.ones(1)])
def test_too_few_residuals_or_none_have_no_line(residuals):
    assert conspicuous_periods(residuals) is None
