"""A folder of tests that costs more than its budget fails the run that it is in."""

import re

from tests.support.budget import BUDGETS, MARGIN, TESTS, above, folder_of, pace_of


def test_every_budget_is_of_a_folder():
    named = [name for part in BUDGETS.values() for name in part]
    assert [name for name in named if not (TESTS / name).is_dir()] == []
    assert set(BUDGETS) == {"not-slow", "slow"}


def test_a_test_belongs_to_the_innermost_folder_of_the_table():
    assert folder_of("tests/unit/store/test_store.py::test_a", "not-slow") == "unit/store"
    assert folder_of("tests/truth/cases/test_m1_cases.py::test_a[x::y]", "slow") == "truth"
    assert folder_of("tests/nowhere/test_a.py::test_a", "slow") is None


def test_a_folder_above_its_budget_is_named_and_one_within_the_margin_is_not():
    budgets = BUDGETS["not-slow"]
    tests = {f"tests/{name}/test_a.py::test": budget_s for name, budget_s in budgets.items()}
    tests["tests/wire/test_a.py::test"] = budgets["wire"] * MARGIN
    assert above({"not-slow": tests}) == []
    (line,) = above({"not-slow": {**tests, "tests/wire/test_more.py::test": 1.0}})
    assert line.startswith("tests/wire (not-slow) took 9 s of processor time of 4 s: make its tests cheaper")


def test_on_a_slow_machine_a_folder_is_compared_with_the_others():
    slow = {f"tests/{name}/test_a.py::test": 2.5 * budget_s for name, budget_s in BUDGETS["not-slow"].items()}
    assert (pace_of({"not-slow": slow}), above({"not-slow": slow})) == (2.5, [])
    (line,) = above({"not-slow": {**slow, "tests/wire/test_more.py::test": 3 * BUDGETS["not-slow"]["wire"]}})
    assert line.startswith("tests/wire (not-slow)")


def test_a_folder_alone_is_not_judged_because_the_machine_may_be_slow():
    alone = {"tests/wire/test_a.py::test": 10 * BUDGETS["not-slow"]["wire"]}
    assert (pace_of({"not-slow": alone}), above({"not-slow": alone})) == (None, [])


def test_a_test_in_no_folder_of_the_table_is_named():
    (line,) = above({"slow": {"tests/nowhere/test_a.py::test": 0.1}})
    assert line.startswith("tests/nowhere/test_a.py::test is in no folder of [slow]")


def test_slow_tests_are_only_where_make_slow_looks_for_them():
    slow = [path for path in TESTS.rglob("test_*.py") if re.search(r"mark\.slow\b", path.read_text("utf-8"))]
    assert len(slow) > 20
    assert [path for path in slow if folder_of(f"tests/{path.relative_to(TESTS)}::test", "slow") is None] == []
