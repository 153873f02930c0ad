"""Series for curves: no extreme value is lost, and later parts continue earlier ones."""

import numpy as np
import pytest

from bench.station.runs.series import buckets_of, rates_of, slope_and_range, thinned, width_of
from bench.store.reader import RunReader
from bench.store.tail import Tail
from tests.support.runs import run_short

PROCESS_VALUE = "chamber.process_value"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return run_short(tmp_path_factory.mktemp("series"), sequence="smoke").path


def test_an_oscillation_faster_than_the_intervals_is_seen_as_a_band():
    at_s = np.arange(0, 100, 0.1)
    values = np.sin(2 * np.pi * at_s / 10 * 0.999)
    found = buckets_of(at_s, values, 10.0)
    assert [each.at_s for each in found] == [10.0 * n for n in range(10)]
    assert all(each.low < -0.99 and each.high > 0.99 and abs(each.mean) < 0.05 for each in found)


def test_intervals_without_values_are_left_out():
    assert [each.at_s for each in buckets_of(np.array([0.5, 7.0, 7.9]), np.array([1.0, 2.0, 3.0]), 1.0)] == [0.0, 7.0]
    assert buckets_of(np.empty(0), np.empty(0), 1.0) == []


@pytest.mark.parametrize(("span_s", "width_s"), [(900, 2.0), (3600, 10.0), (118_000, 200.0), (1.0, 0.1), (600, 1.0)])
def test_the_width_is_round_and_gives_at_most_the_points_asked_for(span_s, width_s):
    assert width_of(span_s, 600) == pytest.approx(width_s)


def test_thinned_readings_have_the_extremes_of_all(run):
    with RunReader(run) as reader:
        series = reader.series(PROCESS_VALUE)
    found = thinned(run, [PROCESS_VALUE], 0.0, 20.0)[PROCESS_VALUE]
    assert found.unit == "°C"
    assert len(found.buckets) > 3
    for each in found.buckets:
        inside = series.values[(series.at_s >= each.at_s) & (series.at_s < each.at_s + 20.0)]
        assert (each.low, each.high) == (inside.min(), inside.max())
        assert each.mean == pytest.approx(inside.mean())


def test_a_later_part_continues_an_earlier_one(run):
    whole = thinned(run, [PROCESS_VALUE], 0.0, 10.0)[PROCESS_VALUE].buckets
    part = thinned(run, [PROCESS_VALUE], 34.0, 10.0)[PROCESS_VALUE].buckets
    assert part == [each for each in whole if each.at_s >= 30.0]


def test_pulse_rates_come_from_the_stored_frames(run):
    found = thinned(run, ["counter.x", "counter.nothing", PROCESS_VALUE], 0.0, 1.0)
    assert found.keys() == {"counter.x", PROCESS_VALUE}
    rates = [each.mean for each in found["counter.x"].buckets]
    assert max(rates) > 10_000
    assert min(rates) < -10_000
    assert [each.at_s for each in found["counter.x"].buckets] == sorted(
        each.at_s for each in found["counter.x"].buckets
    )


def test_readings_of_an_instant_are_found_without_a_search_through_all(run):
    with Tail(run) as tail:
        _, last_s = tail.span_s()
        assert tail._first_after(-1.0) == 1
        assert tail._first_after(last_s + 1) == tail.last_reading() + 1
        middle = tail._first_after(last_s / 2)
        before = tail._rows("SELECT at_s FROM reading WHERE seq < ?", middle)
        assert all(at_s <= last_s / 2 + 60 for (at_s,) in before)


def test_slope_and_range_of_the_newest_readings(run):
    slope, spread = slope_and_range(run, PROCESS_VALUE, 60.0)
    assert abs(slope) < 0.1
    assert 0 < spread < 5
    assert slope_and_range(run, "nothing", 60.0) is None


def test_a_counter_that_wraps_has_no_jump():
    class Wrapped:
        positive, negative = np.array([2**16 - 5, 5, 15]), np.array([0, 0, 0])
        tick, tick_bits, counter_bits, tick_period_s = np.array([2**32 - 1, 0, 1]), 32, 16, 1.0

    assert rates_of(Wrapped).tolist() == [10.0, 10.0]
