"""What is drawn of a channel."""

import dataclasses

import numpy as np
import pytest

from bench.figures.plots import TimeOfRun
from bench.methods.channel import shown as of_channels
from tests.support.figures import kept_figures
from tests.unit.methods.channel.test_channel_method import Made, reduced


@pytest.fixture
def drawn(monkeypatch):
    return kept_figures(monkeypatch, of_channels)


def test_the_converter_is_drawn_over_the_time_that_the_course_has(drawn):
    made = Made().level("gravity", 1.0)  # from 1000 s of bench time, with the ramp from 1601 s
    unit = reduced(made)
    span_s = (400.0, 8000.0)
    detail = dataclasses.replace(unit.detail, span_s=span_s)
    list(of_channels.channel_plots(dataclasses.replace(unit, detail=detail), "a"))
    (axes,) = drawn["Temperature of the converter while each level was counted"].axes
    assert axes.get_xlabel() == "time since the run began / h"
    assert axes.get_xlim() == (0.0, (span_s[1] - span_s[0]) / 3600)
    first_h = axes.lines[0].get_xdata()[0]
    assert first_h == pytest.approx((1601.0 - 400.0) / 3600, abs=0.01)


def test_a_short_run_is_drawn_over_minutes():
    assert TimeOfRun(10.0, 7210.0).unit == ("min", 60.0)
    assert TimeOfRun(10.0, 7211.0).unit == ("h", 3600.0)
    assert TimeOfRun(10.0, 7210.0).at(np.array([10.0, 70.0])).tolist() == [0.0, 1.0]
