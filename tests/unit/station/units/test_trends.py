"""Trends of a unit: numbers computed by hand, and the coverage of the drift against simulated truth."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from bench.station.units.trends import YEAR, Calibration, covariance, drift, e_n, reaches_limit

BEGIN = datetime(2020, 1, 1, tzinfo=UTC)


def at(years):
    return BEGIN + years * YEAR


def test_e_n_of_independent_calibrations():
    # (10.5 - 10.0) / sqrt(0.3² + 0.4²)
    assert e_n(Calibration(at(0), 10.0, 0.3), Calibration(at(1), 10.5, 0.4)) == pytest.approx(1.0)


def test_an_error_that_both_calibrations_share_does_not_hide_a_change():
    # Each: u = 0.5, of which 0.4 are shared, so that 0.3 are not: U of the difference = 2·sqrt(2)·0.3
    first, second = (Calibration(at(n), value, 1.0, {"head": 0.4}) for n, value in ((0, 1.0), (1, 2.0)))
    assert e_n(first, second) == pytest.approx(1.0 / (2 * np.sqrt(2) * 0.3))
    assert e_n(first, second._replace(shared={"other head": 0.4})) == pytest.approx(1.0 / np.sqrt(2))


def test_the_whole_error_shared_leaves_no_uncertainty_to_compare_with():
    first, second = (Calibration(at(n), 1.0 + n, 1.0, {"head": 0.5}) for n in (0, 1))
    assert e_n(first, second) is None
    assert drift([first, second]) is None


def test_the_covariance_is_the_sum_over_shared_errors():
    found = [
        Calibration(at(0), 0.0, 2.0, {"a": 0.5, "b": 0.2}),
        Calibration(at(1), 0.0, 4.0, {"a": 0.6, "b": 0.3}),
        Calibration(at(2), 0.0, 2.0, {"b": 0.1}),
    ]
    assert covariance(found) == pytest.approx(np.array([[1.0, 0.36, 0.02], [0.36, 4.0, 0.03], [0.02, 0.03, 1.0]]))


def test_drift_of_two_calibrations_is_their_difference():
    found = drift([Calibration(at(0), 1.0, 0.2), Calibration(at(2), 2.0, 0.2)])
    assert found.per_year == pytest.approx(0.5)
    assert found.expanded == pytest.approx(np.sqrt(0.2**2 + 0.2**2) / 2)
    assert (found.dof, found.fits) == (0, True)
    assert found.predicted(at(4)) == pytest.approx((3.0, np.sqrt((2 * 0.2) ** 2 + 0.2**2)))


def test_drift_of_four_calibrations_by_hand():
    # Values 1, 2, 2, 3 at years 0 to 3 with u = 1: slope 0.6, u = 1/sqrt(5); residuals -0.1, 0.3, -0.3, 0.1
    found = drift([Calibration(at(n), value, 2.0) for n, value in enumerate((1.0, 2.0, 2.0, 3.0))])
    assert found.per_year == pytest.approx(0.6)
    assert found.expanded == pytest.approx(2 / np.sqrt(5))
    assert found.chi_squared == pytest.approx(0.2)
    assert found.value == pytest.approx(2.9)
    assert not found.is_significant


def test_an_error_that_all_share_leaves_the_drift_as_it_is():
    # A common error moves all values: the slope has the uncertainty of the other parts alone, the value has it.
    alone = [Calibration(at(n), float(n), 0.6) for n in range(4)]
    shared = [each._replace(expanded=1.0, shared={"head": 0.4}) for each in alone]
    assert drift(shared).expanded == pytest.approx(drift(alone).expanded)
    assert drift(shared).covariance[0] == pytest.approx(drift(alone).covariance[0] + 0.4**2)


def test_residuals_beyond_the_uncertainties_widen_that_of_the_drift():
    values = (0.0, 5.0, -5.0, 5.0, 0.0)
    found = drift([Calibration(at(n), value, 0.2) for n, value in enumerate(values)])
    assert not found.fits
    # Slope 0; residual sum of squares 75 - 5·1² = 70, s² = 70/3, u² = s²/10; t(95.45 %, 3 degrees of freedom) = 3.307
    assert found.per_year == pytest.approx(0.0, abs=1e-12)
    assert found.expanded == pytest.approx(3.307 * np.sqrt(70 / 3 / 10), rel=1e-3)


def test_calibrations_of_one_day_show_no_drift():
    assert drift([Calibration(BEGIN, 1.0, 0.1)]) is None
    assert drift([Calibration(BEGIN + timedelta(hours=n), 1.0, 0.1) for n in (0, 23)]) is None


def test_the_day_on_which_a_limit_may_be_reached():
    # 1.0 per year ± 0.1·sqrt(2) per year; from 1.0 ± 0.1 towards 2.0: 1 + t + U(t) = 2 at t ≈ 0.80
    found = drift([Calibration(at(0), 0.0, 0.1), Calibration(at(1), 1.0, 0.1)])
    year = (reaches_limit(found, None, 2.0) - at(1)) / YEAR
    value, expanded = found.predicted(at(1 + year))
    assert value + expanded == pytest.approx(2.0, abs=0.005)
    assert year == pytest.approx(0.80, abs=0.02)
    assert reaches_limit(found, None, 100.0) is None
    assert reaches_limit(found, 1.05, None) == at(1)  # it is there already


def simulated(seed, groups, times, slope=0.3, u_own=0.1, u_shared=0.5):
    """Calibrations of a unit that drifts; those with the same certificate share an error."""
    random = np.random.default_rng(seed)
    errors = {name: random.normal(0, u_shared) for name in groups}
    u = np.hypot(u_own, u_shared)
    return [
        Calibration(at(time), slope * time + errors[name] + random.normal(0, u_own), 2 * u, {name: u_shared})
        for time, name in zip(times, groups, strict=True)
    ]


@pytest.mark.parametrize(
    ("groups", "times"),
    [
        ("aaaa", (0, 1, 2, 3)),  # one certificate: the shared error cancels
        ("aaabbb", (0, 0.5, 1, 2, 2.5, 3)),  # a new certificate after half of them
        ("aaaaab", (0, 1, 1.5, 2, 3, 4)),
    ],
)
def test_the_interval_of_the_drift_covers_the_truth(groups, times):
    trials = 2000
    found = [drift(simulated(seed, groups, times)) for seed in range(trials)]
    covered = sum(abs(each.per_year - 0.3) <= each.expanded for each in found) / trials
    assert 0.94 < covered < 0.975
    ratio = np.std([each.per_year for each in found]) / np.mean([each.expanded / 2 for each in found if each.fits])
    assert ratio == pytest.approx(1.0, abs=0.06)


def test_without_the_covariance_a_new_certificate_would_pretend_a_drift():
    """The same data as independent values: the interval of a drift across a new certificate is far too narrow."""
    many = [simulated(seed, "aaaaaaaaaabbbbbbbbbb", np.linspace(0, 4, 20)) for seed in range(500)]
    naive = [[each._replace(shared={}) for each in trial] for trial in many]
    rate = [
        np.mean([abs(found.per_year - 0.3) > found.expanded for found in map(drift, trials)])
        for trials in (many, naive)
    ]
    assert rate[0] < 0.08
    assert rate[1] > 2 * rate[0]
