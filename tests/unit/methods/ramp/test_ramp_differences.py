"""How the values of a temperature ramp at whole degrees scatter, and what its root mean square is uncertain by."""

from __future__ import annotations

import numpy as np
import pytest

from bench.methods.ramp.reduction.characteristic import RampLimits, reduce_ramp
from bench.methods.ramp.reduction.legs import RampRecord
from bench.metrology.results.finding import Interval
from tests.unit.methods.ramp.test_temperature_ramp import found, loop, reduced, run

SAMPLES = 110  # of a leg, half a degree apart: some lines go through two samples, others through three


def record(output_g):
    up_c = np.linspace(10.1, 60.3, SAMPLES)
    return RampRecord(
        cycle=np.repeat([1, 1, 2, 2], SAMPLES).astype(float), leg=np.repeat(["up", "down", "up", "down"], SAMPLES),
        time_s=10.0 * np.arange(4 * SAMPLES), temperature_c=np.concatenate([up_c, up_c[::-1] + 0.2] * 2),
        output_g=output_g,
    )  # fmt: skip


@pytest.mark.lengthy
def test_differences_scatter_by_their_gains():
    rng = np.random.default_rng(3)
    trials = [reduce_ramp(record(1e-6 * rng.standard_normal(4 * SAMPLES)), RampLimits()) for _ in range(300)]
    for of in ("loops", "changes"):
        first = getattr(trials[0], of)[0]
        scatter_ug = np.std([getattr(each, of)[0].ug for each in trials], axis=0)
        assert np.ptp(first.gain) > 0.15
        assert scatter_ug / first.gain == pytest.approx(1.0, abs=0.2)


def test_what_goes_along_with_the_residuals_knows_that_neighbours_share_a_latch():
    finding = found(reduced(run(loop)))["K0/model_residual_rms"]
    lines = {line.source: line.u for line in finding.budget}
    alone = found(reduced(run(loop)))["K0/model_residual"].interval.from_scatter / 3 / np.sqrt(4 * 239)
    assert 0 < lines["samples: resolution of the count"] < alone / 2


def test_what_is_known_beside_scatter_widens_both_ends_of_an_interval():
    found_ug = Interval(4.0, 8.0, 1.0).beside(1.5)
    assert (found_ug.low, found_ug.high) == pytest.approx((6 - np.hypot(2, 3), 6 + np.hypot(2, 3)))
    assert Interval(0.0, 1.0, 1.0).beside(2.0).low == 0.0
