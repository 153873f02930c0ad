"""Pulse rates minus their expectation, and the newest samples as they were acquired."""

import numpy as np
import pytest

from bench.config.fixture import InputAxis
from bench.station.runs import deviation
from bench.station.runs.deviation import Expectation
from bench.station.runs.scope import newest_samples, period_s
from bench.station.runs.series import joined, thinned
from bench.store.reader import Event
from bench.store.tail import Bucket, Tail
from tests.support.runs import run_short

AXIS = InputAxis(at_0="level", at_90="up")
TURNED = Expectation("a", "head", "source", AXIS, 0.0, 1000.0, {"upright": 0.0, "inverted": 180.0})


class Journal:
    """The steps of a run, for a tail."""

    def __init__(self, *events):
        self._events = [Event(n, at_s, kind, "s", data) for n, (at_s, kind, data) in enumerate(events)]

    def steps_with(self, text):
        return [each for each in self._events if text.strip('"') in str(each.data)]


def away(at_s, *events):
    found = deviation.deviation(Journal(*events), TURNED, [Bucket(at_s, 990.0, 1010.0, 1000.0)], 1.0)
    return [round(each.mean, 6) for each in found]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return run_short(tmp_path_factory.mktemp("deviation"), sequence="smoke").path


def test_the_expectation_follows_angle_and_mount():
    assert TURNED.at(90.0, None) == pytest.approx(1000.0)
    assert TURNED.at(30.0, None) == pytest.approx(500.0)
    assert TURNED.at(90.0, "inverted") == pytest.approx(-1000.0)


def test_there_is_none_before_the_head_was_moved_while_it_moves_and_while_a_source_is_on():
    moved = (1.0, "step_begins", {"device": "head"}), (5.0, "step_ended", {"device": "head", "angle_deg": 90.0})
    assert away(0.0) == []
    assert away(10.0, *moved) == [0.0]
    assert away(2.0, *moved) == []
    assert away(10.0, *moved, (8.0, "step_begins", {"device": "head", "target_deg": 1.0})) == []
    on = (8.0, "step_begins", {"device": "source", "output": "on"})
    assert away(10.0, *moved, on) == []
    assert away(10.0, *moved, on, (9.0, "step_ended", {"role": "source", "output": False})) == [0.0]
    assert away(10.0, *moved, (8.0, "step_ended", {"mount": "inverted"})) == [2000.0]


def test_a_simulated_unit_is_near_its_expectation(run):
    found = thinned(run, ["counter.x", "counter.x.deviation", "counter.y.deviation"], 0.0, 5.0)
    assert found.keys() == {"counter.x", "counter.x.deviation"}  # no unit is stated for y
    rates, deviations = (found[name].buckets for name in ("counter.x", "counter.x.deviation"))
    assert max(abs(each.mean) for each in rates) > 10_000
    assert len(deviations) > len(rates) / 2
    assert all(abs(each.mean) < 200 for each in deviations)


def test_wider_intervals_have_the_extremes_of_those_in_them():
    fine = [Bucket(0.0, -1.0, 1.0, 0.0), Bucket(4.0, -5.0, 3.0, 2.0), Bucket(10.0, 0.0, 1.0, 0.5)]
    assert joined(fine, 10.0) == [Bucket(0.0, -5.0, 3.0, 1.0), Bucket(10.0, 0.0, 1.0, 0.5)]


def test_the_scope_has_every_latch_of_the_newest_acquisition(run):
    found = newest_samples(run, lambda _: 3.0)
    samples = found.channels["counter.x"]
    assert (samples.unit, found.step.rpartition("/")[2]) == ("pulse/s", "acquire")
    assert np.diff(samples.at_s) == pytest.approx(0.1, abs=0.001)
    assert len(samples.values) == pytest.approx(30, abs=1)
    assert samples.at_s[-1] == pytest.approx(found.until_s, abs=0.2)
    with Tail(run) as tail:
        assert found.until_s == tail.blocks(0.0, 1)[0].last_s


def test_the_period_is_that_of_the_oscillation_around_a_step():
    steps = [
        {"id": "steps/move", "facts": {"verb": "move"}},
        {"id": "steps/oscillate", "facts": {"verb": "oscillate", "frequency_hz": 4.0}},
        {"id": "steps/sweep", "facts": {"verb": "oscillate", "sweep": {"from_hz": 2.0, "to_hz": 100.0}}},
    ]
    assert period_s(steps, "steps/oscillate/acquire") == 0.25
    assert period_s(steps, "steps/sweep/acquire") == 0.5
    assert period_s(steps, "steps/move") is None
    assert period_s([], "steps/oscillate/acquire") is None
