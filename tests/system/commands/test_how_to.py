"""The sequences in the how-to pages, run on the shipped benches."""

import pytest

from tests.support.how_to import examples
from tests.support.runs import read_json, run_short

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("example", examples(), ids=str)
def test_a_sequence_in_a_page_runs_to_its_end_and_fails_nothing(example, tmp_path):
    answers = example.write_answers(tmp_path) if example.has_questions else None
    result = run_short(tmp_path / "runs", bench=example.bench, sequence=str(example.write(tmp_path)), answers=answers)
    assert (result.outcome.how, result.problems) == ("completed", [])
    assert result.results.verdict == ("PASS" if "limits:" in example.yaml else "NOT JUDGED")


def test_a_unit_beyond_a_limit_of_a_page_fails_and_the_run_goes_on(tmp_path):
    (example,) = (example for example in examples() if "title: Incoming check" in example.yaml)
    path = example.write(tmp_path)
    path.write_text(example.yaml.replace("target: 11300 pulse/s", "target: 13000 pulse/s"), "utf-8")
    result = run_short(tmp_path / "runs", sequence=str(path))
    assert (result.outcome.how, result.results.verdict) == ("completed", "FAIL")
    found = {found["name"]: found["verdict"] for found in read_json(result, "results.json")["measurements"]}
    assert found == {"supply_current": "PASS", "up": "FAIL", "down": None}
