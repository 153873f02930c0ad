"""Scatters that are one, and those that are not."""

import numpy as np
import pytest
from scipy.stats import bartlett

from bench.metrology.pooled_scatter import Scatter, alike


def of_samples(rng, *sds, count=30):
    samples = [sd * rng.standard_normal(count) for sd in sds]
    return samples, [Scatter(float(np.std(each, ddof=1)), count - 1) for each in samples]


def test_scatters_are_alike_when_the_test_of_others_says_so():
    rng, seen = np.random.default_rng(1), set()
    for ratio in (1.0, 1.2, 1.5, 2.0):
        for _ in range(100):
            samples, scatters = of_samples(rng, 1.0, 1.0, ratio, 1.0)
            expected = bartlett(*samples).pvalue >= 0.05
            assert (alike(scatters) is not None) == expected
            seen.add((ratio, bool(expected)))
    assert {(1.0, True), (1.0, False), (2.0, True), (2.0, False)} <= seen


def test_together_they_tell_it_better():
    _, scatters = of_samples(np.random.default_rng(2), *[3.0] * 8)
    together = alike(scatters)
    assert together.dof == 8 * 29
    assert together.sd == pytest.approx(3.0, rel=0.1)
    assert together.sd == pytest.approx(np.sqrt(np.mean([each.sd**2 for each in scatters])))


@pytest.mark.parametrize("scatters", [[], [Scatter(1.0, 9)], [Scatter(1.0, 9), Scatter(0.0, 9)], [Scatter(1.0, 0)] * 2])
def test_what_tells_no_scatter_is_not_taken_together(scatters):
    assert alike(scatters) is None
