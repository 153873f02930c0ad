from dataclasses import replace

import numpy as np
import pytest

from bench.methods.threshold.reduction.threshold import LadderRecord, find_threshold

ARCSEC_G = np.radians(1 / 3600)
SIZES = (1.0, 2, 5, 10, 20, 50)  # arcsec


def soft_dead_band(width_g):
    """An output that follows only what is beyond `width_g` of the reference, as friction makes it."""
    return lambda input_g: np.sign(input_g) * np.maximum(np.abs(input_g) - width_g, 0.0)


def follows(input_g):
    return input_g


def ladder(response=follows, *, sizes=SIZES, senses=(1, -1), repeats=3, drift_g=0.0, noise=None, at_deg=0.0):
    """Readings of 100 s in turn at the reference and at a step; one count is 0.5 µg.

    `response` gives the output change by the change of input, `drift_g` is that of the zero from reading to reading,
    `noise` one error in g for each reading.
    """
    steps = [sense * size for size in sizes for sense in senses for _ in range(repeats)]
    step = np.array([0.0, *(at for each in steps for at in (each, 0.0))])
    number = np.arange(len(step))
    input_g = np.sin(np.radians(at_deg + step / 3600))
    output_g = 3e-4 + input_g[0] + response(input_g - input_g[0]) + drift_g * number
    return LadderRecord(
        time_s=100.0 * number,
        step=step,
        input_g=input_g,
        output_g=output_g if noise is None else output_g + noise,
        u_g=np.full(len(step), 2e-7),
        count_g=np.full(len(step), 5e-7),
    )


def by_size(found, sense=1):
    return [step for step in sorted(found.steps, key=lambda s: s.size_g) if step.input_g * sense > 0]


def changed(record, column, rows, value):
    values = getattr(record, column).copy()
    values[rows] = value
    return replace(record, **{column: values})


def at(arcsec):
    return pytest.approx(arcsec * ARCSEC_G, rel=1e-6)


# The definition


def test_a_unit_that_follows_every_step_is_told_as_at_most_the_smallest():
    found = find_threshold(ladder())
    assert (found.relation, found.threshold_g, found.low_g) == ("at_most", at(1), 0.0)
    assert all(step.passed and step.repeats == 3 for step in found.steps)
    assert [step.ratio for step in found.steps] == pytest.approx([1.0] * 12, rel=1e-9)
    assert [step.input_g for step in found.steps] == sorted(step.input_g for step in found.steps)
    assert (found.left_out, found.dof) == (0, 24)


def test_the_threshold_is_the_smallest_step_with_half_of_the_change_expected():
    found = find_threshold(ladder(soft_dead_band(15e-6)))  # half at 30 µg, between 5″ (24 µg) and 10″ (48 µg)
    assert (found.relation, found.low_g, found.threshold_g) == ("equal", at(5), at(10))
    assert found.u_ladder_g == pytest.approx(5 * ARCSEC_G / np.sqrt(3), rel=1e-6)
    assert [step.passed for step in by_size(found)] == [False, False, False, True, True, True]
    assert by_size(found)[4].ratio == pytest.approx(1 - 15e-6 / (20 * ARCSEC_G), rel=1e-6)
    assert found.flags == ()


def test_half_is_enough():
    assert find_threshold(ladder(lambda input_g: 0.501 * input_g)).relation == "at_most"
    assert find_threshold(ladder(lambda input_g: 0.499 * input_g)).relation == "more_than"


def test_the_larger_of_both_senses_counts():
    def response(input_g):
        return np.where(input_g > 0, soft_dead_band(4e-6)(input_g), soft_dead_band(40e-6)(input_g))

    found = find_threshold(ladder(response))
    assert (found.low_g, found.threshold_g) == (at(10), at(20))
    assert [step.passed for step in by_size(found, -1)] == [False] * 4 + [True] * 2


def test_ladders_that_differ_between_senses_narrow_each_other():
    # It is above 2″ in one sense and up to 10″ in the other, whose ladder has no step between 1″ and 10″.
    record = ladder(soft_dead_band(6e-6), sizes=(1, 2, 5, 10))
    found = find_threshold(record.rows(~np.isin(record.step, (-2, -5))))
    assert (found.low_g, found.threshold_g) == (at(2), at(10))


def test_a_unit_that_never_follows_has_more_than_the_largest_step():
    found = find_threshold(ladder(lambda input_g: 0.1 * input_g))
    assert (found.relation, found.low_g, found.high_g) == ("more_than", at(50), np.inf)
    assert np.isnan([found.threshold_g, found.u_ladder_g]).all()


def test_an_output_that_goes_the_other_way_fails():
    found = find_threshold(ladder(lambda input_g: -input_g))
    assert not any(step.passed for step in found.steps)


def test_about_a_biased_input_it_is_the_resolution():
    found = find_threshold(ladder(soft_dead_band(15e-6), at_deg=30.0))  # a step is worth cos 30° of what it is at 0°
    assert found.threshold_g == pytest.approx(np.cos(np.radians(30)) * 10 * ARCSEC_G, rel=1e-4)
    assert [step.passed for step in by_size(found)] == [False, False, False, True, True, True]


# Order, drift, what is missing


@pytest.mark.parametrize("drift_g", [5e-6, -20e-6])
def test_a_drift_of_the_zero_is_no_step(drift_g):
    still = find_threshold(ladder(soft_dead_band(15e-6)))
    drifting = find_threshold(ladder(soft_dead_band(15e-6), drift_g=drift_g))
    assert [step.ratio for step in drifting.steps] == pytest.approx([step.ratio for step in still.steps], abs=1e-8)
    assert find_threshold(ladder(lambda input_g: 0.0 * input_g, drift_g=drift_g)).relation == "more_than"


def test_a_drift_is_taken_out_by_time_not_by_number():
    record = ladder(soft_dead_band(15e-6))
    time_s = np.cumsum(np.random.default_rng(3).uniform(50, 150, len(record.step)))
    drifting = replace(record, time_s=time_s, output_g=record.output_g + 1e-7 * time_s)
    ratios = [step.ratio for step in find_threshold(drifting).steps]
    assert ratios == pytest.approx([step.ratio for step in find_threshold(record).steps], abs=1e-8)


def test_the_order_of_rows_and_double_rows_change_nothing():
    record = ladder(soft_dead_band(15e-6))
    order = np.random.default_rng(4).permutation(np.tile(np.arange(len(record.step)), 2))
    assert find_threshold(record.rows(order)).steps == find_threshold(record).steps


def test_what_the_head_really_did_counts():
    record = ladder()
    fell_short = changed(record, "input_g", record.step == 10, 8 * ARCSEC_G)
    step = next(step for step in find_threshold(fell_short).steps if step.input_g == at(8))
    assert step.ratio == pytest.approx(10 / 8, rel=1e-6)


def test_a_head_that_did_not_move_made_no_step():
    record = ladder()
    found = find_threshold(changed(record, "input_g", record.step == 1, 0.0))
    assert [step.input_g for step in by_size(found)] == [at(2), at(5), at(10), at(20), at(50)]


def test_a_missing_step_is_left_out_and_a_missing_reference_bridged():
    record = ladder(soft_dead_band(15e-6), drift_g=5e-6)
    holes = changed(record, "output_g", [1, 20], np.nan)  # the first of three of +1″, and a reference
    found = find_threshold(holes)
    assert by_size(found)[0].repeats == 2
    assert found.left_out == 3  # and the reference before the first, which has no step next to it
    assert [step.ratio for step in found.steps] == pytest.approx(
        [step.ratio for step in find_threshold(record).steps], abs=1e-8
    )


def test_a_step_without_a_reference_on_both_sides_is_left_out():
    record = ladder()
    number = np.arange(len(record.step))
    first = find_threshold(record.rows(number > 0))
    assert (by_size(first)[0].repeats, first.left_out) == (2, 1)
    last = find_threshold(record.rows(number < len(number) - 1))
    assert (by_size(last, -1)[-1].repeats, last.left_out) == (2, 1)


@pytest.mark.parametrize("rows", [slice(0, 0), slice(0, 1), slice(1, 2)], ids=["nothing", "reference", "step"])
def test_without_a_step_nothing_is_known(rows):
    record = ladder()
    found = find_threshold(record.rows(np.arange(len(record.step))[rows]))
    assert (found.steps, found.relation, found.low_g, found.flags) == ((), "more_than", 0.0, ())
    assert np.isnan([found.threshold_g, found.u_noise_g, found.excess]).all()


# Flags


def test_one_sense_alone_is_flagged():
    found = find_threshold(ladder(soft_dead_band(15e-6), senses=(1,), sizes=(5, 10, 20)))
    assert (found.threshold_g, found.flags) == (at(10), ("one_sense",))


def test_a_step_that_passes_below_one_that_fails_does_not_count():
    def response(input_g):
        return np.where(np.isclose(input_g, 5 * ARCSEC_G), input_g, soft_dead_band(40e-6)(input_g))

    found = find_threshold(ladder(response, sizes=(5, 10, 20, 50)))
    assert (found.low_g, found.threshold_g) == (at(10), at(20))
    assert found.flags == ("not_monotonic",)


def test_a_step_is_too_short_unless_one_count_is_below_a_fifth_of_it():
    assert not any(step.too_short for step in find_threshold(ladder()).steps)  # 0.5 µg of 4.85 µg is a tenth
    coarse = replace(ladder(), count_g=np.full(73, 2e-6))  # of 9.7 µg it is more than a fifth, of 24 µg less
    found = find_threshold(coarse)
    assert [step.too_short for step in by_size(found)] == [True, True, False, False, False, False]
    assert found.flags == ("too_short",)


def test_one_short_reading_at_the_reference_makes_its_steps_too_short():
    record = ladder()
    found = find_threshold(changed(record, "count_g", 2, 1e-5))
    assert [step.too_short for step in by_size(found)] == [True] + [False] * 5


def test_a_ratio_near_one_half_is_marginal_if_it_decides():
    near = find_threshold(
        ladder(lambda input_g: 0.49 * input_g, sizes=(1, 2))
    )  # u of the ratio is about 0.03 and 0.015
    assert [step.marginal for step in by_size(near)] == [True, True]
    assert "marginal" in near.flags
    decided = find_threshold(ladder(lambda input_g: np.where(np.abs(input_g) > 7e-6, 1.0, 0.49) * input_g))
    assert [step.marginal for step in by_size(decided)] == [True] + [False] * 5
    assert "marginal" in decided.flags
    beneath = find_threshold(
        ladder(lambda input_g: np.where(np.abs(input_g) < 7e-6, 0.49, 0.3) * input_g, sizes=(1, 2))
    )
    assert "marginal" not in beneath.flags


# Uncertainty


def noisy(rng, sd_g, repeats):
    sizes = (2.0, 5.0)
    return ladder(sizes=sizes, repeats=repeats, noise=sd_g * rng.standard_normal(1 + 4 * len(sizes) * repeats))


@pytest.mark.parametrize("repeats", [1, 3])
def test_the_uncertainty_of_a_ratio_is_that_of_repeated_ladders(repeats):
    rng = np.random.default_rng(20_240_607)
    ratios = [[step.ratio for step in find_threshold(noisy(rng, 2e-7, repeats)).steps] for _ in range(400)]
    expected = [step.u_ratio for step in find_threshold(noisy(rng, 0.0, repeats)).steps]
    assert np.std(ratios, axis=0) == pytest.approx(expected, rel=0.1)


def test_repeats_that_scatter_more_than_told_raise_the_uncertainty():
    rng = np.random.default_rng(5)
    found = find_threshold(noisy(rng, 1e-6, 12))  # told are 0.2 µg
    reported = find_threshold(noisy(rng, 2e-7, 12))
    assert found.excess == pytest.approx(5.0, rel=0.25)
    assert found.dof == 44
    assert found.steps[0].u_ratio == pytest.approx(
        found.excess * reported.steps[0].u_ratio / max(reported.excess, 1), rel=1e-2
    )


def test_the_scatter_expected_knows_that_neighbours_share_a_reading():
    rng = np.random.default_rng(6)
    squares = [find_threshold(noisy(rng, 2e-7, 3)).excess ** 2 for _ in range(400)]
    assert np.mean(squares) == pytest.approx(1.0, abs=0.05)


def test_what_noise_does_to_the_threshold_is_twice_what_it_does_to_the_output():
    found = find_threshold(ladder(soft_dead_band(15e-6)))
    u_output_g = max(step.u_output_g for step in found.steps if step.size_g in (found.low_g, found.high_g))
    assert found.u_noise_g == pytest.approx(2 * u_output_g)


def test_a_step_is_marginal_by_its_expanded_uncertainty():
    step = find_threshold(ladder()).steps[0]
    near = replace(step, ratio=0.5 + 2.5 * 0.01, u_ratio=0.01)
    assert not replace(near, dof=None).marginal
    assert replace(near, dof=4).marginal  # k = 2.87
    assert not replace(near, dof=6, ratio=0.5 + 2.6 * 0.01).marginal  # k = 2.52


def test_scatter_of_few_repeats_has_few_degrees_of_freedom():
    rng = np.random.default_rng(4)
    quiet = find_threshold(ladder(repeats=2, sizes=(5.0, 10)))
    assert {step.dof for step in quiet.steps} == {None}
    record = ladder(repeats=2, sizes=(5.0, 10))
    noisy = find_threshold(replace(record, output_g=record.output_g + 5e-6 * rng.standard_normal(len(record.step))))
    assert noisy.excess > 1
    assert {step.dof for step in noisy.steps} == {noisy.dof} == {4}
