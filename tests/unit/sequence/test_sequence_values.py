"""Values as documents write them: quantities, lists, ranges, expressions; and how they are spelled."""

from __future__ import annotations

import math
import sys

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bench.sequence.language.expressions import ValueProblem
from bench.sequence.language.values import LIST_LIMIT, as_written, holds_expression, in_words, spelled, value_of
from drivers.quantity.quantities import Quantity, parse

NAMES = {"t": parse("20 °C"), "n": parse("3"), "angles": (parse("0°"), parse("90°"))}
WHOLE = "an expression is the whole value, like ${a + b}"


def refusal(raw: object) -> str:
    with pytest.raises(ValueProblem) as caught:
        value_of(raw, NAMES)
    return str(caught.value)


def ends(first: object, last: object, step: object = None) -> dict[str, object]:
    return {"from": first, "to": last} if step is None else {"from": first, "to": last, "step": step}


# Values and lists


@pytest.mark.parametrize(
    ("raw", "words"),
    [
        ("2.5 µg", "2.5 µg"),
        ("3  h ", "3 h"),
        ("1 h 30 min", "1 h 30 min"),
        ("54°44'08\"", "54°44'08\""),
        (["10 µA", "1 mA"], "10 µA, 1 mA"),
        (ends("0°", "90°", "45°"), "0 °, 45 °, 90 °"),
        ("${t * 2}", "40 °C"),
        (True, "true"),
    ],
)
def test_a_person_reads_a_value_as_it_was_written_and_a_computed_one_in_its_customary_unit(raw, words):
    assert as_written(value_of(raw, NAMES)) == words


def test_how_a_quantity_was_written_is_no_part_of_its_value():
    assert parse("0.5 h") == parse("30 min")
    assert len({parse("0.5 h"), parse("30 min")}) == 1


@pytest.mark.parametrize(
    ("raw", "words"),
    [
        (20, "20"),
        ("20 °C", "20 °C"),
        ("fast", "fast"),
        (True, "true"),
        ("${t}", "20 °C"),
        ("${t + '5 °C'}", "25 °C"),
        ("${angles}", "0 °, 90 °"),
        ("$t", "$t"),
        ("$ {t}", "$ {t}"),
    ],
)
def test_a_value_is_a_quantity_a_truth_text_or_what_its_expression_is_worth(raw, words):
    assert in_words(value_of(raw, NAMES)) == words


@pytest.mark.parametrize(
    ("raw", "words"),
    [
        ([], ""),
        ([[]], ""),
        ([1, [2, [3]]], "1, 2, 3"),
        (["${angles}", "180°"], "0 °, 90 °, 180 °"),
        ([ends("0°", "90°", "30°"), "5°"], "0 °, 30 °, 60 °, 90 °, 5 °"),
        (["a", 1, False], "a, 1, false"),
    ],
)
def test_lists_and_ranges_in_a_list_are_flattened(raw, words):
    assert in_words(value_of(raw, NAMES)) == words


@pytest.mark.parametrize("raw", ["x${t}", "${t}x", "${t} ${t}", "${t", "${{t}}", " ${t}", "{${t}"])
def test_an_expression_is_the_whole_value(raw):
    assert refusal(raw) == f"'{raw}': {WHOLE}"


def test_only_text_with_its_sign_holds_an_expression():
    assert holds_expression("a ${t}")
    assert not holds_expression("$t")
    assert not holds_expression(["${t}"])


@pytest.mark.parametrize(
    ("raw", "problem"),
    [
        (None, "is empty, expected a value"),
        ([1, None], "is empty, expected a value"),
        ([1, {}], "a range needs 'from'"),
        ("${m}", "'${m}': there is no name 'm'; expected t, n or angles"),
        ([0] * (LIST_LIMIT + 1), "a list of more than 10000 values"),
        ([ends(1, LIST_LIMIT), 1], "a list of more than 10000 values"),
    ],
)
def test_what_is_no_value_is_refused(raw, problem):
    assert refusal(raw) == problem


# Ranges


@pytest.mark.parametrize(
    ("raw", "words"),
    [
        (ends("20 °C", "70 °C", "10 °C"), "20 °C, 30 °C, 40 °C, 50 °C, 60 °C, 70 °C"),
        (ends("20 °C", "-10 °C", "10 °C"), "20 °C, 10 °C, 0 °C, -10 °C"),
        (ends(1, 3), "1, 2, 3"),
        (ends(3, 1), "3, 2, 1"),
        (ends(1, "${n}"), "1, 2, 3"),
        (ends("${t}", "${t + '2 °C'}", "1 °C"), "20 °C, 21 °C, 22 °C"),
        (ends(1, 1), "1"),
        (ends("5 V", "5 V", "1 V"), "5 V"),
        (ends("0 s", "1 h", "30 min"), "0 s, 1800 s, 3600 s"),
        (ends(0, "30 %", "10 %"), "0, 0.1, 0.2, 0.3"),
        (ends("0°", "1°", "30 arcmin"), "0 °, 0.5 °, 1 °"),
        (ends("1 W·s²", "2 W·s²", "0.5 W·s²"), "1 m^2·kg/s, 1.5 m^2·kg/s, 2 m^2·kg/s"),
        (ends("0 V", "4e-9 V", "2e-9 V"), "0 V, 2e-09 V, 4e-09 V"),
    ],
)
def test_a_range_includes_both_its_ends_up_or_down(raw, words):
    assert in_words(value_of(raw, NAMES)) == words


def test_the_values_of_a_range_are_the_decimals_that_a_person_would_write():
    tenths = [parse(f"0.{index} s") for index in range(10)] + [parse("1 s")]
    assert list(value_of(ends("0 s", "1 s", "0.1 s"))) == tenths
    assert list(value_of(ends("1 s", "0 s", "100 ms"))) == tenths[::-1]
    assert spelled(value_of(ends(0, 1, 0.1))) == "0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1"


def test_a_range_in_radians_meets_its_end_within_a_billionth_of_a_step():
    assert len(value_of(ends("0 rad", "1 rad", "0.1 rad"))) == 11


def test_a_range_has_up_to_ten_thousand_values():
    assert len(value_of(ends(1, LIST_LIMIT))) == LIST_LIMIT


def per_decade(start, end, count) -> dict[str, object]:
    return {"from": start, "to": end, "per_decade": count}


@pytest.mark.parametrize(
    ("raw", "words"),
    [
        (per_decade("1 Hz", "100 Hz", 3), "1 Hz, 2.154 Hz, 4.642 Hz, 10 Hz, 21.54 Hz, 46.42 Hz, 100 Hz"),
        (per_decade("100 Hz", "10 Hz", 2), "100 Hz, 31.62 Hz, 10 Hz"),
        (
            per_decade("1 arcsec", "8 arcsec", 3),
            "0.000277777777778 °, 0.0005556 °, 0.001111 °, 0.00222222222222 °",
        ),
        (per_decade(-1, -10, 2), "-1, -3.162, -10"),
        (per_decade("10.37 Hz", "120.37 Hz", 4), "10.37 Hz, 16.93 Hz, 27.65 Hz, 45.15 Hz, 73.72 Hz, 120.37 Hz"),
        (per_decade("1 mV", "1000 uV", 3), "0.001 V"),
        (per_decade("1 Hz", "2 Hz", 1), "1 Hz, 2 Hz"),
        (per_decade(1, "${n}", "${n}"), "1, 1.732, 3"),
        (per_decade(1e-200, 1e-199, 1), "1e-200, 1e-199"),
    ],
)
def test_a_geometric_range_has_a_constant_ratio_and_both_its_ends(raw, words):
    assert in_words(value_of(raw, NAMES)) == words


def test_no_two_values_of_the_closest_geometric_range_are_equal():
    values = [each.base_value for each in value_of(per_decade(1, 100, 1000))]
    assert values == sorted(set(values))
    assert len(values) == 2001


@pytest.mark.parametrize(
    ("raw", "problem"),
    [
        ({}, "a range needs 'from'"),
        ({"to": 1}, "a range needs 'from'"),
        ({"from": 1}, "a range needs 'to'"),
        ({"from": 1, "to": 3, "stp": 1}, "unknown key 'stp' in a range; did you mean 'step'?"),
        ({"from": 1, "till": 3}, "unknown key 'till' in a range; expected from, to, step or per_decade"),
        (ends("0°", "90°"), "a range from 0 ° needs a 'step'"),
        (ends("0°", "90 °C", "30°"), "'to' of a range is 90 °C, 'from' is 0 °"),
        (ends("0°", "90°", 30), "'step' of a range is 30, 'from' is 0 °"),
        (ends(0, 10, 0), "the step of a range is above 0; the direction follows from its ends"),
        (ends(10, 0, -1), "the step of a range is above 0; the direction follows from its ends"),
        (ends("fast", 3), "'from' of a range is 'fast', expected a quantity"),
        (ends(1, [2, 3]), "'to' of a range is '2, 3', expected a quantity"),
        (ends(1, 3, True), "'step' of a range is 'true', expected a quantity"),
        (ends(None, 3), "is empty, expected a value"),
        (ends("0°", "100°", "30°"), "a range from 0 ° in steps of 30 ° does not meet its end, 100 °"),
        (ends(0, 0.5), "a range from 0 in steps of 1 does not meet its end, 0.5"),
        (ends(1, LIST_LIMIT + 1), "a range of more than 10000 values"),
        (ends(0, 1e300), "a range of more than 10000 values"),
        (ends(0, 5, 1e-300), "a range of more than 10000 values"),
        ({**per_decade(1, 10, 3), "step": 1}, "a range has 'step' or 'per_decade', not both"),
        (per_decade("1 Hz", "10 s", 3), "'to' of a range is 10 s, 'from' is 1 Hz"),
        (per_decade("1 Hz", "10 Hz", "3 Hz"), "'per_decade' of a range is 3 Hz, expected a number up to 1000"),
        (per_decade("10 °C", "100 °C", 3), "temperatures have no ratio; use a range with 'step'"),
        (per_decade(0, 10, 3), "a range with 'per_decade' is from 0 to 10, expected ends of one sign and other than 0"),
        (per_decade(-1, 1, 3), "a range with 'per_decade' is from -1 to 1, expected ends of one sign and other than 0"),
        (per_decade(1, 10, 0), "'per_decade' of a range is 0, expected a number up to 1000"),
        (per_decade(1, 10, 1001), "'per_decade' of a range is 1001, expected a number up to 1000"),
        (per_decade(1e-200, 1e200, 1000), "a range of more than 10000 values"),
    ],
)
def test_a_range_that_does_not_fit_together_is_refused(raw, problem):
    assert refusal(raw) == problem


@settings(max_examples=200, deadline=None)
@given(st.integers(-500, 500), st.integers(0, 60), st.integers(1, 50), st.booleans(), st.sampled_from(["°C", "s", ""]))
def test_a_range_of_equal_steps_meets_its_end(first, count, step, rising, unit):
    last = first + (step if rising else -step) * count
    found = value_of({
        "from": f"{first / 10} {unit}", "to": f"{last / 10} {unit}", "step": f"{step / 10} {unit}",
    })  # fmt: skip
    assert [value.to(unit) for value in found] == [
        (first + (step if rising else -step) * index) / 10 for index in range(count + 1)
    ]


NUMBERS = st.floats(allow_nan=True) | st.integers(-(10**6), 10**6) | st.sampled_from(["1 s", "5°", "-3 °C", "x", None])


@settings(max_examples=200, deadline=None)
@given(NUMBERS, NUMBERS, NUMBERS)
@example(0.0, sys.float_info.max, sys.float_info.max)
def test_any_range_is_at_most_ten_thousand_finite_values_or_a_refusal(first, last, step):
    try:
        found = value_of(ends(first, last, step))
    except ValueProblem:
        return
    assert 0 < len(found) <= LIST_LIMIT
    assert all(math.isfinite(value.base_value) for value in found)


# Spelling


@pytest.mark.parametrize(
    ("value", "short", "words"),
    [
        (parse("20 °C"), "20", "20 °C"),
        (parse("-0.5°"), "-0.5", "-0.5 °"),
        (parse("90 min"), "5400", "5400 s"),
        (Quantity(3.0), "3", "3"),
        (True, "true", "true"),
        (False, "false", "false"),
        ("fast", "fast", "fast"),
        ((parse("0°"), "fast", True), "0, fast, true", "0 °, fast, true"),
    ],
)
def test_a_value_is_spelled_short_for_an_id_and_with_its_unit_for_a_person(value, short, words):
    assert (spelled(value), in_words(value)) == (short, words)


@pytest.mark.parametrize("raw", ["–20 °C", "—20 °C", "1h30", "00:30:00"])
def test_text_that_begins_like_a_number_is_never_taken_for_a_word(raw):
    assert "is not a quantity; " in refusal(raw)
