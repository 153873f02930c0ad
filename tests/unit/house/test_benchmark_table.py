"""The table of benchmarks: ratios of rounds, verdicts, and its place in the README."""

from __future__ import annotations

import json

import pytest

from benchmarks.__main__ import BEGIN, END, ROOT, WORKS, with_table, works_to_measure
from benchmarks.compared import Row, Side, in_turn, table

OURS = Side("this program", "each step synced", (2.0, 4.0, 3.0))
PEER = Side("peer 1.2", "none", (20.0, 20.0, 90.0))
ROW = Row("P3", "a step", "ms", OURS, (PEER,), "bare commit: 1 ms", "≥ 5 ×", True)


def known(*rows: Row, whole: bool = False) -> dict:
    work = {"date": "2026-11-27", "whole": whole, "version": "0.3", "machine": "2 × a processor"}
    return json.loads(json.dumps({"steps": work | {"rows": [each.as_data() for each in rows]}}))


def test_sides_alternate():
    order: list[str] = []

    def measured(name: str) -> float:
        order.append(name)
        return float(len(order))

    found = in_turn({"a": lambda: measured("a"), "b": lambda: measured("b")}, rounds=2)
    assert (order, found) == (["a", "b", "a", "b"], {"a": (1.0, 3.0), "b": (2.0, 4.0)})


def test_a_ratio_is_the_median_of_those_of_the_rounds():
    assert (OURS.value, ROW.ratio(PEER)) == (3.0, 10.0)


def test_a_ratio_of_rates_is_above_one_for_the_faster_side():
    rates = Row("P3", "a step", "steps/s", PEER, (OURS,), "", "≥ 5 ×", True, lower_is_better=False)
    assert rates.ratio(OURS) == pytest.approx(10.0)


def test_sides_with_other_numbers_of_rounds_are_compared_by_their_medians():
    assert ROW.ratio(Side("slow peer", "none", (30.0,))) == 10.0


def test_a_row_has_a_line_for_each_peer_and_its_verdict_once():
    two = Row("P3", "a step", "ms", OURS, (PEER, PEER), "", "≥ 5 ×", False)
    _, _, first, second = table([two]).splitlines()
    assert first == (
        "| P3 | a step | 3 ms (each step synced) | peer 1.2: 20 ms (none) | 10 × | – | ≥ 5 ×: **not met** |"
    )
    assert second == "|  |  |  | peer 1.2: 20 ms (none) | 10 × |  |  |"


def test_a_row_without_a_peer_has_a_line_too():
    alone = Row("P3", "a step", "ms", OURS, (), "", "≤ 5 ms", True)
    assert "| – | – | – | ≤ 5 ms: met |" in table([alone])


def test_the_table_replaces_what_is_between_the_marks():
    other = Row("P10", "a report", "s", OURS, (), "", "≤ 2 s", True)
    text = with_table(f"above\n{BEGIN}\nold\n{END}\nbelow\n", known(other, ROW))
    assert text.startswith(
        f"above\n{BEGIN}\nMeasured on 2026-11-27, parts of nights, version 0.3: 2 × a processor.\n\n|"
    )
    assert text.endswith(f"|\n{END}\nbelow\n")
    assert "old" not in text
    assert text.index("| P3 |") < text.index("| P10 |")
    assert with_table(text, known(other, ROW)) == text


def test_works_that_were_measured_whole_are_named():
    whole = known(Row("P7", "memory", "MB", OURS, (), "", "flat", True), whole=True)["steps"]
    text = with_table(f"{BEGIN}\n{END}", known(ROW) | {"memory": whole | {"date": "2026-11-30"}})
    assert "Measured on 2026-11-27 to 2026-11-30, whole nights in P7, parts of nights in the others" in text
    assert ", whole nights, version" in with_table(f"{BEGIN}\n{END}", known(ROW, whole=True))


def test_a_whole_measurement_goes_on_where_it_was_stopped_and_begins_again_when_it_has_ended():
    done = {name: known(ROW, whole=True)["steps"] for name in WORKS}
    assert works_to_measure(done | {"start": known(ROW)["steps"]}, whole=True) == ["start"]
    assert works_to_measure(done, whole=True) == works_to_measure(done, whole=False) == WORKS


def test_marks_that_are_missing_are_named():
    with pytest.raises(SystemExit, match="benchmark: end"):
        with_table(f"above\n{BEGIN}\nbelow\n", known(ROW))


def test_the_readme_has_the_marks():
    assert END in (ROOT / "README.md").read_text("utf-8").partition(BEGIN)[2]
