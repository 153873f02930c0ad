"""Cases of M2 made from a known inertial unit, reduced and held against the truth."""

import json

import numpy as np
import pytest

from bench.errors import InputError
from bench.offline.case import reduce_case
from tests.support.m2_cases import DWELL_S, NOMINAL_C, SET_POINTS_C, Unit, records, write_case

FEW_C = [25, 55, 0]
AXES = "xyz"
SIGMA_COUNTS = (15.0, 6.0)  # of accelerometers and gyros in 120 s: 11 µg; 0.045 °/h
CHANNELS = [f"{sensor}_{axis}" for sensor in ("acc", "gyro") for axis in AXES]


@pytest.fixture
def rng():
    return np.random.default_rng(20_241_101)


def reduced(tmp_path, made, site=None, **settings):
    result = reduce_case(write_case(tmp_path, made, site, **settings))
    assert json.loads(json.dumps(result, allow_nan=False)) == result
    return result


def entry(result, set_c):
    return next(point for point in result["table"] if point["T_set_C"] == set_c)


def truth(unit, set_c, axis):
    """The entry of one axis in the table."""
    i = AXES.index(axis)
    acc_c, gyro_c = (set_c + warmer_c for warmer_c in unit.warmer_c)
    (zero, scale), (drift, gyro_scale) = unit.accelerometer(acc_c), unit.gyro(gyro_c)
    return {
        "Ta_C": acc_c, "Tg_C": gyro_c, "K0_pps": zero[i], "K1_pps_per_g": scale[i],
        "D0_pps": drift[i], "D0_dph": 3600 * drift[i] / gyro_scale[i], "KG_p_per_deg": gyro_scale[i],
    }  # fmt: skip


def assert_least_squares(result, unit, set_c=25, **close):
    acc_c, gyro_c = (set_c + warmer_c for warmer_c in unit.warmer_c)
    zero, scale = unit.accelerometer(acc_c)
    for i, axis in enumerate(AXES):
        found = result["ls24"][axis]
        assert found["K0_g"] == pytest.approx(zero[i] / scale[i] - unit.square_g[i], **close)
        assert found["K1_pps_per_g"] == pytest.approx(scale[i], rel=close["abs"])
        assert found["K2_g_per_g2"] == pytest.approx(unit.square_g[i], **close)
        assert found["mis"] == pytest.approx(unit.mis[i], **close)
        assert found["gyro_D0_pps"] == pytest.approx(unit.gyro(gyro_c)[0][i], abs=1e4 * close["abs"])
        assert found["gyro_gsens_pps_per_g"] == pytest.approx(unit.sensitivity[i], abs=1e4 * close["abs"])


def readings(unit, rng, count=40, low_c=-10.0, high_c=58.0):
    """Rows of `apply`, and the truth: physical values and what the unit would have said at 25 °C."""
    rows, values, nominal = [], [], []
    for name in rng.permuted(np.repeat(CHANNELS, count)).tolist():
        sensor, i = name.split("_")[0], AXES.index(name[-1])
        model = unit.accelerometer if sensor == "acc" else unit.gyro
        temperature_c, value = rng.uniform(low_c, high_c), rng.uniform(-1, 1)
        zero, scale = model(temperature_c)
        rows.append({"channel": name, "T_C": temperature_c, "raw_pps": zero[i] + scale[i] * value})
        values.append(value)
        nominal.append(model(NOMINAL_C)[0][i] + model(NOMINAL_C)[1][i] * value)
    return rows, values, nominal


def test_a_unit_without_noise_is_found_exactly(tmp_path):
    unit = Unit()
    result = reduced(tmp_path, records(unit))
    visited = [(point["T_set_C"], point["visit"]) for point in result["table"]]
    assert visited == [(set_c, 1) for set_c in (55, 45, 35, 25)] + [(25, 2)] + [
        (c, 1) for c in (15, 5, 0, -5, -10, -15)
    ]
    for point in result["table"]:
        for axis in AXES:
            assert point[axis] == pytest.approx(truth(unit, point["T_set_C"], axis), rel=1e-12, abs=1e-10)
    assert_least_squares(result, unit, abs=1e-12)
    assert result["flags"] == result["apply"] == []
    assert [note.partition(":")[0] for note in result["notes"]] == ["positions.csv", "rates.csv"]  # equal without noise
    assert max(u for point in result["u"]["table"] for axis in AXES for u in point[axis].values()) < 1e-9
    assert result["rejected"] == {"missing": 0, "duplicate": 0, "rate": 0, "thermometer": 0}
    assert [(each["T_set_C"], each["visits"]) for each in result["repeatability"]] == [(25, 2)]
    assert max(apart for axis in AXES for apart in result["repeatability"][0][axis].values()) < 1e-9
    assert result["model_check"]["acc_z"]["T_C"] == [-5, 0, 5, 10, 20, 30, 40, 50]
    assert np.abs(result["model_check"]["acc_z"]["K1_pps_per_g"]["left_out_error"]).max() < 1e-9


def test_result_has_the_keys_of_the_method(tmp_path):
    result = reduced(tmp_path, records(Unit(), FEW_C))
    assert list(result) == [
        "method", "sub", "table", "apply", "ls24", "u", "repeatability", "model_check", "flags", "notes", "rejected",
    ]  # fmt: skip
    assert list(result["table"][0]) == ["T_set_C", "visit", "x", "y", "z"]
    assert list(result["table"][0]["x"]) == [
        "Ta_C", "Tg_C", "K0_pps", "K1_pps_per_g", "D0_pps", "D0_dph", "KG_p_per_deg",
    ]  # fmt: skip
    assert list(result["ls24"]) == ["x", "y", "z"]
    assert list(result["ls24"]["y"]) == [
        "K0_g", "K1_pps_per_g", "K2_g_per_g2", "mis", "gyro_D0_pps", "gyro_gsens_pps_per_g",
    ]  # fmt: skip
    assert list(result["u"]["ls24"]["y"]) == list(result["ls24"]["y"])


def test_noise_stays_within_its_uncertainty(tmp_path, rng):
    unit = Unit()
    result = reduced(tmp_path, records(unit, rng=rng, noise_counts=SIGMA_COUNTS))
    assert result["flags"] == result["notes"] == []
    ratios = []
    for point, u in zip(result["table"], result["u"]["table"], strict=True):
        for axis in AXES:
            true = truth(unit, point["T_set_C"], axis)
            ratios += [(point[axis][key] - true[key]) / u_value for key, u_value in u[axis].items()]
    assert len(ratios) == 165
    assert np.max(np.abs(ratios)) < 4
    assert 0.85 < np.sqrt(np.mean(np.square(ratios))) < 1.15
    of_one_reading = result["u"]["table"][0]["y"]["K0_pps"] * np.sqrt(8) * DWELL_S
    assert of_one_reading == pytest.approx(SIGMA_COUNTS[0], rel=0.2)
    assert_least_squares(result, unit, abs=1.5e-5)


def test_order_of_rows_changes_nothing(tmp_path, rng):
    made = records(Unit(), SET_POINTS_C[1:], rng=rng, noise_counts=SIGMA_COUNTS)
    expected = reduced(tmp_path, made)
    rng.shuffle(made.positions)
    rng.shuffle(made.rates)
    made.positions.insert(7, dict.fromkeys(made.positions[0]))  # an empty row
    found = reduced(tmp_path, made)
    assert found["rejected"].pop("missing") == 1
    assert {**expected["rejected"], "missing": None} == {**found["rejected"], "missing": None}
    for point, other in zip(found["table"], expected["table"], strict=True):
        for axis in AXES:
            assert point[axis] == pytest.approx(other[axis], rel=1e-12)
    assert found["ls24"]["x"]["mis"] == pytest.approx(expected["ls24"]["x"]["mis"], rel=1e-9)
    assert found["flags"] == expected["flags"] == []


def test_readings_are_compensated_in_their_order(tmp_path, rng):
    unit = Unit()
    made = records(unit)
    made.apply, values, nominal = readings(unit, rng)
    result = reduced(tmp_path, made)
    assert [row["channel"] for row in result["apply"]] == [row["channel"] for row in made.apply]
    assert [row["T_C"] for row in result["apply"]] == [row["T_C"] for row in made.apply]
    assert [row["value"] for row in result["apply"]] == pytest.approx(values, abs=1e-11)
    assert [row["comp_pps"] for row in result["apply"]] == pytest.approx(nominal, rel=1e-11)
    assert not any(row["extrapolated"] for row in result["apply"])
    assert list(result["apply"][0]) == ["channel", "T_C", "value", "comp_pps", "extrapolated"]


def test_regressed_outputs_have_their_uncertainties(tmp_path, rng):
    """Of one unit with noise the outputs of a channel share the errors of its knots: fifteen units."""
    ratios = []
    for _ in range(15):
        unit = Unit()
        made = records(unit, rng=rng, noise_counts=SIGMA_COUNTS)
        made.apply, _, nominal = readings(unit, rng, count=5)
        result = reduced(tmp_path, made)
        us = result["u"]["apply"]
        assert [row["channel"] for row in us] == [row["channel"] for row in made.apply]
        found = zip(result["apply"], us, nominal, strict=True)
        ratios += [(row["comp_pps"] - true) / u["comp_pps"] for row, u, true in found]
    assert len(ratios) == 450
    assert 0.75 < np.sqrt(np.mean(np.square(ratios))) < 1.3
    assert np.max(np.abs(ratios)) < 5


@pytest.mark.parametrize("extrapolation", ["hold", "linear", "reject"])
def test_readings_outside_of_the_knots(tmp_path, rng, extrapolation):
    unit = Unit()
    made = records(unit, FEW_C)
    made.apply, values, nominal = readings(unit, rng, count=5, low_c=70, high_c=90)
    result = reduced(tmp_path, made, extrapolation=extrapolation)
    assert all(row["extrapolated"] for row in result["apply"])
    if extrapolation == "reject":
        assert [row["value"] for row in result["apply"]] == [row["comp_pps"] for row in result["apply"]] == 30 * [None]
    elif extrapolation == "linear":
        assert [row["value"] for row in result["apply"]] == pytest.approx(values, abs=1e-11)
        assert [row["comp_pps"] for row in result["apply"]] == pytest.approx(nominal, rel=1e-11)
    else:
        zero, scale = unit.accelerometer(60)  # 55 °C in the chamber
        for row, given in zip(result["apply"], made.apply, strict=True):
            if row["channel"] == "acc_y":
                assert row["value"] == pytest.approx((given["raw_pps"] - zero[1]) / scale[1], rel=1e-11)


def test_a_reading_with_something_missing_keeps_its_place(tmp_path):
    made = records(Unit(), FEW_C)
    made.apply = [
        {"channel": "acc_x", "T_C": None, "raw_pps": 1.0},
        {"channel": "gyro_z", "T_C": 20, "raw_pps": None},
        {"channel": None, "T_C": 20, "raw_pps": 1.0},
        {"channel": "acc_x", "T_C": 850, "raw_pps": 1.0},  # an open thermometer
        {"channel": "acc_x", "T_C": 20, "raw_pps": 1e308},
        {"channel": "ACC_X", "T_C": 20, "raw_pps": 35.0},
    ]
    found = reduced(tmp_path, made)["apply"]
    nothing = {"value": None, "comp_pps": None, "extrapolated": False}
    assert found[:4] == [
        {"channel": "acc_x", "T_C": None} | nothing,
        {"channel": "gyro_z", "T_C": 20} | nothing,
        {"channel": None, "T_C": 20} | nothing,
        {"channel": "acc_x", "T_C": 850} | nothing,
    ]
    assert found[4]["value"] == pytest.approx(1e308 / 11_303.3, rel=1e-9)
    assert found[5]["channel"] == "acc_x"


@pytest.mark.parametrize(
    "damage",
    [
        lambda made, row: made.positions.remove(row),
        lambda made, row: row.update(Ny=None),
        lambda made, row: row.update(Wy="nan"),
        lambda made, row: row.update(dwell_s=0),
        lambda made, row: row.update(dwell_s=-120),
        lambda made, row: row.update(dwell_s=None),
        lambda made, row: row.update(pos=None),
        lambda made, row: row.update(Ny=1e308, dwell_s=1e-9),
    ],
)
def test_a_missing_position_takes_its_axis_out_at_that_temperature(tmp_path, rng, damage):
    unit = Unit()
    made = records(unit, FEW_C)
    damage(made, made.position(55, "Ay6"))
    made.apply, values, _ = readings(unit, rng, count=2, low_c=10, high_c=29)
    result = reduced(tmp_path, made)
    assert result["flags"] == ["T=55:missing_position:Ay6"]
    assert entry(result, 55)["y"] is entry(result | result["u"], 55)["y"] is None
    for set_c, axis in ((55, "x"), (55, "z"), (25, "y"), (0, "y")):
        assert entry(result, set_c)[axis] == pytest.approx(truth(unit, set_c, axis), rel=1e-12, abs=1e-10)
    assert [row["value"] for row in result["apply"]] == pytest.approx(values, abs=1e-11)  # between 0 and 25 °C
    assert_least_squares(result, unit, abs=1e-12)


def test_least_squares_do_with_the_other_attitudes(tmp_path):
    unit = Unit()
    made = records(unit, FEW_C)
    for name in ("Ax1", "Ay6"):
        made.positions.remove(made.position(25, name))
    result = reduced(tmp_path, made)
    assert result["flags"] == ["T=25:missing_position:Ax1", "T=25:missing_position:Ay6"]
    assert entry(result, 25)["x"] is entry(result, 25)["y"] is None
    assert_least_squares(result, unit, abs=1e-11)


@pytest.mark.parametrize(
    "damage",
    [
        lambda made, row: made.rates.remove(row),
        lambda made, row: row.update(Wz=None),
        lambda made, row: row.update(rate_true_dps=None),
        lambda made, row: row.update(dwell_s=-120),
        lambda made, row: row.update(axis=None),
        lambda made, row: row.update(rate_true_dps=np.radians(row["rate_true_dps"])),  # rad/s
        lambda made, row: row.update(rate_true_dps=-3),  # turned the wrong way
    ],
)
def test_a_missing_rate_takes_its_axis_out_at_that_temperature(tmp_path, damage):
    made = records(Unit(), FEW_C)
    damage(made, made.rate(0, "z", 3))
    result = reduced(tmp_path, made)
    assert result["flags"] == ["T=0:missing_rate:z"]
    assert entry(result, 0)["z"] is None
    assert entry(result, 0)["x"] is not None
    assert entry(result, 25)["z"] is not None


def test_the_rate_of_the_table_counts_and_not_the_command(tmp_path):
    unit = Unit()
    made, slow = records(unit, FEW_C), records(unit, FEW_C)
    row = slow.rate(0, "z", 3)
    for axis in "xyz":
        row[f"W{axis}"] = row[f"W{axis}"] and 0.8 * row[f"W{axis}"]
    row["dwell_s"] *= 0.8  # as many pulses a second ...
    row["rate_cmd_dps"] /= 0.8  # ... at a rate that is a fifth off the command
    expected, found = reduced(tmp_path, made), reduced(tmp_path, slow)
    assert found["flags"] == expected["flags"] == []
    assert entry(found, 0)["z"]["KG_p_per_deg"] == pytest.approx(entry(expected, 0)["z"]["KG_p_per_deg"], rel=1e-9)


def test_six_commands_that_were_one_rate_determine_no_scale_factor(tmp_path):
    made = records(Unit(), FEW_C)
    for n, row in enumerate(row for row in made.rates if (row["T_set_C"], row["axis"]) == (25, "y")):
        row["rate_cmd_dps"], row["rate_true_dps"] = 5 + n / 100, 5.0
    assert reduced(tmp_path, made)["flags"] == ["T=25:missing_rate:y"]


def test_rates_of_which_nothing_is_left(tmp_path):
    made = records(Unit(), [25])
    made.rates = [dict.fromkeys(made.rates[0])]
    result = reduced(tmp_path, made)
    assert result["flags"] == ["T=25:missing_rate:x", "T=25:missing_rate:y", "T=25:missing_rate:z"]
    assert result["table"] == [{"T_set_C": 25, "visit": 1, "x": None, "y": None, "z": None}]
    assert_least_squares(result, Unit(), abs=1e-12)  # the attitudes at rest are all there


def test_a_set_point_without_positions_lacks_all_of_them(tmp_path):
    made = records(Unit(), [25, 55])
    made.positions = [row for row in made.positions if row["T_set_C"] != 55]
    result = reduced(tmp_path, made)
    assert len(result["flags"]) == 24
    assert result["flags"][0] == "T=55:missing_position:Ax1"
    assert result["flags"][-1] == "T=55:missing_position:Az8"


def test_a_wrong_attitude_is_found_and_left_out(tmp_path):
    unit = Unit()
    made = records(unit, FEW_C)
    wrong, meant = made.position(25, "Az3"), made.position(25, "Ay2")
    wrong.update({key: meant[key] for key in wrong if key[0] in "NW"})  # the unit stood as in Ay2
    up, down = made.position(55, "Ax1"), made.position(55, "Ax5")
    up["pos"], down["pos"] = down["pos"], up["pos"]
    result = reduced(tmp_path, made)
    assert result["flags"] == [
        "T=55:attitude_inconsistent:Ax1", "T=55:attitude_inconsistent:Ax5", "T=25:attitude_inconsistent:Az3",
    ]  # fmt: skip
    assert entry(result, 55)["x"] is entry(result, 25)["z"] is None
    assert entry(result, 55)["y"] == pytest.approx(truth(unit, 55, "y"), rel=1e-12, abs=1e-10)
    assert_least_squares(result, unit, abs=1e-11)


@pytest.mark.parametrize("factor", [1000, 1 / 60, 0.9])
def test_a_dwell_in_another_unit_looks_like_a_wrong_attitude(tmp_path, factor):
    made = records(Unit(), FEW_C)
    made.position(0, "Ay8")["dwell_s"] *= factor
    assert reduced(tmp_path, made)["flags"] == ["T=0:attitude_inconsistent:Ay8"]


def test_the_tolerance_of_attitudes_is_a_setting(tmp_path):
    made = records(Unit(), FEW_C)
    made.position(0, "Ay8")["Ny"] += 0.03 * 11_120 * DWELL_S
    assert reduced(tmp_path, made)["flags"] == []
    assert reduced(tmp_path, made, attitude_tol_g=0.02)["flags"] == ["T=0:attitude_inconsistent:Ay8"]


def test_exchanged_headings_change_no_mean_and_are_told_by_the_gyros(tmp_path, rng):
    unit = Unit()
    made = records(unit, FEW_C, rng=rng, noise_counts=SIGMA_COUNTS)
    one, other = made.position(25, "Ax2"), made.position(25, "Ax4")
    one["pos"], other["pos"] = other["pos"], one["pos"]
    result = reduced(tmp_path, made)
    assert result["flags"] == []
    assert result["notes"] == ["T=25: the horizontal gyros saw north elsewhere than scheduled: Ax2, Ax4"]
    assert entry(result, 25)["x"]["D0_pps"] == pytest.approx(truth(unit, 25, "x")["D0_pps"], abs=0.1)
    assert_least_squares(result, unit, abs=1.5e-5)
    unchecked = reduced(tmp_path, made, site={}, ls24_T_set_C=None)
    assert unchecked["notes"] == ["headings were not checked: the latitude is not known"]
    assert unchecked["table"] == result["table"]


def test_gyros_too_noisy_for_headings_accuse_nobody(tmp_path, rng):
    made = records(Unit(), FEW_C, rng=rng, noise_counts=(15.0, 2000.0))
    result = reduced(tmp_path, made)
    assert result["flags"] == []
    assert result["notes"] == ["the gyros do not tell the headings of 72 of 72 attitudes"]


def test_the_last_good_repetition_counts(tmp_path):
    unit = Unit()
    made = records(unit, FEW_C)
    right = made.position(25, "Ax7")
    at = made.positions.index(right)
    made.positions.insert(at, right | {"Nx": 12.0, "Wx": 9.9e5})  # disturbed, done again
    made.positions.insert(at + 2, right | {"Nx": None})  # begun once more and given up
    made.rates.append(made.rate(25, "y", -5) | {"dwell_s": None})
    made.rates.insert(0, made.rate(25, "y", -5) | {"Wy": 0})
    result = reduced(tmp_path, made)
    assert result["flags"] == []
    assert result["rejected"] == {"missing": 2, "duplicate": 2, "rate": 0, "thermometer": 0}
    for axis in AXES:
        assert entry(result, 25)[axis] == pytest.approx(truth(unit, 25, axis), rel=1e-12, abs=1e-10)


def two_visits(first, second):
    """Records of the nominal temperature twice, of a unit that has become another one."""
    made, again = records(first, [25, 55, 0]), records(second, [25])
    made.positions += again.positions
    made.rates += again.rates
    return made


def test_two_visits_of_a_set_point_are_two_knots_and_their_difference_is_the_repeatability(tmp_path):
    first, second = (
        Unit(),
        Unit(zero_pps=Unit().zero_pps + np.array([4.0, -6.0, 1.0]), gyro_scale=Unit().gyro_scale * 1.001),
    )
    result = reduced(tmp_path, two_visits(first, second))
    assert [(point["T_set_C"], point["visit"]) for point in result["table"]] == [(55, 1), (25, 1), (25, 2), (0, 1)]
    for point, unit in zip(result["table"], (first, first, second, first), strict=True):
        for axis in AXES:
            assert point[axis] == pytest.approx(truth(unit, point["T_set_C"], axis), rel=1e-12, abs=1e-10)
    (repeated,) = result["repeatability"]
    assert [repeated[axis]["K0_pps"] for axis in AXES] == pytest.approx([4, 6, 1], abs=1e-9)
    assert [repeated[axis]["KG_p_per_deg"] for axis in AXES] == pytest.approx([4, 4.011, 3.99], abs=1e-9)
    assert result["rejected"]["duplicate"] == 0


def test_a_knot_is_the_mean_of_the_visits_of_a_set_point(tmp_path):
    shift = np.array([4.0, -6.0, 1.0])
    made = two_visits(Unit(), Unit(zero_pps=Unit().zero_pps + shift))
    middle = Unit(zero_pps=Unit().zero_pps + shift / 2)
    zero, scale = middle.accelerometer(30.0)  # 25 °C of the chamber
    made.apply = [
        {"channel": f"acc_{axis}", "T_C": 30.0, "raw_pps": zero[i] + 0.5 * scale[i]} for i, axis in enumerate(AXES)
    ]
    assert [row["value"] for row in reduced(tmp_path, made)["apply"]] == pytest.approx(3 * [0.5], abs=1e-12)


def test_a_column_tells_visits_apart_in_any_order_of_rows(tmp_path, rng):
    made = two_visits(Unit(), Unit(zero_pps=Unit().zero_pps + 4))
    expected = reduced(tmp_path, made)
    for rows, of_one in ((made.positions, 24), (made.rates, 18)):
        for number, row in enumerate(rows):
            row["visit"] = number // of_one + 1  # 1 and 4 are those of 25 °C
        rng.shuffle(rows)
    found = reduced(tmp_path, made)
    assert [(point["T_set_C"], point["visit"]) for point in found["table"]] == [(55, 2), (25, 1), (25, 4), (0, 3)]
    for one, other in zip(found["table"], expected["table"], strict=True):
        assert [one[axis] for axis in AXES] == [pytest.approx(other[axis], rel=1e-12, abs=1e-12) for axis in AXES]
    del made.positions[0]["visit"]
    made.positions[0]["visit"] = None
    assert reduced(tmp_path, made)["rejected"]["missing"] == 1


def test_a_second_visit_that_lacks_something_does_not_spoil_the_first(tmp_path):
    made = two_visits(Unit(), Unit())
    made.positions.pop()  # Az8 of the second visit
    result = reduced(tmp_path, made)
    assert result["flags"] == ["T=25:missing_position:Az8"]
    assert [point["z"] is None for point in result["table"]] == [False, False, True, False]
    assert result["repeatability"][0]["z"] is None
    assert result["repeatability"][0]["x"] is not None


def test_more_visits_than_a_chamber_makes_are_refused(tmp_path):
    made = records(Unit(), [25, 55])
    made.positions = [row for pair in zip(made.positions[:24], made.positions[24:], strict=True) for row in pair] * 30
    for row, pos in zip(made.positions, ["Ax1"] * 1440, strict=True):
        row["pos"] = pos
    with pytest.raises(InputError, match=r"set points are visited 14\d\d times, more than 1000; keep the rows of one"):
        reduced(tmp_path, made)


def test_set_points_closer_than_half_a_degree_are_one_knot(tmp_path):
    unit, later = Unit(), Unit(zero_pps=np.array([37.0, -52.0, 18.0]))
    made, again = records(unit, [25, 55]), records(later, [25.4])
    made.positions += again.positions
    made.rates += again.rates
    made.apply = [{"channel": "acc_x", "T_C": 30.2, "raw_pps": 1000.0}]
    result = reduced(tmp_path, made)
    assert [point["T_set_C"] for point in result["table"]] == [55, 25.4, 25]
    zero = (unit.accelerometer(30)[0][0] + later.accelerometer(30.4)[0][0]) / 2
    assert result["apply"][0]["value"] == pytest.approx((1000 - zero) / unit.accelerometer(30.2)[1][0], rel=1e-12)


@pytest.mark.parametrize("set_points_c", [[25], [25, 25.4]])
def test_fewer_than_two_knots_compensate_nothing(tmp_path, rng, set_points_c):
    made = records(Unit(), set_points_c)
    made.apply, _, _ = readings(Unit(), rng, count=1)
    result = reduced(tmp_path, made)
    assert all(row["value"] is row["comp_pps"] is None for row in result["apply"])
    assert result["flags"] == []
    assert result["model_check"]["gyro_x"]["KG_p_per_deg"] == {"left_out_error": [], "max_curvature_per_C2": None}


def test_knots_go_by_the_measured_temperature(tmp_path, rng):
    unit = Unit()
    made = records(unit, [15, 25, 35])
    names = {15: 25, 25: 15, 35: 0}  # what the chamber had been told is another thing than what it did
    for row in made.positions + made.rates:
        row["T_set_C"] = names[row["T_set_C"]]
    made.apply, values, _ = readings(unit, rng, count=3, low_c=20, high_c=38)
    result = reduced(tmp_path, made, T_nominal_C=28)
    assert [point["x"]["Ta_C"] for point in result["table"]] == [20, 30, 40]
    assert [row["value"] for row in result["apply"]] == pytest.approx(values, abs=1e-11)


def test_a_nominal_temperature_outside_of_the_knots_is_noted(tmp_path):
    made = records(Unit(), [35, 55])
    made.apply = [{"channel": "acc_x", "T_C": 45.0, "raw_pps": 1000.0}]
    result = reduced(tmp_path, made, ls24_T_set_C=35)
    assert result["notes"] == [f"T_nominal_C 25 is outside of the knots of {name}" for name in CHANNELS]
    assert result["apply"][0]["extrapolated"] is False
    assert result["apply"][0]["comp_pps"] is not None
    rejected = reduced(tmp_path, made, ls24_T_set_C=35, extrapolation="reject")["apply"][0]
    assert rejected["value"] == result["apply"][0]["value"]
    assert rejected["comp_pps"] is None


def test_bad_readings_of_a_thermometer_are_left_out(tmp_path):
    unit = Unit()
    made = records(unit, FEW_C)
    made.position(25, "Ax3")["Tax"] = 850  # open
    made.position(25, "Ax4")["Tax"] = 41.0  # jumped
    made.rate(25, "x", 1)["Tgx"] = None
    made.position(25, "Ay4")["Tax"] = 850  # not while x was calibrated
    for name in ("Az1", "Az2", "Az3", "Az4", "Az5", "Az6", "Az7", "Az8"):
        made.position(25, name)["Tgz"] = 301.15  # kelvin
    result = reduced(tmp_path, made)
    assert result["flags"] == []
    assert entry(result, 25)["x"] == pytest.approx(truth(unit, 25, "x"), rel=1e-12, abs=1e-10)
    assert result["rejected"]["thermometer"] == 11
    assert entry(result, 25)["z"].pop("Tg_C") is None
    true = truth(unit, 25, "z")
    del true["Tg_C"]
    assert entry(result, 25)["z"] == pytest.approx(true, rel=1e-12, abs=1e-10)
    assert result["notes"] == ["T=25: the thermometer of gyro_z gave fewer than half of its readings"]
    assert result["model_check"]["gyro_z"]["T_C"] == []  # two knots are left
    assert result["model_check"]["gyro_y"]["T_C"] == [28]


@pytest.mark.parametrize("latitude_deg", [90, -90, 89.9])
def test_at_a_pole_the_headings_tell_nothing(tmp_path, latitude_deg):
    unit = Unit()
    made = records(unit, FEW_C, latitude_deg=latitude_deg)
    result = reduced(tmp_path, made, site={"lat_deg": latitude_deg})
    assert result["flags"] == ["ill_conditioned"]
    untold = "g-sensitivity x, g-sensitivity y, g-sensitivity z, KG, misalignment y and misalignment z are not"
    assert sum(note.startswith(untold) for note in result["notes"]) == 1
    for i, axis in enumerate(AXES):
        found = result["ls24"][axis]
        assert found["gyro_D0_pps"] == pytest.approx(truth(unit, 25, axis)["D0_pps"], abs=1e-10)
        own_only = [unit.sensitivity[i, j] if j == i else None for j in range(3)]
        assert found["gyro_gsens_pps_per_g"] == pytest.approx(own_only, abs=1e-6)
        assert found["mis"] == pytest.approx(unit.mis[i], abs=1e-12)


@pytest.mark.parametrize("latitude_deg", [0, -52.5, 71])
def test_elsewhere_they_tell_everything(tmp_path, latitude_deg):
    result = reduced(tmp_path, records(Unit(), FEW_C, latitude_deg=latitude_deg), site={"lat_deg": latitude_deg})
    assert result["flags"] == result["notes"] == []
    assert_least_squares(result, Unit(), abs=1e-11)


def test_least_squares_of_too_few_attitudes_give_nothing(tmp_path):
    made = records(Unit(), [25])
    made.positions = made.positions[:5]
    result = reduced(tmp_path, made)
    assert len(result["flags"]) == 20
    assert result["flags"][-1] == "ill_conditioned"
    assert result["ls24"]["y"] == {
        "K0_g": None, "K1_pps_per_g": None, "K2_g_per_g2": None, "mis": [None, None, None],
        "gyro_D0_pps": None, "gyro_gsens_pps_per_g": [None, None, None],
    }  # fmt: skip
    assert result["ls24"]["y"] == {**result["u"]["ls24"]["y"]}


def test_partial_turns_let_in_as_much_as_is_printed(tmp_path):
    # 1 mrad at 34°: 2.9 ppm of 1 °/s in a third of a turn; the line through all rates takes 2 of its 70 parts.
    leak_dps = 2.9e-6
    unit = Unit()
    made = records(unit, FEW_C, latitude_deg=34.0, leak_dps=leak_dps)
    result = reduced(tmp_path, made, site={"lat_deg": 34.0})
    for axis in AXES:
        found, true = entry(result, 25)[axis]["KG_p_per_deg"], truth(unit, 25, axis)["KG_p_per_deg"]
        assert found / true - 1 == pytest.approx(leak_dps * 2 / 70, rel=1e-3)


def test_dead_and_absurd_channels_do_no_harm_to_others(tmp_path):
    unit = Unit()
    made = records(unit, FEW_C)
    for row in made.positions:
        row["Nx"] = 0  # a dead accelerometer
        row["Wy"] *= 1e300
        row["Tgx"], row["Tax"] = 1e308, -1e308
    for row in made.rates:
        row["Wz"] = 7 * DWELL_S  # a gyro that does not see the rate
    made.apply = [{"channel": name, "T_C": 20.0, "raw_pps": -1e308} for name in CHANNELS]
    result = reduced(tmp_path, made)
    *inconsistent, ill, wild, hot = result["flags"]
    assert ill == "ill_conditioned"  # misalignment towards an axis that was never seen vertical
    assert {wild, hot} == {"implausible_scale", "implausible_temperature"}
    assert len(inconsistent) == 3 * 8
    assert all("attitude_inconsistent:Ax" in flag for flag in inconsistent)
    for set_c in FEW_C:
        found = entry(result, set_c)
        assert found["x"] is None
        assert found["y"]["K1_pps_per_g"] == pytest.approx(truth(unit, set_c, "y")["K1_pps_per_g"], rel=1e-12)
        assert found["z"]["KG_p_per_deg"] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        ({"T_nominal_C": None}, "case.json: settings.T_nominal_C: is missing; the record 'apply' needs it"),
        ({"site": {}}, "case.json: site.lat_deg: is missing; ls24 needs the earth rate"),
        ({"site": {"lat_deg": 91}}, "case.json: site.lat_deg: is 91, expected at most 90"),
        ({"extrapolation": "cubic"}, "case.json: settings.extrapolation: is 'cubic', expected 'hold', 'linear' or"),
        ({"attitude_tol_g": 0}, "case.json: settings.attitude_tol_g: is 0, expected more than 0"),
    ],
)
def test_a_case_that_cannot_be_reduced_is_refused(tmp_path, damage, message):
    made = records(Unit(), FEW_C)
    made.apply = [{"channel": "acc_x", "T_C": 20, "raw_pps": 1}]
    with pytest.raises(InputError) as caught:
        reduced(tmp_path, made, **damage)
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda made: made.positions[2].update(Nz="12,5"), "positions.csv: line 4: 16 cells, but the header has 15"),
        (lambda made: made.rates[0].update(axis="w"), "rates.csv: line 2, column axis: 'w' is not x or y or z"),
        (lambda made: made.rates[3].update(Tgx="warm"), "rates.csv: line 5, column Tgx: 'warm' is not a number"),
        (lambda made: made.apply[0].update(channel="acc"), "apply.csv: line 2, column channel: 'acc' is not acc_x or"),
        (lambda made: made.positions[0].pop("Wx"), "positions.csv: line 1: there is no column 'Wx'"),
    ],
)
def test_a_bad_record_is_refused_where_it_is_bad(tmp_path, damage, message):
    made = records(Unit(), FEW_C)
    made.apply = [{"channel": "acc_x", "T_C": 20, "raw_pps": 1}]
    damage(made)
    with pytest.raises(InputError) as caught:
        reduced(tmp_path, made)
    assert str(caught.value).startswith(message)


def test_measured_temperatures_are_no_set_points(tmp_path):
    made = records(Unit(), [25])
    made.positions = [made.positions[0] | {"T_set_C": 25 + i / 1000} for i in range(1200)]
    with pytest.raises(
        InputError, match=r"^case\.json: records: T_set_C has 1200 different values, more than 1000; it is"
    ):
        reduced(tmp_path, made)


def test_a_case_without_rates_is_one_with_an_empty_record_of_them(tmp_path):
    made = records(Unit(), [25])
    made.rates = None
    result = reduced(tmp_path, made)
    assert result["flags"] == [f"T=25:missing_rate:{axis}" for axis in "xyz"]
    assert result["table"] == [{"T_set_C": 25, "visit": 1, "x": None, "y": None, "z": None}]


def test_rows_of_unknown_positions_are_passed_over_and_named(tmp_path):
    made = records(Unit(), FEW_C)
    clean = reduced(tmp_path, made)
    made.positions += [made.positions[0] | {"pos": f"Q{i}"} for i in (*range(1, 8), 1)]
    result = reduced(tmp_path, made)
    assert result["notes"][-1] == (
        "positions.csv: rows of unknown positions were ignored, 8: 'Q1', 'Q2', 'Q3', 'Q4', 'Q5' and 2 more"
    )
    assert result["rejected"] == clean["rejected"] | {"missing": 8}
    assert (result["table"], result["flags"]) == (clean["table"], clean["flags"])


def test_a_set_point_for_the_least_squares_that_was_not_visited_gives_none(tmp_path):
    result = reduced(tmp_path, records(Unit(), FEW_C), ls24_T_set_C=26)
    assert (result["ls24"], result["flags"]) == (None, [])
    assert result["notes"] == ["ls24_T_set_C: there is no set point 26; there are: 55, 25, 0"]
    assert len(result["table"]) == 3


@pytest.mark.parametrize("rows", [0, 1])
def test_records_without_a_reading_give_an_empty_table(tmp_path, rows):
    path = write_case(tmp_path, records(Unit(), [25]), ls24_T_set_C=None)
    for name in ("positions.csv", "rates.csv"):
        header = (tmp_path / name).read_text().splitlines()[0]
        (tmp_path / name).write_text("\n".join([header, *rows * [header.count(",") * ","]]) + "\n")
    result = reduce_case(path)
    assert result["table"] == result["flags"] == result["apply"] == []
    assert result["ls24"] is None
    assert result["rejected"]["missing"] == 2 * rows
