import json
import os

import numpy as np
import pytest

from bench.errors import InputError
from bench.offline import csv_record as table
from bench.offline.case import reduce_case, reductions
from bench.offline.csv_record import read_table
from tests.support.any_case import good_case
from tests.support.m4_cases import static_columns, write_case

TILT = {"K1_V_per_g": 1.13, "B0_V": 3.2e-4, "B1_V_per_C": 1.4e-5, "K0_nominal_V": 5e-4}
TUMBLE_HEADER = "cycle,leg,dwell,T_set_C,T_meas_C,pos_deg,rep,U_V,valid"
RAMP_HEADER = "cycle,leg,t_s,T_C,U_V"


def case(folder, *, csv="T_C,U_V\n20,0.1\n", sub="tilt", record="tilt", settings=TILT, **replaced):
    (folder / "data.csv").write_bytes(csv.encode() if isinstance(csv, str) else csv)
    content = {
        "schema": "itb-case/1",
        "method": "M4",
        "sub": sub,
        "site": {"lat_deg": 34.25, "h_m": 420},
        "settings": settings,
        "records": {record: "data.csv"},
    }
    path = folder / "case.json"
    path.write_text(json.dumps(content | replaced))
    return path


def refusal(path):
    with pytest.raises(InputError) as caught:
        reduce_case(path)
    return str(caught.value)


def test_result_has_the_keys_of_the_static_method(tmp_path):
    columns, _ = static_columns(np.random.default_rng(1), bias_v=[1e-4, 1e-5], scale_v_per_g=[1.13])
    result = reduce_case(write_case(tmp_path, "static", {"degree": 2}, columns))
    assert list(result) == ["method", "sub", "points", "K0", "K1", "flags", "notes", "rejected"]
    assert list(result["points"][0]) == [
        "T_C", "T_set_C", "leg", "cycle", "dwell", "K0_V", "K1_V_per_g", "K2_V_per_g2", "delta_rad",
    ]  # fmt: skip
    for key in ("K0", "K1"):
        assert list(result[key]) == [
            "poly", "linear", "u_linear", "max_resid", "max_resid_linear", "hysteresis_max", "hysteresis_at_C",
        ]  # fmt: skip
    assert json.loads(json.dumps(result, allow_nan=False)) == result


def test_result_has_the_keys_of_the_dynamic_method(tmp_path):
    rows = [f"1,{leg},{i + 100 * n},{20 + i * s},{1e-5 * i}" for n, (leg, s) in enumerate(LEGS) for i in range(50)]
    path = case(tmp_path, sub="dynamic", record="ramp", csv="\n".join([RAMP_HEADER, *rows]), settings={"K1_V_per_g": 1})
    result = reduce_case(path)
    assert list(result) == [
        "method", "sub", "B0_V", "B1_V_per_C", "max_resid_ug", "rms_resid_ug", "hysteresis_max_ug",
        "repeatability_max_ug", "jumps", "lag_model", "verdict", "flags", "notes", "rejected",
    ]  # fmt: skip
    assert list(result["lag_model"]) == ["B0_V", "B1_V_per_C", "Bd_V_s_per_C", "max_resid_ug"]
    assert json.loads(json.dumps(result, allow_nan=False)) == result


LEGS = [("up", 1), ("down", -1)]


def test_result_has_the_keys_of_the_tilt_method(tmp_path):
    result = reduce_case(case(tmp_path))
    assert list(result) == [
        "method", "sub", "raw_span_deg", "comp_span_deg", "raw_mean_deg", "comp_mean_deg", "flags", "notes", "rejected",
    ]  # fmt: skip


def test_a_thermometer_that_is_open_spoils_no_tilt(tmp_path):
    whole = reduce_case(case(tmp_path, csv="T_C,U_V\n20,0.1\n30,0.12\n"))
    broken = reduce_case(case(tmp_path, csv="T_C,U_V\n20,0.1\n-273,0.11\n30,0.12\n850,0.1\n"))
    assert broken["rejected"]["thermometer"] == 2
    assert {**broken, "rejected": {}} == {**whole, "rejected": {}}


def test_what_lies_beyond_a_right_angle_is_among_the_notes(tmp_path):
    result = reduce_case(case(tmp_path, csv="T_C,U_V\n20,0.1\n30,0.1\n20,7\n"))
    assert (result["flags"], result["notes"]) == ([], ["samples beyond ±90° are left out"])
    assert result["rejected"]["out_of_range"] == 1


def test_what_cannot_be_known_is_null(tmp_path):
    rows = [
        f"1,up,{i},{t},{t},{p},1,{np.sin(np.radians(p))},1" for i, t in enumerate((20, 40)) for p in range(0, 360, 90)
    ]
    path = case(tmp_path, sub="static", record="tumble", csv="\n".join([TUMBLE_HEADER, *rows]), settings={"degree": 1})
    result = reduce_case(path)
    assert result["flags"] == []
    assert result["K0"]["u_linear"] == [None, None]  # two dwells leave no degree of freedom
    assert (result["K0"]["hysteresis_max"], result["K0"]["hysteresis_at_C"]) == (None, None)


def test_no_complete_dwell_leaves_nothing_but_flags(tmp_path):
    rows = ["1,up,4,20,20,0,1,0.1,1", "1,up,4,20,20,90,1,1.1,0", "1,up,4,20,20,180,1,0.1,1", ",,,,,,,,"]
    path = case(tmp_path, sub="static", record="tumble", csv="\n".join([TUMBLE_HEADER, *rows]), settings={"degree": 4})
    result = reduce_case(path)
    assert result["points"] == []
    assert result["flags"] == [
        "dwell 4 incomplete: 90", "dwell 4 incomplete: 270", "K0:too_few_temperatures", "K1:too_few_temperatures",
    ]  # fmt: skip
    assert result["K1"]["poly"] == []
    assert result["K1"]["linear"] is None
    assert result["rejected"] == {"missing": 1, "invalid": 1, "thermometer": 0, "duplicate": 0}


def test_a_record_without_a_usable_row(tmp_path):
    path = case(tmp_path, sub="static", record="tumble", csv=TUMBLE_HEADER, settings={})
    assert reduce_case(path)["flags"] == ["K0:too_few_temperatures", "K1:too_few_temperatures"]
    path = case(tmp_path, sub="dynamic", record="ramp", csv=RAMP_HEADER + "\n1,up,,,\n", settings={"K1_V_per_g": 1})
    assert reduce_case(path) == {
        "method": "M4", "sub": "dynamic", "B0_V": None, "B1_V_per_C": None, "max_resid_ug": None, "rms_resid_ug": None,
        "hysteresis_max_ug": None, "repeatability_max_ug": None, "jumps": [], "lag_model": None, "verdict": None,
        "flags": ["invalid"],
        "notes": ["the record is insufficient: power 0 and power 1 are not determined by these readings "
                  "(rank 0 of 2, condition number inf)"],
        "rejected": {"missing": 1, "duplicate": 0, "thermometer": 0, "turn": 0},
    }  # fmt: skip


@pytest.mark.parametrize(
    ("rows", "verdict", "flags"),
    [(5, None, ["ill_conditioned", "invalid"]), (16, "incomplete", ["ill_conditioned"])],
)
def test_a_ramp_too_short_for_a_jump_is_not_judged(tmp_path, rows, verdict, flags):
    csv = "\n".join([RAMP_HEADER, *(f"1,up,{10 * i},{20 + i / 2},{1e-5 * i}" for i in range(rows))])
    path = case(tmp_path, sub="dynamic", record="ramp", csv=csv, settings={"K1_V_per_g": 1, "resid_limit_ug": 1})
    result = reduce_case(path)
    assert result["B1_V_per_C"] == pytest.approx(2e-5)
    assert (result["verdict"], result["flags"]) == (verdict, flags)


@pytest.mark.parametrize(
    ("legs", "limits", "verdict", "notes"),
    [
        ("1u 1d", {"resid_limit_ug": 300}, "pass", []),
        ("1u 1d", {"resid_limit_ug": 1}, "fail", []),
        ("1u 1d", {"repeat_limit_ug": 1e9}, "incomplete", ["not known: repeatability: no temperature was passed "]),
        ("1u 1d 2u 2d", {"repeat_limit_ug": 1e9}, "pass", []),
        ("1u", {}, "incomplete", ["not known: hysteresis: no temperature was passed rising and falling in one cycle"]),
        ("1u 2u", {"resid_limit_ug": 1}, "fail", ["not known: hysteresis: no temperature was passed rising and "]),
        ("1u 2d", {"resid_limit_ug": 300}, "incomplete", ["not known: hysteresis: no temperature was passed rising "]),
    ],
)
def test_a_ramp_passes_only_when_everything_that_is_judged_is_known(tmp_path, legs, limits, verdict, notes):
    rows = [
        f"{leg[0]},{'up' if leg[1] == 'u' else 'down'},{200 * n + i},{20 + (i if leg[1] == 'u' else 50 - i)},"
        f"{1e-5 * (i if leg[1] == 'u' else 50 - i) + 1e-5 * (i % 2)}"
        for n, leg in enumerate(legs.split()) for i in range(50)
    ]  # fmt: skip
    csv = "\n".join([RAMP_HEADER, *rows])
    path = case(tmp_path, sub="dynamic", record="ramp", csv=csv, settings={"K1_V_per_g": 1, **limits})
    result = reduce_case(path)
    assert result["verdict"] == verdict
    assert [found.startswith(note) for found, note in zip(result["notes"], notes, strict=True)] == [True] * len(notes)


def test_a_setting_that_is_null_is_as_if_not_given(tmp_path):
    rows = [f"1,{leg},{i + 100 * n},{20 + i * s},{1e-5 * i}" for n, (leg, s) in enumerate(LEGS) for i in range(50)]
    csv = "\n".join([RAMP_HEADER, *rows])
    bare, nulls = (
        reduce_case(case(tmp_path, sub="dynamic", record="ramp", csv=csv, settings={"K1_V_per_g": 1} | more))
        for more in ({}, {"jump_window": None, "jump_threshold_ug": None, "resid_limit_ug": None})
    )
    assert nulls == bare
    path = case(
        tmp_path,
        sub="dynamic",
        csv=csv,
        settings={"K1_V_per_g": None},
        site=None,
        records={"ramp": "data.csv", "clock": None},
    )
    assert refusal(path) == "case.json: settings.K1_V_per_g: is missing"


def test_a_dwell_with_most_readings_missing_is_invalid(tmp_path):
    rows = [
        f"1,up,{d},{20 * d},{20 * d},{p},{r},{np.sin(np.radians(p))},{int(d != 1 or r == 1)}"
        for d in (0, 1, 2) for p in range(0, 360, 90) for r in (1, 2, 3)
    ]  # fmt: skip
    path = case(tmp_path, sub="static", record="tumble", csv="\n".join([TUMBLE_HEADER, *rows]), settings={"degree": 1})
    result = reduce_case(path)
    assert result["flags"] == ["dwell 1 invalid"]
    assert [point["dwell"] for point in result["points"]] == [0, 2]


def test_a_broken_thermometer_spoils_its_reading_only(tmp_path):
    rows = [
        f"1,up,0,20,{850 if (p, r) == (90, 2) else 20.5},{p},{r},{np.sin(np.radians(p))},1"
        for p in (0, 90, 180, 270) for r in (1, 2)
    ]  # fmt: skip
    path = case(tmp_path, sub="static", record="tumble", csv="\n".join([TUMBLE_HEADER, *rows]), settings={"degree": 1})
    result = reduce_case(path)
    assert result["points"][0]["T_C"] == 20.5
    assert result["rejected"]["thermometer"] == 1


def test_positions_are_named_as_the_record_names_them(tmp_path):
    def rows(angles):
        return [f"1,up,{d},{d},{d},{a},1,{np.sin(np.radians(a))},1" for d, angle in enumerate(angles) for a in angle]

    full = (1, 91, 181, 271)
    path = case(
        tmp_path, sub="static", record="tumble", settings={"degree": 1},
        csv="\n".join([TUMBLE_HEADER, *rows([full, full, (1, 91, 271)])]),
    )  # fmt: skip
    assert reduce_case(path)["flags"] == ["dwell 2 incomplete: 181"]
    near = [(359.99, 90.02, 180.01, 269.97), (0.01, 90.0, 180.02), (0.02, 89.99, 180.0, 270.01)]
    path = case(
        tmp_path, sub="static", record="tumble", settings={"degree": 1}, csv="\n".join([TUMBLE_HEADER, *rows(near)])
    )  # fmt: skip
    result = reduce_case(path)
    assert result["flags"] == ["dwell 1 incomplete: 270"]
    assert result["points"][0]["K1_V_per_g"] == pytest.approx(1, rel=1e-12)


@pytest.mark.parametrize(
    "encode",
    [
        lambda t: "\ufeff" + t,
        lambda t: t.replace("\n", "\r\n"),
        lambda t: t + "\n\n",
        lambda t: "\n , \n" + t,
        lambda t: t + "  \n",
        lambda t: t.replace("\n", "\n\t\n, ,,,\n", 1),
    ],
)
def test_bom_crlf_and_empty_lines_are_read(tmp_path, encode):
    expected = reduce_case(case(tmp_path))
    assert (
        reduce_case(case(tmp_path, csv=encode('T_C, "extra", U_V \n20,"a,b",0.1\n'.replace(', "', ',"')))) == expected
    )


@pytest.mark.parametrize(
    ("csv", "message"),
    [
        ("T_C,U_V\n20,0.1\n21,abc\n", "data.csv: line 3, column U_V: 'abc' is not a number; "),
        ("T_C,U_V\r\n\r\n20,1_0\r\n", "data.csv: line 3, column U_V: '1_0' is not a number; "),
        ("T_C,U_V\n20,0.1\n ,,\n  \n21,abc\n", "data.csv: line 5, column U_V: 'abc' is not a number; "),
        ("T_C,U_V\n20,0.1\n  \n20,0.1,7\n", "data.csv: line 4: 3 cells, but the header has 2"),
        ("T_C,U_V\n20,0.1,7\n", "data.csv: line 2: 3 cells, but the header has 2"),
        ("T_C,U_V\n20\n", "data.csv: line 2: 1 cells, but the header has 2"),
        ('T_C,U_V\n20,"0.1\n', "data.csv: line 2: unexpected end of data"),
        ("T_C,Uv\n20,0.1\n", "data.csv: line 1: there is no column 'U_V'"),
        ("T_C,U_V,T_C\n20,0.1,1\n", "data.csv: line 1: there is more than one column 'T_C'"),
        ("", "data.csv: is empty; expected a line with the names of the columns, T_C, U_V, and the rows below it"),
        ("T_C;U_V\n20;0,1\n", "data.csv: line 1: the cells are separated by semicolons; save the file with commas"),
        ("T_C\tU_V\n20\t0.1\n", "data.csv: line 1: the cells are separated by tabs; save the file with commas"),
        ('T_C,U_V\n20,"0,1"\n', "data.csv: line 2, column U_V: '0,1' is not a number; write 0.1"),
        (b"T_C,U_V\n20,0.1\n2\xb0,0.1\n", "data.csv: line 3: not UTF-8; save the file in that encoding"),
    ],
)
def test_a_bad_table_is_refused_where_it_is_bad(tmp_path, csv, message):
    assert refusal(case(tmp_path, csv=csv)).startswith(message)


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1.5,up,0,20,20,0,1,0.1,1", "line 2, column cycle: '1.5' is not a whole number"),
        ("1,sideways,0,20,20,0,1,0.1,1", "line 2, column leg: 'sideways' is not up or down"),
        ("1,up,0,20,20,0,1,0.1,maybe", "line 2, column valid: 'maybe' is not 1, 0, true or false"),
    ],
)
def test_a_bad_cell_of_a_tumble_is_refused(tmp_path, row, message):
    path = case(tmp_path, sub="static", record="tumble", csv=f"{TUMBLE_HEADER}\n{row}\n", settings={})
    assert refusal(path).startswith(f"data.csv: {message}; correct it, or leave the cell blank")


def test_words_may_be_written_large_and_truths_in_words(tmp_path):
    csv = "a,b\nUP, True\n,false\nDown,\n 1 ,\nup,1.0\nup,0.0\n"
    (tmp_path / "t.csv").write_text(csv)
    columns = read_table(tmp_path / "t.csv", ["a", "b"])
    assert columns.truths("b").tolist() == [True, False, False, False, True, False]
    assert columns.words("a", ("up", "down", "1")).tolist() == ["up", "", "down", "1", "up", "up"]


@pytest.mark.parametrize(
    ("replaced", "message"),
    [
        ({"schema": "itb-case/2"}, "case.json: schema: is 'itb-case/2', expected 'itb-case/1'"),
        ({"method": "M9"}, "case.json: there is no reduction for 'M9' 'tilt'; known: "),
        ({"records": {}}, "case.json: records: 'tilt' is missing; M4 tilt needs it"),
        ({"records": {"tilt": "none.csv"}}, "case.json: records.tilt: there is no file 'none.csv' beside this one"),
        ({"records": {"tilt": "../x.csv"}}, "case.json: records.tilt: '../x.csv' leaves the folder of this file"),
        ({"records": {"tilt": "/etc/passwd"}}, "case.json: records.tilt: '/etc/passwd' leaves the folder of this file"),
        ({"records": {"tilt": "x" * 5000}}, "case.json: records.tilt: 'xxxxx"),
        ({"settings": TILT | {"K1_V_per_g": 0}}, "case.json: settings.K1_V_per_g: is 0"),
        ({"settings": TILT | {"B0_V": "four"}}, "case.json: settings.B0_V: is 'four', expected a number"),
        ({"settings": {"K1_V_per_g": 1}}, "case.json: settings.B0_V: is missing; settings.B1_V_per_C: is missing"),
        ({"settings": TILT | {"B0_V": float("inf")}}, "case.json: settings.B0_V: is inf, expected a finite number"),
        ({"settings": TILT | {"B0_V": True}}, "case.json: settings.B0_V: is true, expected a number or a word"),
        ({"settings": TILT | {"B0_v": 1}}, "case.json: settings.B0_v: unknown key; did you mean 'B0_V'?"),
        ({"setings": {}}, "case.json: 'setings' is not known; did you mean 'settings'?"),
        ({"site": {"lat": 34}}, "case.json: site.'lat' is not known; did you mean 'lat_deg'?"),
        ({"site": {"lat_deg": 134}}, "case.json: site.lat_deg: is 134, expected at most 90"),
        ({"records": {"tilt": "data.csv", "tilts": "data.csv"}}, "case.json: records.tilts: is not known"),
    ],
)
def test_a_bad_case_is_refused(tmp_path, replaced, message):
    if "setings" in replaced:
        path = case(tmp_path)
        content = json.loads(path.read_text())
        path.write_text(json.dumps({key: value for key, value in content.items() if key != "settings"} | replaced))
    else:
        path = case(tmp_path, **replaced)
    assert refusal(path).startswith(message)


UNKNOWN_SETTINGS = [
    ("M0", "", {"outlier_K": 6}, "settings.outlier_K: unknown key; did you mean 'outlier_k'?"),
    (
        "M0",
        "",
        {"runs": {"up_1g": {"kind": "gravity", "a_G": 1}}},
        "settings.runs.up_1g.a_G: unknown key; did you mean",
    ),
    ("M1", "", {"term": ["c0"]}, "settings.term: unknown key; did you mean 'terms'?"),
    ("M1", "", {"mount": {"angle_3_rad": 0}}, "settings.mount.angle_3_rad: unknown key; did you mean 'angle3_rad'?"),
    ("M2", "", {"atitude_tol_g": 0.1}, "settings.atitude_tol_g: unknown key; did you mean 'attitude_tol_g'?"),
    ("M3", "gyro_range", {"K_m": 1e-3}, "settings.K_m: unknown key; did you mean 'k_m'?"),
    ("M3", "acc_range", {"range": 50}, "settings.range: unknown key; did you mean 'range_g'?"),
    ("M3", "gyro_freq", {"settle": 1}, "settings.settle: unknown key; did you mean 'settle_s'?"),
    ("M3", "acc_freq", {"Ts": 1e-3}, "settings.Ts: unknown key; did you mean 'Ts_s'?"),
    ("M3", "two_sample", {"h": 1e-3}, "settings.h: unknown key; expected h_s, rx_m or ry_m"),
    ("M4", "static", {"degre": 4}, "settings.degre: unknown key; did you mean 'degree'?"),
    ("M4", "dynamic", {"resid_limit_g": 300}, "settings.resid_limit_g: unknown key; did you mean 'resid_limit_ug'?"),
]


@pytest.mark.parametrize(("method", "sub", "settings", "message"), UNKNOWN_SETTINGS)
def test_an_unknown_setting_is_refused_with_the_nearest_known_one(tmp_path, method, sub, settings, message):
    records = dict.fromkeys(reductions()[method, sub].records, "data.csv")
    path = case(tmp_path, method=method, sub=sub, settings=settings, records=records)
    assert message in refusal(path)


def test_every_kind_of_case_refuses_what_it_does_not_know():
    assert {(method, sub) for method, sub, _, _ in UNKNOWN_SETTINGS} | {("M4", "tilt")} == set(reductions())


def test_what_describes_a_case_is_passed_over_and_anything_else_noted(tmp_path):
    result = reduce_case(case(tmp_path, title="a night", comment="x", site={"lat_deg": 34, "name": "hall", "room": 5}))
    assert result["notes"] == ["unknown keys were ignored: site.room"]


def test_a_record_that_the_reduction_does_not_read_is_refused(tmp_path):
    path = case(tmp_path, method="M2", sub="", settings={}, records={"positions": "data.csv", "rate": "data.csv"})
    assert refusal(path) == "case.json: records.rate: is not known; did you mean 'rates'?"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('{"schema": }', "case.json: line 1, column 12: is not JSON: Expecting value"),
        ("[" * 100_000, "case.json: nested too deeply"),
        ('{"schema": ' + "1" * 5000 + "}", "case.json: nested too deeply, or a number with too many digits"),
        ("[]", "case.json: is empty, expected a mapping"),
        ('{"method": "M4", "method": "M3"}', "case.json: the key 'method' occurs twice in one mapping"),
    ],
)
def test_a_case_that_is_no_case_is_refused(tmp_path, content, message):
    (tmp_path / "case.json").write_text(content)
    assert refusal(tmp_path / "case.json").startswith(message)


def test_a_link_out_of_the_folder_is_refused(tmp_path):
    outside = tmp_path / "outside.csv"
    outside.write_text("T_C,U_V\n20,0.1\n")
    folder = tmp_path / "case"
    folder.mkdir()
    (folder / "link.csv").symlink_to(outside)
    assert "leaves the folder" in refusal(case(folder, records={"tilt": "link.csv"}))
    (folder / "loop.csv").symlink_to("loop.csv")
    assert refusal(case(folder, records={"tilt": "loop.csv"})).startswith(
        "case.json: records.tilt: 'loop.csv' cannot be read"
    )


def test_a_record_in_a_folder_below_is_read(tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "t.csv").write_text("T_C,U_V\n20,0.1\n")
    assert reduce_case(case(tmp_path, records={"tilt": "data/t.csv"}))["rejected"]["missing"] == 0


def test_what_is_no_file_is_refused(tmp_path):
    assert refusal(tmp_path / "none.json").endswith("none.json: there is no such file")
    assert refusal(tmp_path).endswith("is a folder")
    os.mkfifo(tmp_path / "pipe.csv")
    assert "there is no file 'pipe.csv'" in refusal(case(tmp_path, records={"tilt": "pipe.csv"}))


def test_a_file_that_is_too_large_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(table, "SIZE_LIMIT_BYTES", 2**20)
    path = case(tmp_path, csv="T_C,U_V\n" + "20,0.1\n" * 160_000)
    assert refusal(path).startswith("data.csv: larger than 1 MiB")
    (tmp_path / "case.json").write_text(" " * 2**21)
    assert refusal(path).startswith("case.json: larger than 1 MiB")


@pytest.mark.parametrize(
    ("csv", "reported"),
    [
        ("\n \n", "data.csv: is empty"),
        ("20,0.1\n21,0.2\n", "line 1: has only numbers; put a line with the names of the columns above it: T_C, U_V"),
        ("t_c,u_v\n20,0.1\n", "line 1: there is no column 'T_C'; if 't_c' is meant, rename it"),
        ("a,b\n20,0.1\n", "line 1: there is no column 'T_C'; the line has a, b"),
        ("T_C,U_V\n\u221220,0.1\n", "line 2, column T_C: '\u221220' is not a number; write -20"),
        ("T_C,U_V\n\u201320.5,0.1\n", "'\u201320.5' is not a number; write -20.5"),
        ("T_C,U_V\n20,'0.1\n", "''0.1' is not a number; write 0.1"),
        ("T_C,U_V\n20,0.1 V\n", "U_V: '0.1 V' is not a number; write the number alone, 0.1, in the unit of the column"),
        ("T_C,U_V\n20 °C,0.1\n", "column T_C: '20 °C' is not a number; write the number alone, 20, in"),
        ("T_C,U_V\n20,100 µV\n", "column U_V: '100 µV' is not a number; write the number alone, 100, in"),
        ("T_C,U_V\n20,N/A\n", "U_V: 'N/A' is not a number; correct it, or leave the cell blank if it is missing"),
        ("T_C,U_V\n20,0x1F\n", "'0x1F' is not a number; correct it, or leave the cell blank"),
        ("T_C,U_V\n20,.nan\n", "column U_V: '.nan' is not a number; correct it, or leave the cell blank"),
    ],
)  # fmt: skip
def test_what_to_do_about_a_table_is_told(tmp_path, csv, reported):
    assert reported in refusal(case(tmp_path, csv=csv))


def test_an_optional_column_in_other_capitals_is_not_passed_over(tmp_path):
    made = good_case("M1")
    made.records["sweep"]["t_C"] = [20.0] * len(made.records["sweep"]["seq"])
    made.records["sweep"].pop("T_C", None)
    with pytest.raises(InputError, match=r"sweep.csv: line 1: column 't_C': write 'T_C'"):
        reduce_case(made.write(tmp_path))
