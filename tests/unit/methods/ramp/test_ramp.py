import numpy as np
import pytest

from bench.methods.ramp.reduction.legs import RampRecord, cut_into_legs
from bench.methods.ramp.reduction.turns import on_its_way
from bench.metrology.temperature_checks import broken_at_rest, broken_on_a_ramp
from tests.support.m4_cases import lagging_c

NAN = np.nan


def record(*rows):
    cycle, leg, time_s, temperature_c, output_g = zip(*rows, strict=True)
    return RampRecord(
        cycle=np.array(cycle, dtype=float),
        leg=np.array(leg),
        time_s=np.array(time_s, dtype=float),
        temperature_c=np.array(temperature_c, dtype=float),
        output_g=np.array(output_g, dtype=float),
    )


def test_rows_in_any_order_become_legs_in_order():
    legs, excluded = cut_into_legs(
        record(
            (2, "up", 9, 20, 9), (1, "down", 7, 21, 7), (1, "up", 2, 21, 2), (1, "up", 1, 20, 1), (1, "down", 6, 22, 6)
        )
    )  # fmt: skip
    assert [(leg.cycle, leg.name, leg.output_g.tolist()) for leg in legs] == [
        (1, "up", [1, 2]),
        (1, "down", [6, 7]),
        (2, "up", [9]),
    ]
    assert excluded == {"missing": 0, "duplicate": 0, "thermometer": 0, "turn": 0}


def test_legs_may_each_start_their_own_clock():
    legs, _ = cut_into_legs(record((1, "up", 0, 20, 1), (1, "down", 0, 21, 3), (1, "up", 1, 21, 2)))
    assert [leg.output_g.tolist() for leg in legs] == [[1, 2], [3]]


def test_what_is_missing_or_double_is_left_out_and_counted():
    legs, excluded = cut_into_legs(
        record(
            (1, "up", 1, 20, 1),
            (1, "up", 2, NAN, 2),
            (1, "up", 3, 21, NAN),
            (1, "up", NAN, 21, 4),
            (1, "", 5, 21, 5),
            (NAN, "up", 6, 21, 6),
            (1, "up", 7, 21, 7),
            (1, "up", 7, 21, 70),
            (1, "up", 8, 21, np.inf),
        )
    )
    assert [leg.output_g.tolist() for leg in legs] == [[1, 7]]
    assert excluded == {"missing": 6, "duplicate": 1, "thermometer": 0, "turn": 0}


def test_the_first_good_row_of_a_time_is_kept():
    legs, _ = cut_into_legs(record((1, "up", 1, 20, NAN), (1, "up", 1, 20, 5), (1, "up", 1, 20, 6)))
    assert legs[0].output_g.tolist() == [5]
    assert legs[0].complete


@pytest.mark.parametrize(("good", "complete"), [(5, True), (4, False), (0, False)])
def test_a_leg_that_lost_more_than_half_is_not_complete(good, complete):
    rows = [(1, "up", i, 20, i if i < good else NAN) for i in range(10)]
    legs, _ = cut_into_legs(record(*rows))
    assert [leg.complete for leg in legs] == [complete]


def test_no_rows_are_no_legs():
    assert cut_into_legs(record((NAN, "", NAN, NAN, NAN))) == (
        [],
        {"missing": 1, "duplicate": 0, "thermometer": 0, "turn": 0},
    )


def test_a_hole_in_time_parts_a_leg():
    times = [0, 10, 20, 30, 100, 110, 120]
    legs, _ = cut_into_legs(record(*((1, "up", t, 20, t) for t in times)))
    assert [times[part] for part in legs[0].stretches(longest_hole=6)] == [[0, 10, 20, 30], [100, 110, 120]]
    assert [times[part] for part in legs[0].stretches(longest_hole=7)] == [times]


@pytest.mark.parametrize("samples", [0, 1])
def test_a_leg_without_intervals_is_one_stretch(samples):
    rows = [(1, "up", 0, 20, 1 if samples else NAN)]
    legs, _ = cut_into_legs(record(*rows))
    assert [part.stop - part.start for part in legs[0].stretches(longest_hole=3)] == [samples]


RAMP, TIME_S = np.linspace(20, 30, 21), 10.0 * np.arange(21)


@pytest.mark.parametrize(
    ("broken", "value"), [([5], 26.0 + 5), ([0], 10.0), ([20], 850.0), ([3, 4], -242.0), ([0, 1], 850.0), ([], 0.0)]
)
def test_a_temperature_that_jumps_on_a_ramp_is_broken(broken, value):
    temperature_c = RAMP.copy()
    temperature_c[broken] = value
    assert np.flatnonzero(broken_on_a_ramp(TIME_S, temperature_c)).tolist() == broken


def test_an_open_sensor_is_broken_for_as_long_as_it_is_open():
    temperature_c = RAMP.copy()
    temperature_c[4:15] = 850.0
    assert np.flatnonzero(broken_on_a_ramp(TIME_S, temperature_c)).tolist() == list(range(4, 15))
    assert broken_on_a_ramp(TIME_S[:5], np.full(5, 850.0)).all()
    assert broken_at_rest(np.full(5, -242.0)).all()


def test_a_steep_and_coarse_ramp_is_not_broken():
    assert not broken_on_a_ramp(np.arange(25.0), np.arange(-40.0, 80.0, 4.9)).any()
    assert not broken_on_a_ramp(np.arange(20.0), np.arange(-40.0, 80.0, 6.0)).any(), "6 °C from each sample to the next"


@pytest.mark.parametrize("broken", [slice(0, 2), slice(19, 21), slice(8, 13), slice(10, 20)])
@pytest.mark.parametrize("value", [150.0, -60.0, 40.0])
def test_a_sensor_that_says_something_else_for_a_while_is_broken_for_that_while(broken, value):
    temperature_c = RAMP.copy()
    temperature_c[broken] = value
    assert np.flatnonzero(broken_on_a_ramp(TIME_S, temperature_c)).tolist() == list(range(21))[broken]


def test_a_ramp_goes_on_after_a_hole_in_the_record():
    kept = np.r_[:5, 35:41]
    assert not broken_on_a_ramp(np.arange(41.0)[kept], np.linspace(20, 60, 41)[kept]).any()


def test_a_temperature_far_from_its_dwell_is_broken():
    assert broken_at_rest(np.array([20.1, 20.0, 26.0, 19.9, 14.5])).tolist() == [False, False, True, False, True]
    assert broken_at_rest(np.zeros(0)).tolist() == []


def turning_c(time_s):
    """4 min behind air that goes from -40 to 60 °C and then back, of a unit that is still cooling."""
    air_c = np.where(time_s < 2000, -40 + 0.05 * time_s, 160 - 0.05 * time_s)
    return lagging_c(time_s, air_c, 240.0) + 10 * np.exp(-time_s / 240.0)


@pytest.mark.parametrize("falls", [False, True])
def test_a_leg_has_each_temperature_once(falls):
    """A noisy thermometer with readings that are off, a broken one, and samples without a temperature."""
    time_s = np.arange(0.0, 2300.0, 10.0)
    warm_c = turning_c(time_s)
    turns = np.argmin(warm_c), np.argmax(warm_c)
    read_c = warm_c + 0.005 * np.random.default_rng(1).standard_normal(len(time_s))
    read_c[[3, 90]] += 4.0
    read_c[100:108], read_c[120:123] = 850.0, NAN
    kept = on_its_way(time_s, -read_c if falls else read_c, falls=falls)
    stored_c = warm_c[kept]
    assert turns[0] > 5
    assert turns[1] < len(time_s) - 5, "it turns at either end"
    assert np.all(np.diff(stored_c) > 0)
    assert (stored_c[0], stored_c[-1]) == pytest.approx((warm_c[2], warm_c[-3]), abs=0.6)
    assert kept[100:125].all(), "what is broken or missing is told elsewhere"


def test_a_leg_that_does_not_turn_is_whole_and_one_that_goes_the_other_way_is_none():
    time_s = 10.0 * np.arange(60)
    rising_c = np.linspace(-40.0, 60.0, 60)
    assert on_its_way(time_s, rising_c, falls=False).all()
    assert not on_its_way(time_s, rising_c, falls=True).any()
    assert on_its_way(time_s, np.full(60, 20.0), falls=False).all()
    assert on_its_way(time_s, np.full(60, NAN), falls=False).all()
    assert on_its_way(time_s[:4], np.array([3.0, 2.0, 1.0, 4.0]), falls=False).all(), "too few to be seen to turn"
    assert on_its_way(time_s[:0], rising_c[:0], falls=False).tolist() == []


def test_a_leg_in_two_pieces_turns_in_neither():
    """From 60 °C up, and after a hole in time from the bottom up to where it began."""
    temperature_c = np.concatenate([np.linspace(60, 80, 20), np.linspace(-40, 60, 100)])
    time_s = np.concatenate([10.0 * np.arange(20), 5000 + 10.0 * np.arange(100)])
    assert on_its_way(time_s, temperature_c, falls=False).all()


@pytest.mark.parametrize(("name", "samples"), [("up", 20), ("down", 0)])
def test_a_leg_that_goes_the_other_way_is_not_complete(name, samples):
    (leg,), excluded = cut_into_legs(record(*((1, name, 10.0 * k, 20.0 + k, 0.0) for k in range(20))))
    assert (len(leg.time_s), leg.complete, excluded["turn"]) == (samples, bool(samples), 20 - samples)
