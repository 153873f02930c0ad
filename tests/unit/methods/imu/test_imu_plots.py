"""What is drawn of an inertial unit."""

import dataclasses

import numpy as np
import pytest

from bench.methods.imu import shown as of_inertial_units
from tests.support.figures import kept_figures
from tests.unit.methods.imu.test_imu_windows import BENCH, block, result


@pytest.fixture
def drawn(monkeypatch):
    return kept_figures(monkeypatch, of_inertial_units)


def test_what_knots_change_by_has_the_bars_of_its_findings(drawn):
    made = [window for group, at_c in (("s/1", -10.0), ("s/2", 20.0), ("s/3", 50.0)) for window in at(group, at_c)]
    unit = result(made)
    plots = list(of_inertial_units.imu_plots(unit, "a"))
    reported = [plot.caption for plot in plots if "over temperature" in plot.title]
    assert all("Bars: expanded uncertainty, 95 %" in caption for caption in reported)
    figure = drawn["Gyros over temperature, before and after compensation"]
    of_zero, of_scale, left_out, _ = figure.axes
    expanded = {(each.quantity, each.at["axis"]): each.expanded for each in unit.findings if "visit" not in each.at}
    for axis, above, below in zip("xyz", of_zero.containers, left_out.containers, strict=True):
        assert heights(above) == pytest.approx([2 * 3600 * expanded["D0/change", axis]] * 3)
        assert heights(below) == pytest.approx([2 * 3600 * expanded["D0/interpolation", axis]])
    assert heights(of_scale.containers[1]) == pytest.approx([2e6 * expanded["KG/change", "y"]] * 3)
    beside = [container.lines[0].get_xdata()[0] for container in left_out.containers]
    assert beside == pytest.approx([20 - 0.03 * 60, 20, 20 + 0.03 * 60], abs=1e-6)


def at(group, temperature_c):
    """All windows of a unit at one temperature, with noise."""
    made = block(BENCH, group, "xyz", rng=np.random.default_rng(round(temperature_c) + 100))
    return [
        dataclasses.replace(each, set_c=temperature_c, temperatures_c={"t": np.full(3, temperature_c)}) for each in made
    ]


def heights(container):
    """From the lower to the upper end of each bar."""
    (bars,) = container.lines[2]
    return [float(upper[1] - lower[1]) for lower, upper in bars.get_segments()]
