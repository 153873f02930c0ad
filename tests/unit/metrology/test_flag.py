"""Flags: their form in results, and that equal ones are one."""

import pytest

from bench.metrology.results.flag import Flag, samples_left_out


@pytest.mark.parametrize(
    ("flag", "text"),
    [
        (Flag("not_closed"), "not_closed"),
        (Flag("dead_band", at="steps/acquire#3"), "steps/acquire#3: dead_band"),
        (Flag("too_few_temperatures", of="K0"), "K0:too_few_temperatures"),
        (Flag("{frequency} Hz droop", values={"frequency": "0.5"}), "0.5 Hz droop"),
        (samples_left_out("outlier", 3), "3 samples: outlier"),
        (samples_left_out("outlier", 3, "up_1g"), "up_1g: 3 samples: outlier"),
        (Flag("a sentence with {braces}"), "a sentence with {braces}"),
    ],
)
def test_a_flag_has_one_form_in_results(flag, text):
    assert str(flag) == text


def test_equal_flags_are_one():
    again = [samples_left_out("outlier", count, "a") for count in (3, 3, 4)]
    assert list(dict.fromkeys(again)) == again[1:]
