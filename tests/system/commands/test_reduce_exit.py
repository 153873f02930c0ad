import json

import pytest

from bench.cli import exits
from tests.support.any_case import good_case


def limit(case):
    case.settings["k_m"] = 1e-9


def one_row(case):
    case.first_rows(1)


def radians(case):
    case["enc_deg"] = lambda values: values * 0.017453


def misspelt(case):
    case.settings["km"] = case.settings.pop("k_m")


@pytest.mark.parametrize(
    ("damage", "code", "message"),
    [
        (lambda case: None, exits.PASS, ""),
        (limit, exits.FAIL, ""),
        (one_row, exits.OF_VERDICT["INCOMPLETE"], "case.json: INCOMPLETE: bias invalid, run1 invalid, "),
        (radians, exits.OF_VERDICT["INCOMPLETE"], "case.json: INCOMPLETE: invalid, implausible_angle"),
        (misspelt, exits.INPUT_ERROR, "settings.km: unknown key; did you mean 'k_m'?"),
    ],
)
def test_the_exit_code_says_what_became_of_a_case(tmp_path, bench_here, damage, code, message):
    case = good_case("M3", "gyro_range")
    damage(case)
    done = bench_here("reduce", case.write(tmp_path), "--out", tmp_path / "out")
    assert done.returncode == code, done.stderr
    assert message in done.stderr
    if code != exits.INPUT_ERROR:
        passed = json.loads((tmp_path / "out" / "result.json").read_text("utf-8"))["passed"]
        assert passed == {exits.PASS: True, exits.FAIL: False}.get(code)
