import json

import numpy as np

from tests.support.m0_cases import LEVELS_G, Channel, ramp_c, run_columns, write_case


def test_a_channel_case_is_reduced_to_result_json(tmp_path, bench_here):
    rng, channel = np.random.default_rng(3), Channel(zero_pps=0.0)
    time_s, converter_c = ramp_c(interval_s=60)
    runs = {
        name: run_columns(rng, channel, level_g, time_s=time_s, converter_c=converter_c)
        for name, level_g in LEVELS_G.items()
    }
    done = bench_here("reduce", write_case(tmp_path, runs), "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    result = json.loads((tmp_path / "out" / "result.json").read_text("utf-8"))
    assert (result["method"], result["sub"], result["flags"]) == ("M0", "", [])
    assert {name: found["decision"] for name, found in result["deviation"].items()} == {
        "skew": "share", "src_1g": "share", "src_12g": "share",
    }  # fmt: skip
    assert abs(result["channel"]["tempco_scale_per_C"] - 1e-5) < 4 * result["channel"]["u_tempco_scale_per_C"]
