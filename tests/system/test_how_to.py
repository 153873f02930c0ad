"""The sequences in the how-to pages, run on the shipped benches."""

import pytest

from tests.support.how_to import examples
from tests.support.runs import run_short


@pytest.mark.parametrize("example", examples(), ids=str)
def test_a_sequence_in_a_page_runs_to_its_end_and_passes(example, tmp_path):
    answers = example.write_answers(tmp_path) if example.has_questions else None
    result = run_short(tmp_path / "runs", bench=example.bench, sequence=str(example.write(tmp_path)), answers=answers)
    assert (result.outcome.how, result.problems) == ("completed", [])
    assert result.results.verdict == "PASS"
