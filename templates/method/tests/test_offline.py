"""Recorded cases."""

import json

import pytest
from bench.offline.case import reduced_case

SETTINGS, RECORDS = {"fewest": 5}, {"rest": "rest.csv"}
CASE = {"schema": "itb-case/1", "method": "toy_rest", "settings": SETTINGS, "records": RECORDS}


def reduced(folder, rows):
    (folder / "rest.csv").write_text("t_s,output\n" + "".join(f"{t},{y}\n" for t, y in rows))
    (folder / "case.json").write_text(json.dumps(CASE))
    return reduced_case(folder / "case.json")


def test_a_case_is_reduced_as_a_run_is(tmp_path):
    found = reduced(tmp_path, [(360 * hour, 100 + hour + 0.1 * (-1) ** hour) for hour in range(-4, 5)])
    assert found.content["mean"] == pytest.approx(100.0, abs=0.02)
    assert found.content["drift_per_h"] == pytest.approx(0.1, abs=2 * found.content["drift_u_per_h"])
    assert (found.content["flags"], found.outcome) == ([], "REDUCED")


@pytest.mark.parametrize(
    ("rows", "flag"),
    [
        ([(0, 1), (1, 1), (2, 1), (3, 1)], "toy_rest_too_few_readings"),
        ([(t * 1e7, 1 + t % 2) for t in range(9)], "implausible_time"),
        ([(-t, 1 + t % 2) for t in range(9)], "implausible_time"),
    ],
)
def test_a_doubtful_case_is_incomplete(tmp_path, rows, flag):
    found = reduced(tmp_path, rows)
    assert (found.content["flags"], found.outcome) == ([flag], "INCOMPLETE")
