import json

import pytest

from tests.support.m2_cases import Unit, records, write_case


def test_a_unit_over_temperature_is_reduced_to_result_json(tmp_path, bench_here):
    made = records(Unit())
    made.apply = [{"channel": "acc_z", "T_C": 30.0, "raw_pps": 11_470.65}]
    done = bench_here("reduce", write_case(tmp_path, made), "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "out" / "result.json").read_text("utf-8"))
    assert (result["method"], result["sub"], len(result["table"])) == (
        "M2",
        "",
        11,
    )  # the nominal temperature is visited twice
    assert result["apply"][0]["value"] == pytest.approx(1)  # zero 18.65 and scale factor 11452 at 30 °C
    assert result["apply"][0]["comp_pps"] == pytest.approx(11_468)


def test_a_case_without_its_positions_is_refused_in_words(tmp_path, bench_here):
    made = records(Unit(), [25])
    made.positions = None
    refused = bench_here("reduce", write_case(tmp_path, made), "--out", tmp_path / "out")
    assert refused.returncode == 2
    assert "case.json: records: 'positions' is missing; M2 needs it" in refused.stderr
    assert not (tmp_path / "out" / "result.json").exists()
