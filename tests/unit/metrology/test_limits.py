"""Limits as a document writes them, as numbers in the unit of a result, and the decision by them."""

from __future__ import annotations

import json
import math

import pytest
from jsonschema import Draft202012Validator
from pydantic import ValidationError

from bench.figures.words import bands_in_words, limits_in_words
from bench.methods.tumble.method import TEMPERATURE_TUMBLE
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import Finding, Subject, UnitResult
from bench.metrology.results.limits import Judgement, Limits, judge
from bench.reduce.evaluate import Results
from bench.report.tables import over_run_rows, verdict_rows
from bench.report.terminal import results_text
from bench.sequence.document.schema import sequence_schema
from bench.sequence.steps.limits import LimitEntry, limits_in, unit_problems
from drivers.quantity.quantities import Quantity, parse
from drivers.schema.fields import DEFERRED

PASS, FAIL, INVALID = "PASS", "FAIL", "INVALID"


# The decision


@pytest.mark.parametrize(
    ("value", "verdict"),
    [(-5.0, PASS), (5.0, PASS), (0.0, PASS), (5.0 + 1e-15 * 5, FAIL), (-5.000001, FAIL), (math.nan, FAIL)],
)
def test_a_value_at_its_limit_is_inside(value, verdict):
    assert judge(value, 0.1, Limits(low=-5, high=5)).verdict == verdict


@pytest.mark.parametrize(
    ("limits", "inside", "outside"),
    [(Limits(high=5), -1e9, 5.1), (Limits(low=5), 1e9, 4.9), (Limits(low=5, high=5), 5, 5.1)],
)
def test_a_side_that_is_not_given_is_open(limits, inside, outside):
    assert judge(inside, 0.0, limits).verdict == PASS
    assert judge(outside, 0.0, limits).verdict == FAIL


def test_without_limits_everything_is_inside():
    assert judge(3.0, 0.1, Limits()) == Judgement(PASS, marginal=False)


@pytest.mark.parametrize("u", [0.0, 1.0, 1000.0, None])
def test_without_a_guard_band_the_uncertainty_changes_no_verdict(u):
    assert judge(4.9, u, Limits(low=-5, high=5)).verdict == PASS
    assert judge(5.1, u, Limits(low=-5, high=5)).verdict == FAIL


# Limits of 10 to 20, u = 0.5, guard 2: accepted from 11 to 19.
@pytest.mark.parametrize(
    ("value", "verdict", "flag"),
    [
        (9.9, FAIL, None),
        (10.0, FAIL, "guard_band"),
        (10.99, FAIL, "guard_band"),
        (11.0, PASS, None),
        (15.0, PASS, None),
        (19.0, PASS, None),
        (19.01, FAIL, "guard_band"),
        (20.0, FAIL, "guard_band"),
        (20.1, FAIL, None),
    ],
)
def test_within_the_guard_band_a_value_is_not_accepted(value, verdict, flag):
    judgement = judge(value, 0.5, Limits(low=10, high=20, guard_k=2))
    assert (judgement.verdict, judgement.flag) == (verdict, flag)


def test_one_limit_has_one_guard_band():
    assert judge(19.5, 0.5, Limits(high=20, guard_k=1)).verdict == PASS
    assert judge(19.6, 0.5, Limits(high=20, guard_k=1)).flag == "guard_band"
    assert judge(-1e6, 1e5, Limits(high=20, guard_k=2)).verdict == PASS
    assert judge(10.4, 0.5, Limits(low=10, guard_k=1)).flag == "guard_band"


def test_where_the_guard_bands_meet_the_bench_is_not_good_enough():
    limits = Limits(low=10, high=20, guard_k=2)
    assert judge(15.0, 2.5, limits) == (PASS, False, None)  # the one value that is left
    assert judge(14.0, 2.5, limits) == (FAIL, True, "guard_band")
    assert judge(15.0, 2.6, limits) == (INVALID, True, "guard_bands_meet")
    assert judge(20.1, 2.6, limits) == (FAIL, True, None)  # outside whatever the uncertainty


def test_a_guard_band_without_an_uncertainty_has_no_width():
    limits = Limits(low=10, high=20, guard_k=2)
    assert judge(15.0, None, limits) == (INVALID, False, "u_unknown")
    assert judge(9.0, None, limits) == (FAIL, False, None)


@pytest.mark.parametrize(
    ("value", "u", "width", "marginal"),
    [
        (19.01, 0.5, None, True),  # 2 u is 1
        (19.0, 0.5, None, False),
        (20.99, 0.5, None, True),
        (21.0, 0.5, None, False),
        (10.99, 0.5, None, True),
        (19.6, 0.5, 0.5, True),
        (19.5, 0.5, 0.5, False),
        (20.4, 0.5, 0.5, True),
        (19.6, None, 0.5, True),
        (20.0, None, None, False),
        (20.0, 0.5, 0.0, False),
    ],
)
def test_a_value_is_marginal_on_both_sides_of_a_limit(value, u, width, marginal):
    assert judge(value, u, Limits(low=10, high=20, marginal=width)).marginal == marginal


@pytest.mark.parametrize(
    ("limits", "u", "judgement"),
    [
        (Limits(u_max=0.2), 0.2, (PASS, False, None)),
        (Limits(u_max=0.2), 0.21, (INVALID, False, "u_too_large")),
        (Limits(u_max=0.2), None, (INVALID, False, "u_unknown")),
        (Limits(u_max_relative=0.02), 0.2, (PASS, False, None)),
        (Limits(u_max_relative=0.02), 0.21, (INVALID, False, "u_too_large")),
        (Limits(low=5, high=20, u_max=0.2), 0.1, (PASS, False, None)),
        (Limits(low=5, high=20, u_max=0.2), 0.3, (INVALID, False, "u_too_large")),
        (Limits(low=11, u_max=0.2), 0.3, (FAIL, False, "u_too_large")),
        (Limits(low=11, u_max=0.2), 0.1, (FAIL, False, None)),
        (Limits(low=9.5, guard_k=2, u_max=0.2), 0.3, (INVALID, True, "u_too_large")),
        (Limits(low=9.5, guard_k=3, u_max=0.2), 0.2, (FAIL, False, "guard_band")),
    ],
)
@pytest.mark.parametrize("sign", [1, -1])
def test_a_value_whose_uncertainty_is_above_its_limit_is_never_accepted(limits, u, judgement, sign):
    if sign < 0:  # the mirror image has the same verdict
        turned = {"low": limits.high, "high": limits.low}
        limits = limits._replace(**{side: None if value is None else -value for side, value in turned.items()})
    assert judge(sign * 10.0, u, limits) == judgement


# Findings


def test_an_uncertainty_above_its_limit_leaves_the_unit_undecided_and_is_in_the_results():
    limits = limits_in(entry(u_max="20 ppm"), "pulse/s/g")
    one, other = (finding(-1e4, u, "K1", "pulse/s/g").judged(limits) for u in (0.2, 0.3))
    assert (one.verdict, one.flags, other.verdict, other.flags) == (PASS, (), INVALID, ("u_too_large",))
    unit = UnitResult("a", "QF-1", (one, other), (), (), ())
    assert unit.verdict == "INCOMPLETE"
    content = Results("T", "INCOMPLETE", (unit,)).to_json()["findings"]
    assert [(each["u_max"], each["limits"]) for each in content] == [(pytest.approx(0.2), None)] * 2
    (row,) = verdict_rows(unit, {"K1": limits}, {"K1": "pulse/s/g"})
    assert row.bands == "u at most 20 ppm of the value"
    assert row.remark.startswith("its standard uncertainty is above the limit u_max")


def test_a_finding_without_a_budget_does_not_keep_a_limit_of_its_uncertainty():
    judged = finding(0.0, u=0.0).judged(Limits(u_max=1e-3))
    assert (judged.verdict, judged.flags) == (INVALID, ("u_unknown",))


def test_the_worst_of_several_is_the_one_whose_uncertainty_is_closest_to_its_limit():
    limits = Limits(u_max=1e-3)
    found = tuple(finding(value, u).judged(limits) for value, u in ((1.0, 1e-4), (2.0, 9e-4), (3.0, 1e-5)))
    (row,) = verdict_rows(UnitResult("a", "QF-1", found, (), (), ()), {"K0": limits}, {"K0": "g"})
    assert row.value.startswith("2000000")


def finding(value, u=1e-4, quantity="K0", unit="g", **more):
    budget = (BudgetLine("s", "B", u),) if u else ()
    return Finding(f"x/a/{quantity}", "QF-1", quantity, "bias", {}, value, unit, budget, (), **more)


def test_a_finding_has_the_verdict_its_reason_and_keeps_its_own_flags():
    judged = finding(4.9e-3, flags=("contains:K3",)).judged(Limits(high=5e-3, guard_k=2))
    assert (judged.verdict, judged.marginal) == (FAIL, True)
    assert judged.flags == ("contains:K3", "guard_band")


def test_an_uncertainty_is_summed_exactly_so_that_it_is_the_same_on_every_python_in_any_order():
    lines = tuple(BudgetLine(str(index), "A", u, 10) for index, u in enumerate((1.0, *[1e-8] * 200)))
    one, other = (Finding("x/a/K0", "QF-1", "K0", "bias", {}, 0.0, "g", budget, ()) for budget in (lines, lines[::-1]))
    assert (one.u, one.dof) == (other.u, other.dof)
    assert one.u == math.sqrt(1 + 200 * 1e-16)


def test_a_finding_that_is_invalid_stays_so():
    judged = finding(0.0, verdict="INVALID").judged(Limits(high=5e-3, guard_k=2))
    assert (judged.verdict, judged.flags, judged.limits) == (INVALID, (), Limits(high=5e-3, guard_k=2))


def test_a_finding_without_a_budget_has_no_uncertainty_for_a_guard_band():
    assert finding(0.0, u=0.0).judged(Limits(high=5e-3, guard_k=2)).flags == ("u_unknown",)


@pytest.mark.parametrize("unknown", [math.inf, math.nan])
@pytest.mark.parametrize("first", [True, False])
def test_a_finding_is_invalid_where_a_part_of_its_uncertainty_is_not_known(unknown, first):
    lines = [BudgetLine("sensor", "A", unknown), BudgetLine("time base", "B", 0.01)]
    found = Subject("s", "a", "QF-1").finding("gain", "", 1.0, "1", lines if first else lines[::-1], {}, ())
    assert ([line.source for line in found.budget], found.flags) == (["time base"], ("u_unknown",))
    assert found.judged(Limits(0.9, 1.1)).verdict == INVALID


def test_a_finding_without_limits_is_never_marginal():
    assert not finding(0.0).marginal


# Documents


def entry(**keys):
    return LimitEntry.model_validate(keys)


@pytest.mark.parametrize(
    ("keys", "unit", "limits"),
    [
        ({"min": "-5 mg", "max": "5 mg"}, "g", Limits(-0.005, 0.005)),
        ({"max": "200 µg"}, "g", Limits(None, 2e-4)),
        ({"min": "-150 ppm/°C"}, "1/°C", Limits(-1.5e-4, None)),
        ({"target": "1.13 mA/g", "tolerance": "0.01 mA/g"}, "mA/g", Limits(1.12, 1.14, 1.13)),
        ({"target": "1.13 mA/g", "relative": "0.5 %"}, "A/g", Limits(1.12435e-3, 1.13565e-3, 1.13e-3)),
        ({"target": "-2 mg", "relative": 0.25}, "mg", Limits(-2.5, -1.5, -2)),
        ({"target": "0 mg", "tolerance": "5 mg"}, "g", Limits(-0.005, 0.005, 0)),
        ({"target": 1, "tolerance": "100 ppm"}, "1", Limits(0.9999, 1.0001, 1)),
        ({"max": "5 mg", "guard": 1.64, "marginal": "50 µg"}, "g", Limits(None, 5e-3, None, 1.64, 5e-5)),
        ({"max": "${2 * '5 mg'}", "guard": "${1 + 1}"}, "g", Limits(None, 0.01, None, 2)),
        ({"u_max": "20 ppm"}, "pulse/s/g", Limits(u_max_relative=2e-5)),
        ({"u_max": "20 ppm"}, "1", Limits(u_max=2e-5)),
        ({"u_max": "20 µg", "max": "5 mg"}, "g", Limits(None, 5e-3, u_max=2e-5)),
        ({"u_max": "0.1 mrad"}, "rad", Limits(u_max=1e-4)),
    ],
)
def test_limits_are_numbers_in_the_unit_of_the_result(keys, unit, limits):
    ready = {key: Quantity(2.0) if value == "${1 + 1}" else value for key, value in keys.items()}
    assert limits_in(entry(**ready), unit) == limits


def test_in_a_loop_limits_may_wait_for_the_value_of_an_expression():
    raw = {"target": "${set_point}", "tolerance": "${band}", "guard": "${k}", "marginal": "${2 * band}"}
    LimitEntry.model_validate(raw, context=DEFERRED)
    ready = {"target": parse("20 °C"), "tolerance": parse("1 °C"), "guard": Quantity(2.0), "marginal": parse("2 °C")}
    assert limits_in(entry(**ready), "°C") == Limits(19, 21, 20, 2, 2)
    with pytest.raises(ValidationError, match="there is no name 'set_point'"):
        entry(**raw)


@pytest.mark.parametrize(
    "raw",
    [
        {"target": "${set_point}"},
        {"target": "${set_point}", "tolerance": "0 °C"},
        {"target": "${set_point}", "max": "1 °C"},
        {"max": "${set_point}", "marginal": "-1 °C"},
        {"max": "${set_point}", "u_max": "0 °C"},
        {"target": "1e308 °C", "tolerance": "1e308 °C"},
        {"target": "-1e200 °C", "relative": "1e200"},
    ],
)
def test_what_is_wrong_whatever_the_expression_is_told_at_once(raw):
    with pytest.raises(ValidationError):
        LimitEntry.model_validate(raw, context=DEFERRED)


def test_every_key_in_another_unit_is_told():
    wrong = entry(target="5 V", tolerance="1 V", marginal="2 °C")
    assert list(unit_problems(wrong, "°C")) == [
        ("target", "target: is in V, expected a quantity in °C"),
        ("tolerance", "tolerance: is in V, expected a quantity in °C"),
    ]
    assert list(unit_problems(entry(min="1 mg", marginal="1 µg", guard=2), "g")) == []
    assert list(unit_problems(entry(u_max="1 V"), "g")) == [
        ("u_max", "u_max: is in V, expected a quantity in g, or a ratio, such as 20 ppm")
    ]
    later = LimitEntry.model_validate({"min": "${bias}", "max": "1 V"}, context=DEFERRED)
    assert [key for key, _ in unit_problems(later, "g")] == ["max"]


@pytest.mark.parametrize(
    ("keys", "good"),
    [
        ({"min": "1 g"}, True),
        ({"min": "1 g", "max": "2 g", "guard": 2, "marginal": "1 mg"}, True),
        ({"target": "1 g", "tolerance": "1 mg"}, True),
        ({"target": "1 g", "relative": 0.1}, True),
        ({"target": "1 g"}, False),
        ({"guard": 2}, False),
        ({}, False),
        ({"min": "1 g", "target": "1 g"}, False),
        ({"min": "1 g", "tolerance": "1 g"}, False),
        ({"max": "1 g", "target": "1 g", "tolerance": "1 mg"}, False),
        ({"target": "1 g", "tolerance": "1 mg", "relative": 0.1}, False),
        ({"u_max": "1 mg"}, True),
        ({"u_max": "1 mg", "min": "1 g", "guard": 2}, True),
        ({"u_max": "1 mg", "target": "1 g", "relative": 0.1}, True),
        ({"u_max": "1 mg", "guard": 2}, False),
        ({"u_max": "1 mg", "marginal": "1 mg"}, False),
        ({"u_max": "1 mg", "target": "1 g"}, False),
    ],
)
def test_the_schema_takes_the_keys_that_the_loader_takes(keys, good):
    schema = sequence_schema()
    schema = {"$ref": "#/$defs/LimitEntry", "$defs": schema["$defs"]}
    assert Draft202012Validator(schema).is_valid(keys) == good
    if good:
        entry(**keys)
    else:
        with pytest.raises(ValidationError):
            entry(**keys)


# Reports


@pytest.mark.parametrize(
    ("quantity", "limits", "words", "bands"),
    [
        ("K2", Limits(), "", ""),
        ("K0", Limits(low=1e-6), "at least 1", ""),
        ("K0", Limits(high=2e-4, guard_k=2), "at most 200", "guard band 2 u"),
        ("K0", Limits(-5e-3, 5e-3, marginal=5e-5), "-5000 to 5000", "marginal within 50"),
        ("K1", Limits(11243.5, 11356.5, 11300, 1.64, 10), "11300 ± 56.5", "guard band 1.64 u, marginal within 10"),
        ("K1", Limits(11296.737, 11296.739, 11296.738), "11296.738 ± 0.001", ""),
        ("K0", Limits(high=2e-4, guard_k=2, u_max=1e-5), "at most 200", "guard band 2 u, u at most 10"),
    ],
)
def test_limits_are_told_as_they_are_declared_in_the_unit_of_the_value(quantity, limits, words, bands):
    unit = TEMPERATURE_TUMBLE.stated[quantity]
    assert limits_in_words(quantity, unit, limits) == words
    assert bands_in_words(quantity, unit, limits) == bands


@pytest.mark.parametrize(
    ("value", "u", "remark"),
    [
        (0.0, 1e-5, ""),
        (4.9e-3, 1e-4, "inside its limits, but within their guard band"),
        (0.0, 4e-3, "its uncertainty is so large that no value could pass the guard band"),
        (0.0, 0.0, "its uncertainty is not known, and its limits need it"),
    ],
)
def test_why_a_value_was_not_accepted_stands_beside_it(value, u, remark):
    limits = Limits(-5e-3, 5e-3, guard_k=2)
    unit = UnitResult("a", "QF-1", (finding(value, u).judged(limits),), (), (), ())
    (row,) = verdict_rows(unit, {"K0": limits}, {"K0": "g"})
    assert (row.limits, row.bands, row.remark) == ("-5000 to 5000", "guard band 2 u", remark)
    (row,) = over_run_rows(unit)
    assert (row.bands, row.remark) == ("guard band 2 u", remark)
    (line,) = [line for line in results_text(Results("T", "PASS", (unit,))).splitlines() if " K0 " in line]
    assert line.split(row.verdict)[1].removeprefix(" marginal").strip() == "; ".join(
        filter(None, ("-5000 to 5000", "guard band 2 u", remark))
    )


def test_a_unit_whose_value_could_not_be_decided_is_incomplete():
    limits = Limits(-5e-3, 5e-3, guard_k=2)
    unit = UnitResult("a", "QF-1", (finding(0.0, 4e-3).judged(limits),), (), (), ())
    assert unit.verdict == "INCOMPLETE"


def test_results_hold_both_limits_of_a_target_and_the_guard_band():
    limits = Limits(11243.5, 11356.5, 11300, guard_k=2)
    findings = (finding(11250.0, 10.0, "K1", "pulse/s/g").judged(limits), finding(0.0))
    content = Results("T", "FAIL", (UnitResult("a", "QF-1", findings, (), (), ()),)).to_json()
    judged, other = json.loads(json.dumps(content))["findings"]
    assert judged["limits"] == {"min": 11243.5, "max": 11356.5}
    assert (judged["guard"], judged["verdict"], judged["marginal"]) == (2, FAIL, True)
    assert judged["flags"] == ["guard_band"]
    assert (other["limits"], other["guard"], other["verdict"], other["marginal"]) == (None, None, None, False)
