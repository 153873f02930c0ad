"""Outcomes of several rehearsals: exit code, text, JSON and JUnit; their processes, and what these are started with."""

from __future__ import annotations

import io
import itertools
import json
from contextlib import redirect_stdout
from pathlib import Path

import pytest

from bench.app.check_files import FileCheck
from bench.cli.exits import MEANINGS, WORST_FIRST, worst
from bench.cli.rehearsals import Children, Outcome, as_words, show
from bench.cli.rehearsing import OF_A_REHEARSAL
from tests.support.commands import invoked
from tests.support.junit import cases

PASSED = Outcome("s.yaml", "b.yaml", 0, "PASS", "completed", 60.0, 61.0, 1.5, run="runs/one", report="runs/one/r.html")
FAILED = PASSED._replace(file="t.yaml", exit_code=1, verdict="FAIL")
UNSAFE = PASSED._replace(file="u.yaml", exit_code=6, verdict="ERROR", problems=["head: silent"], unsafe=["head"])


def shown(form: str, *outcomes: Outcome) -> tuple[int, str]:
    with redirect_stdout(io.StringIO()) as out:
        code = show(outcomes, form)
    return code, out.getvalue()


def test_the_worst_exit_code_is_that_of_all():
    assert sorted(WORST_FIRST) == sorted(MEANINGS)
    for bad, better in itertools.pairwise(WORST_FIRST):
        assert worst([better, bad, better]) == bad
    assert worst([]) == 0


def test_text_has_a_line_for_each_and_a_count():
    code, text = shown("text", PASSED, UNSAFE)
    assert code == 6
    assert text.splitlines() == [
        "s.yaml on b.yaml: PASS, 61 s in 1.5 s, runs/one",
        "u.yaml on b.yaml: NOT MADE SAFE, 61 s in 1.5 s, runs/one",
        "  head: silent",
        "  not made safe: head",
        "2 rehearsals: 1 PASS, 1 NOT MADE SAFE",
    ]


def test_json_can_be_read_back():
    code, text = shown("json", PASSED, FAILED)
    content = json.loads(text)
    assert (code, content["exit_code"]) == (1, 1)
    assert Outcome(**content["rehearsals"][1]) == FAILED._replace(problems=[], unsafe=[], lost=[])


def test_junit_tells_a_unit_that_fails_from_a_rehearsal_that_failed():
    code, text = shown("junit", PASSED, FAILED, UNSAFE)
    assert code == 6
    found = cases(text)
    passed, failed, unsafe = (found[f"{each.file} on b.yaml"] for each in (PASSED, FAILED, UNSAFE))
    assert [child.tag for child in passed] == ["system-out"]
    assert next((child.tag, child.get("type")) for child in failed) == ("failure", "FAIL")
    assert next((child.tag, child.get("type")) for child in unsafe) == ("error", "NOT MADE SAFE")
    assert unsafe[0].text == "head: silent\nnot made safe: head"


def test_a_process_has_the_options_of_all_and_nothing_that_was_not_given():
    wishes = {
        "preset": None,
        "settings": ("a=1", "b=2"),
        "seed": 0,
        "faults": None,
        "runs": Path("r"),
        "parameters": None,
    }
    assert list(as_words(OF_A_REHEARSAL, wishes)) == ["--set=a=1", "--set=b=2", "--seed=0", "--runs=r"]


def test_a_process_that_ends_without_an_outcome_is_an_error_with_what_it_wrote():
    (outcome,) = Children(("--no-such-option",)).outcomes(
        [FileCheck(Path("s.yaml"), "sequence", (), "simulated", 3)], 1
    )
    assert (outcome.exit_code, outcome.verdict) == (3, None)
    assert "there is no option --no-such-option" in outcome.problems[0]


@pytest.mark.parametrize("form", ["json", "junit", "text"])
def test_sequences_with_errors_are_not_begun(form, tmp_path):
    for name in ("a", "b"):
        (tmp_path / f"{name}.yaml").write_text("schema: itb-sequence/1\n", "utf-8")
    done = invoked("rehearse", str(tmp_path), "--format", form, "--runs", str(tmp_path / "runs"))
    assert done.returncode == 2
    assert done.stdout.count("the key 'title' is missing") >= 2
    assert not (tmp_path / "runs").exists()
