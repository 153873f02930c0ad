"""A trial or two of each line of the scorecard; the campaigns are many of them."""

import re
import shutil
from pathlib import Path

import pytest

from campaigns.reliability.campaign import KEPT, Results, carry_on
from campaigns.reliability.clocks import HEAD, TABLE
from campaigns.reliability.kept import Result, read_kept, write_kept
from campaigns.reliability.scorecard import LINES, Line
from campaigns.reliability.table import PAGE, table, with_counts
from tests.support.runs import ROOT

QUICK = {"S1": (0, 30), "S2": (0,), "S3": (0, 1), "S4": (0,), "S6": (0, 1, 2), "S9a": (0,), "S11": (0, 1)}
TRACED = {"S9b": (0, 12), "S12": (0, 5)}
SLOW = {"S5": (1,), "S15": (0, 1, 3), "S16": (1,)}


def _trials(lines: dict[str, tuple[int, ...]]) -> list[tuple[str, int]]:
    return [(key, number) for key, numbers in lines.items() for number in numbers]


@pytest.mark.slow
@pytest.mark.parametrize(("key", "number"), _trials(QUICK | SLOW))
def test_a_trial_of_a_line(key: str, number: int) -> None:
    assert LINES[key].trial(number) == ""


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("strace") is None, reason="strace alters the system calls of a process")
@pytest.mark.parametrize(("key", "number"), _trials(TRACED))
def test_a_trial_of_a_line_with_system_calls_that_fail(key: str, number: int) -> None:
    assert LINES[key].trial(number) == ""


def test_every_line_names_a_function() -> None:
    for line in LINES.values():
        module, _, name = line.plays.partition(":")
        assert f"def {name}(number: int) -> str:" in (ROOT / "campaigns" / "reliability" / f"{module}.py").read_text(
            "utf-8"
        )


@pytest.mark.leaves("the resource tracker of multiprocessing, which ends with this process")
def test_a_campaign_goes_on_where_it_was_stopped(tmp_path: Path) -> None:
    path, lines = tmp_path / "results.jsonl", [LINES["S3"]._replace(bar=2)]
    carry_on(lines, Results(path, None), 60.0, 1, failed=False)
    assert [result.trial for result in Results(path, None).of(lines[0])] == [0, 1]
    carry_on([lines[0]._replace(bar=3)], Results(path, None), 60.0, 1, failed=False)
    assert [result.trial for result in Results(path, None).of(lines[0])] == [0, 1, 2]


def test_the_last_result_of_a_trial_counts(tmp_path: Path) -> None:
    line, path = Line("S0", "a claim", 10, "nights:night", of=5), tmp_path / "results.jsonl"
    results = Results(path, None)
    for wrong, day in (("lost a row", "2026-01-01"), ("", "2026-01-02")):
        results.add(Result("S0", 3, wrong, 1.0, f"{day}T00:00:00+00:00", "abc"))
        assert bool(results.failed(line)) == bool(wrong)
    assert "5 of 50" in table([line], Results(path, None))
    assert len(path.read_text("utf-8").splitlines()) == 2


def test_results_are_kept_by_runs_of_trials(tmp_path: Path) -> None:
    results = [
        Result("S1", trial, "left on" if trial == 2 else "", 0.0, "2026-01-01", "abc" if trial < 5 else "def")
        for trial in range(7)
    ]
    path = tmp_path / "kept.tsv"
    write_kept(path, results)
    assert list(read_kept(path)) == results
    assert len(path.read_text("utf-8").splitlines()) == 1 + 4


def test_the_page_has_the_counts_that_are_kept(tmp_path: Path) -> None:
    page = PAGE.read_text("utf-8")
    assert with_counts(page, Results(tmp_path / "none.jsonl", KEPT)) == page


def test_the_runs_with_a_clock_that_is_set_have_every_type_of_step() -> None:
    names = re.findall(r"^## (\w+)$", (ROOT / "docs/reference/steps.md").read_text("utf-8"), re.MULTILINE)
    assert len(names) > 20
    assert [name for name in names if f"- {name}:" not in HEAD + TABLE] == ["custom"]  # which a plug-in brings
