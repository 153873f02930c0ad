from fractions import Fraction

import numpy as np
import pytest
from numpy.polynomial import polynomial

from bench.metrology.least_squares import NotDetermined, choose_degree, fit_polynomial, least_squares, reject_outliers
from tests.support import strd


def digits(found, exact):
    """Correct decimal digits of the worst coefficient."""
    error = max(abs(float((Fraction(f) - e) / e)) for f, e in zip(map(float, found), exact, strict=True))
    return np.inf if error == 0 else -np.log10(error)


def powers(x, degree):
    return [[value**power for power in range(degree + 1)] for value in x]


def wampler(noise_factor, base=Fraction(1)):
    x = [Fraction(i) for i in range(21)]
    noise = [Fraction(n) * noise_factor for n in strd.WAMPLER_NOISE.split()]
    return x, [sum(base**k * v**k for k in range(6)) + n for v, n in zip(x, noise, strict=True)]


PONTIUS = [Fraction(150_000 * (i % 20 + 1)) for i in range(40)], [Fraction(y) for y in strd.PONTIUS_Y.split()]


@pytest.mark.parametrize(
    ("data", "degree", "least_digits"),
    [
        pytest.param(strd.pairs(strd.NORRIS), 1, 12, id="Norris"),
        pytest.param(PONTIUS, 2, 11, id="Pontius"),
        pytest.param(strd.pairs(strd.FILIP), 10, 6, id="Filip"),
        pytest.param(wampler(0), 5, 9, id="Wampler1"),
        pytest.param(wampler(0, base=Fraction(1, 10)), 5, 12, id="Wampler2"),
        pytest.param(wampler(1), 5, 8, id="Wampler3"),
        pytest.param(wampler(100), 5, 6, id="Wampler4"),
        pytest.param(wampler(10_000), 5, 4.5, id="Wampler5"),
    ],
)
def test_polynomials_of_nist_are_as_exact_as_double_precision_allows(data, degree, least_digits):
    x, y = data
    model = fit_polynomial(np.array(x, dtype=float), np.array(y, dtype=float), degree)
    assert digits(model.powers, strd.exact_solution(powers(x, degree), y)) > least_digits


def test_powers_of_x_themselves_fail_filip():
    x, y = strd.pairs(strd.FILIP)
    design = polynomial.polyvander(np.array(x, dtype=float), 10)
    with pytest.raises(NotDetermined):
        least_squares(design, np.array(y, dtype=float))


def test_longley():
    y, *columns = zip(*([Fraction(v) for v in line.split(",")] for line in strd.LONGLEY.split()), strict=True)
    design = [[Fraction(1), *row] for row in zip(*columns, strict=True)]
    fit = least_squares(np.array(design, dtype=float), np.array(y, dtype=float), condition_limit=1e6)
    assert digits(fit.coefficients, strd.exact_solution(design, y)) > 9
    # Certified, NIST StRD Longley: residual standard deviation, standard deviations of B0 and B6.
    assert fit.residual_sd == pytest.approx(304.854073561965, rel=1e-11)
    u = np.sqrt(np.diag(fit.covariance))
    assert u[[0, 6]] == pytest.approx([890420.383607373, 455.478499142212], rel=1e-9)
    assert (fit.dof, fit.rank) == (9, 7)


@pytest.mark.parametrize(
    ("x", "y"), [(range(60, 71), range(130, 141)), ((4, 5, 6), (3, 4, 4))], ids=["NoInt1", "NoInt2"]
)
def test_a_line_through_the_origin(x, y):
    fit = least_squares(np.array(x, dtype=float)[:, np.newaxis], np.array(y, dtype=float))
    exact = Fraction(sum(a * b for a, b in zip(x, y, strict=True)), sum(a * a for a in x))
    assert digits(fit.coefficients, [exact]) > 14


def test_covariance_is_that_of_repeated_experiments():
    rng = np.random.default_rng(1)
    design = np.stack([np.ones(12), np.linspace(0, 5, 12), np.sin(np.arange(12.0))], axis=-1)
    truth = np.array([1.0, -2.0, 3.0])
    fits = [least_squares(design, design @ truth + 0.1 * rng.standard_normal(12)) for _ in range(4000)]
    scatter = np.cov(np.array([fit.coefficients for fit in fits]).T)
    assert fits[0].unscaled_covariance * 0.1**2 == pytest.approx(scatter, rel=0.1, abs=3e-5)
    assert np.mean([fit.residual_sd**2 for fit in fits]) == pytest.approx(0.1**2, rel=0.03)


def test_no_more_readings_than_coefficients_have_no_scatter():
    fit = least_squares(np.array([[1.0, 0], [1, 1]]), np.array([1.0, 3]))
    assert fit.coefficients == pytest.approx([1, 2])
    assert fit.dof == 0
    assert np.isnan(fit.residual_sd)
    assert np.isnan(fit.covariance).all()


@pytest.mark.parametrize(
    ("columns", "names"),
    [
        ([[1, 1, 1, 1], [1, 2, 3, 4], [2, 4, 6, 8]], ("b", "c")),
        ([[1, 1, 1, 1], [0, 0, 0, 0], [2, 4, 6, 7]], ("b",)),
        ([[1, 1, 1, 1], [1, 2, 3, 4], [1, 1, 1, 1.0001]], ("a", "c")),
        ([[1, 0], [0, 1], [1, 1]], ("a", "b", "c")),
    ],
)
def test_what_is_not_determined_is_named(columns, names):
    design = np.array(columns, dtype=float).T
    with pytest.raises(NotDetermined) as caught:
        least_squares(design, np.ones(len(design)), names="abc")
    assert caught.value.names == names
    assert names[-1] in str(caught.value)


def test_of_equally_uncertain_coefficients_all_are_named():
    """Which of two equal singular values comes last is rounding, and differs from one processor to another."""
    alike = np.array([np.ones(4), [1.0001, 0.9999, 1.0001, 0.9999]]).T
    design = np.kron(np.eye(2), alike)
    with pytest.raises(NotDetermined) as caught:
        least_squares(design, np.ones(8), names="abcd")
    assert (caught.value.names, caught.value.rank) == (tuple("abcd"), 4)


def test_the_condition_limit_can_be_raised():
    design = np.array([[1, 1, 1, 1], [1, 1, 1, 1.0001]]).T
    assert least_squares(design, np.arange(4.0), condition_limit=1e6).condition > 1e4


def test_a_polynomial_in_its_centred_variable_is_the_one_in_powers_of_x():
    rng = np.random.default_rng(2)
    x = np.linspace(-35.3, 74.6, 23)
    y = 7.7e-4 + 1e-5 * x + 8e-10 * x**2 + 4e-10 * x**3 + 3e-5 * rng.standard_normal(23)
    model = fit_polynomial(x, y, 4)
    at = np.array([-40.0, 0.0, 20.0, 75.0])
    assert polynomial.polyval(at, model.powers) == pytest.approx(model.value(at), rel=1e-12)
    assert polynomial.polyval(at, polynomial.polyder(model.powers)) == pytest.approx(model.slope(at), rel=1e-10)
    design = polynomial.polyvander((x - model.centre) / model.scale, 4)
    expected, *_ = np.linalg.lstsq(design, y, rcond=None)
    assert model.coefficients == pytest.approx(expected, rel=1e-10)
    assert model.residuals == pytest.approx(y - model.value(x), abs=1e-16)
    assert (model.valid, model.dof, model.degree) == ((x[0], x[-1]), 18, 4)
    assert model.max_residual == np.max(np.abs(model.residuals))
    assert np.diag(model.correlation) == pytest.approx(np.ones(5))


def test_uncertainties_of_powers_agree_with_the_textbook_line():
    x, y = np.array([1.0, 2, 3, 4, 6]), np.array([1.1, 1.9, 3.2, 3.9, 6.1])
    model = fit_polynomial(x, y, 1)
    spread = np.sum((x - x.mean()) ** 2)
    u_slope = model.residual_sd / np.sqrt(spread)
    assert model.u_powers == pytest.approx([model.residual_sd * np.sqrt(1 / 5 + x.mean() ** 2 / spread), u_slope])
    assert model.u[1] == pytest.approx(u_slope * model.scale)
    assert model.u == pytest.approx(np.sqrt(np.diag(model.covariance)))


def test_a_constant_is_a_polynomial_too():
    model = fit_polynomial(np.array([20.0, 20.0]), np.array([1.0, 3.0]), 0)
    assert model.powers == pytest.approx([2.0])
    assert model.slope(20.0) == 0


@pytest.mark.parametrize("x", [[], [20.0, 20.0, 20.0], [1.0, 2.0, 1.0, 2.0]])
def test_too_few_different_x_do_not_determine_a_polynomial(x):
    with pytest.raises(NotDetermined, match="power 2"):
        fit_polynomial(np.array(x), np.ones(len(x)), 2)


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_the_degree_is_found(degree):
    rng = np.random.default_rng(degree)
    x = np.linspace(-40, 70, 23)
    y = polynomial.polyval((x - 15) / 55, [1, 1, -0.5, 0.4, 0.5][: degree + 1]) + 0.02 * rng.standard_normal(23)
    assert choose_degree(x, y) == degree


def test_a_cube_without_a_square_is_found():
    z = np.linspace(-1, 1, 15)
    assert choose_degree(z, z**3 - 0.6 * z + 0.01 * np.random.default_rng(3).standard_normal(15)) == 3


@pytest.mark.parametrize(
    ("x", "highest"), [([1.0, 2, 3], 4), ([1.0, 1, 2, 2, 1, 2, 1], 4), ([1.0, 2, 3, 4, 5, 6, 7], 1)]
)
def test_too_few_readings_choose_a_line(x, highest):
    assert choose_degree(np.array(x), np.array(x) ** 2, highest) == 1


def test_an_exact_parabola_is_chosen_in_spite_of_rounding():
    x = np.linspace(0, 1, 9)
    assert choose_degree(x, 1 + x + x**2) == 2


def line(n):
    x = np.arange(float(n))
    return np.stack([np.ones(n), x], axis=-1), 2 + 0.5 * x


def test_outliers_are_dropped_and_named():
    design, y = line(40)
    y += 0.01 * np.random.default_rng(4).standard_normal(40)
    clean = y.copy()
    y[[7, 30]] += [5.0, -0.2]
    gated = reject_outliers(design, y)
    assert gated.dropped == [7, 30]
    assert not gated.excessive
    kept = np.delete(np.arange(40), [7, 30])
    assert gated.fit.coefficients == pytest.approx(least_squares(design[kept], clean[kept]).coefficients)


@pytest.mark.parametrize("where", [0, 18, 19, 20])
def test_what_a_huge_outlier_pulls_away_comes_back(where):
    x = np.concatenate([np.linspace(-1, 1, 21), np.linspace(1, -1, 21)])
    way = np.repeat([1.0, -1.0], 21)
    y = x + 0.01 * np.random.default_rng(6).standard_normal(42)
    y[where] += 1e4
    assert reject_outliers(np.stack([np.ones(42), x, x**2, way, way * x], axis=-1), y).dropped == [where]


def test_rounding_of_exact_data_is_no_outlier():
    design, y = line(40)
    assert reject_outliers(design, y).dropped == []


def test_too_many_outliers_are_told():
    design, y = line(30)
    y += 0.01 * np.random.default_rng(5).standard_normal(30)
    y[[3, 8, 15, 22]] += 40
    gated = reject_outliers(design, y)
    assert gated.dropped == [3, 8, 15, 22]
    assert gated.excessive
