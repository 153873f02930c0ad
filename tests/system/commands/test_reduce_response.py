import json

import numpy as np

from tests.support.m3_cases import gyro_block, joined, second_order, write_case


def test_a_frequency_response_is_reduced_to_result_json(tmp_path, bench_here):
    rng = np.random.default_rng(6)
    unit = second_order(60, 0.65)
    blocks = [gyro_block(rng, f, unit, sample_hz=401.3, seconds=1.5) for f in (20.0, 40.0, 60.0, 80.0)]
    blocks[1]["gyro_dps"] = 0 * blocks[1]["gyro_dps"]  # nothing: no decibel
    path = write_case(tmp_path, "gyro_freq", {"settle_s": 0.1}, joined(blocks))
    done = bench_here("reduce", path, "--out", tmp_path / "out")
    assert (done.returncode, done.stderr) == (7, "case.json: INCOMPLETE: implausible_output\n")
    text = (tmp_path / "out" / "result.json").read_text("utf-8")
    assert "NaN" not in text
    assert "Infinity" not in text
    result = json.loads(text)
    assert (result["method"], result["sub"]) == ("M3", "gyro_freq")
    assert [point["f_Hz"] for point in result["points"]] == [20, 40, 60, 80]
    assert [point["gain_dB"] is None for point in result["points"]] == [False, True, False, False]
