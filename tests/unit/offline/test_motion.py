"""Specific force and velocity from files: `bench compensate --to`."""

import csv
import io
import json

import numpy as np
import pytest

from bench.errors import InputError
from bench.offline.calibration_file import read_calibration
from bench.offline.motion import in_motion, wanted

K1, K0 = 10_000.0, 1e-3
CONSTANT_SCALE = {"unit": "pulse/s/g", "value": K1, "u": 1.0}
OFFSET = {"unit": "pulse/s", "knots_c": [0, 40], "values": [0.0, 40.0], "u": [0.1, 0.1]}
FORCE = {"quadratic": {"unit": "g/g²", "value": 0.0, "u": 0.0}, "valid_g": [-1, 1]}
CHANNEL = {
    "channel": "x", "output": "pulse/s", "value": "g", "scale": CONSTANT_SCALE, "offset": OFFSET,
    "bias": {"unit": "g", "value": K0}, "force": FORCE,
}  # fmt: skip
GOOD = {
    "schema": "itb-calibration/1", "uut": "QF-7", "gravity_mps2": 9.8, "u_gravity_mps2": 1e-4, "channels": [CHANNEL],
}  # fmt: skip
RATE_PPS = K1 * (1 + K0) + 20  # of 1 g at 20 °C


def calibration(folder, *channels, **changes):
    path = folder / "cal.json"
    path.write_text(json.dumps({**GOOD, **({"channels": channels} if channels else {}), **changes}), "utf-8")
    return read_calibration(path)


def converted(folder, text, known=None, to="velocity", unit="g", bits=None, noise=None, starts=(), beyond="hold"):
    """Rows of a record, and remarks."""
    path = folder / "data.csv"
    path.write_text(text, "utf-8")
    found = in_motion(known or calibration(folder), path, wanted(to, unit, beyond, bits, noise, starts))
    file = io.StringIO()
    found.write(file)
    return list(csv.DictReader(io.StringIO(file.getvalue()))), list(found.remarks)


def counts(rows=11, every_s=1.0, at_c=20, pps=RATE_PPS, names=("x",), size=2**60, first=0):
    """A record at rest."""
    lines = ["t_s,T_C," + ",".join(names)]
    for row in range(rows):
        net = round(pps * row * every_s) + first
        lines.append(f"{row * every_s},{at_c}," + ",".join(str(net % size if i == 0 else 7) for i in range(len(names))))
    return "\n".join(lines) + "\n"


def column(rows, name):
    return [float(row[name] or "nan") for row in rows]


def test_velocity_and_acceleration_have_their_units_and_uncertainties(tmp_path):
    rows, remarks = converted(tmp_path, counts())
    assert list(rows[0]) == ["t_s", "x_mps", "u_x_mps", "extrapolated", "gap", "glitch"]
    assert column(rows, "x_mps") == pytest.approx(9.8 * np.arange(11), abs=1e-3)
    assert column(rows, "u_x_mps")[0] == 0
    parts = 98 * np.array([1e-4, 1e-5, 1e-4 / 9.8])  # scale, offset, gravity
    assert column(rows, "u_x_mps")[-1] == pytest.approx(np.hypot(np.linalg.norm(parts), 0.408e-4 * 9.8), rel=2e-3)
    assert remarks == []
    in_g, _ = converted(tmp_path, counts(), to="acceleration")
    assert np.isnan(column(in_g, "x_g")[0])
    assert column(in_g, "x_g")[1:] == pytest.approx(np.ones(10), abs=1e-4)
    in_mps2, _ = converted(tmp_path, counts(), to="acceleration", unit="m/s2")
    assert column(in_mps2, "x_mps2")[1:] == pytest.approx(9.8 * np.array(column(in_g, "x_g")[1:]), rel=1e-9)
    noisy, _ = converted(tmp_path, counts(), to="acceleration", noise="1 mg/Hz^0.5")
    assert column(noisy, "u_x_g")[5] == pytest.approx(np.hypot(column(in_g, "u_x_g")[5], 0.707e-3), rel=1e-3)


def test_counters_of_both_signs_may_wrap(tmp_path):
    plain, _ = converted(tmp_path, counts())
    size = 2**16
    wrapping = counts(names=("x_pos", "x_neg"), size=size, first=size - 5)
    assert converted(tmp_path, wrapping, bits=16)[0] == plain
    down = wrapping.replace("x_pos,x_neg", "x_neg,x_pos")
    turned, _ = converted(tmp_path, down, bits=16)
    assert column(turned, "x_mps")[-1] == pytest.approx(-98 - 2 * 98e-3 - 2 * 98 * 20 / K1, abs=2e-3)


def test_a_counter_that_may_have_wrapped_unnoticed_gives_no_velocity_from_there_on(tmp_path):
    lines = counts(rows=21, names=("x_pos", "x_neg"), size=2**16).splitlines()
    del lines[8:13]  # five seconds, in which 50 000 pulses have come
    rows, remarks = converted(tmp_path, "\n".join(lines), bits=16)
    assert [row["x_mps"] == "" for row in rows] == 7 * [False] + 9 * [True]
    assert remarks[-1].startswith("data.csv: 1 rows from t_s = 12 on: a counter may have wrapped unnoticed")
    forces, _ = converted(tmp_path, "\n".join(lines), to="acceleration", bits=16)
    assert [row["x_g"] == "" for row in forces] == [True, *6 * [False], True, *8 * [False]]


def test_a_record_of_which_no_interval_is_known_is_blank(tmp_path):
    fast = counts(rows=5, every_s=10.0, names=("x_pos", "x_neg"), pps=4e3, size=2**16)  # 40 000 in each interval
    rows, remarks = converted(tmp_path, fast, bits=16)
    assert [row["x_mps"] for row in rows] == ["0", "", "", "", ""]
    assert remarks == [
        "data.csv: 4 rows from t_s = 10 on: a counter may have wrapped unnoticed; a velocity is blank from there on"
    ]


def test_gaps_glitches_and_temperatures_out_of_range_are_marked(tmp_path):
    lines = counts(rows=31).splitlines()
    lines[21:] = [f"{t},{c},{int(n) + 500}" for t, c, n in (line.split(",") for line in lines[21:])]  # extra pulses
    lines[28] = lines[28].replace(",20,", ",41,")
    del lines[5:8]
    rows, remarks = converted(tmp_path, "\n".join(lines))
    marked = {name: [float(r["t_s"]) for r in rows if r[name] == "1"] for name in ("gap", "glitch", "extrapolated")}
    assert marked == {"gap": [7], "glitch": [20], "extrapolated": []}  # 41 °C and 20 °C have the mean 30.5 °C
    # No pulse of the gap is lost. In two seconds the offset is 10.5 pulse/s more than at 20 °C.
    assert column(rows, "x_mps")[-1] == pytest.approx(9.8 * (30 + (500 - 21) / K1), abs=1e-3)
    assert [remark.split(": ")[1] for remark in remarks[:2]] == ["1 rows from t_s = 7 on", "1 rows from t_s = 20 on"]
    warm, remarks = converted(tmp_path, counts(at_c=45))
    assert [row["extrapolated"] for row in warm] == ["0", *10 * ["1"]]
    assert "outside of the range of the calibration" in remarks[0]
    rejected, _ = converted(tmp_path, counts(at_c=45), beyond="reject")
    assert [row["x_mps"] for row in rejected[1:]] == 10 * [""]


def test_temperatures_may_be_rarer_than_counts_and_rows_incomplete(tmp_path):
    lines = counts(rows=11).splitlines()
    lines[2:11] = [line.replace(",20,", ",,") for line in lines[2:11]]
    lines.insert(4, "2.5,20,")
    rows, remarks = converted(tmp_path, "\n".join(lines) + "\n\n")
    assert rows == converted(tmp_path, counts())[0]
    assert remarks == ["data.csv: 1 rows without a time or an output were left out"]


def test_a_temperature_between_two_readings_is_on_the_line_between_them(tmp_path):
    every = [f"{t}.0,{20 + t},{10030 * t}" for t in range(11)]
    rare = [line if t in (0, 10) else line.replace(f",{20 + t},", ",,") for t, line in enumerate(every)]
    for options in ({}, {"to": "acceleration"}):
        full, thinned = (converted(tmp_path, "\n".join(["t_s,T_C,x", *lines]), **options)[0] for lines in (every, rare))
        assert thinned == full


def test_forces_beyond_those_of_the_calibration_are_told(tmp_path):
    _, remarks = converted(tmp_path, counts(pps=3.5 * K1))
    assert "channel x: from 3.5 to 3.5 g; the calibration was made from -1 to 1 g" in remarks[0]


def test_a_record_with_three_axes(tmp_path):
    names = ("acc_x", "acc_y", "acc_z")
    cross = [{n: {"unit": "rad", "value": 1e-3, "u": 1e-5} for n in names if n != own} for own in names]
    axes = [
        {**CHANNEL, "channel": name, "force": {**FORCE, "cross": each}} for name, each in zip(names, cross, strict=True)
    ]
    text = "t_s,T_C,acc_x,acc_y,acc_z\n" + "".join(f"{t},20,{10030 * t},{30 * t},{30 * t}\n" for t in range(5))
    rows, _ = converted(tmp_path, text, calibration(tmp_path, *axes))
    assert column(rows, "acc_x_mps")[-1] == pytest.approx(4 * 9.8, abs=1e-3)
    assert column(rows, "acc_y_mps")[-1] == pytest.approx(-4 * 9.8e-3, abs=1e-3)
    with pytest.raises(InputError, match=r"the calibration of QF-7 lacks acc_z, for cross-coupling"):
        converted(tmp_path, text, calibration(tmp_path, *axes[:2]))


@pytest.mark.parametrize(
    ("change", "options", "message"),
    [
        (("t_s", "t_ms"), {}, r"no column 't_s'.*it has the times in s: convert other units"),
        (("T_C", "T_K"), {}, r"no column 'T_C'.*the temperatures in °C of the thermometer"),
        ((",20,", ",,"), {}, "column T_C is blank; the calibration depends on the temperature"),
        ((",20,", ",293,"), {}, "column T_C has 293 and more: is it in kelvin"),
        ((",x\n", ",y\n"), {}, r"has no column 'x'; the counts of channel x are .*'x_pos' and 'x_neg'"),
        (("x\n", "x_pos\n"), {}, "has no column 'x'"),
        (("2.0,20,", "-2.0,20,"), {}, "t_s goes from 1 to -2 in row 3 of the data; times increase"),
        (("2.0,20,20060", "2.0,20,20060.5"), {}, "column x has 20060.5 at t_s = 2; counts are whole"),
        (("2.0,20,20060", "2.0,20,many"), {}, "line 4, column x: 'many' is not a number"),
        (("2.0,20,20060", "2.0,20"), {}, "line 4: 2 cells, but the header has 3"),
        (("t_s,T_C,x\n", ""), {}, "line 1: has no names of columns"),
        (("t_s,T_C,x\n", "t_s,T_C,x,x\n"), {}, "more than one column 'x'"),
        (("", ""), {"starts": ("x=-1",)}, "begins with 1 g, not with -1 g; the sign is another"),
        (("", ""), {"starts": ("x=0.5",)}, "is the unit at rest there"),
        (("", ""), {"starts": ("y=1",)}, "there is no channel 'y'; the calibration has x"),
        (("", ""), {"starts": ("x",)}, "expected CHANNEL=G"),
        (("", ""), {"noise": "2 mm"}, '--noise "2 mm"'),
    ],
)  # fmt: skip
def test_what_cannot_be_meant_is_refused(tmp_path, change, options, message):
    with pytest.raises(InputError, match=message):
        converted(
            tmp_path, counts().replace(*change, 1) if len(change[0]) > 4 else counts().replace(*change), **options
        )


def test_times_in_ms_are_noticed_at_a_known_start(tmp_path):
    with pytest.raises(InputError, match="are the times of t_s in ms"):
        converted(tmp_path, counts(every_s=1.0, pps=(K1 * K0 + 20 + K1 * 1e-3)), starts=("x=1",))
    with pytest.raises(InputError, match=r"would have 1.1e\+03 g in half of the intervals; are the times in s"):
        converted(tmp_path, counts(pps=1.1e3 * K1))


def test_a_counter_that_falls_is_refused_unless_it_wraps(tmp_path):
    with pytest.raises(InputError, match="column x_pos falls at t_s = 7, as a counter of one sign does not"):
        converted(tmp_path, counts(names=("x_pos", "x_neg"), size=2**16))


def test_a_calibration_that_gives_no_force_from_counts_is_refused(tmp_path):
    without = {name: value for name, value in CHANNEL.items() if name != "force"}
    with pytest.raises(InputError, match=r"gives no specific force.*It has x \(pulse/s to g\)"):
        converted(tmp_path, counts(), calibration(tmp_path, without))
    with pytest.raises(InputError, match=r"It has x \(V to g\)"):
        converted(tmp_path, counts(), calibration(tmp_path, {**CHANNEL, "output": "V"}))
    with pytest.raises(InputError, match="states no gravity"):
        converted(tmp_path, counts(), calibration(tmp_path, gravity_mps2=None))


def test_a_file_is_read_in_blocks(tmp_path, monkeypatch):
    whole = converted(tmp_path, counts(rows=200))
    monkeypatch.setattr("bench.offline.number_columns.BLOCK_CHARACTERS", 100)
    monkeypatch.setattr("bench.offline.motion.LINES", 7)
    assert converted(tmp_path, counts(rows=200)) == whole
    with pytest.raises(InputError, match="line 152, column x"):
        converted(tmp_path, counts(rows=200).replace("150.0,20,", "150.0,20,x"))


# Samples

VOLTS = {
    **CHANNEL, "output": "V", "scale": {"unit": "V/g", "value": 0.5, "u": 5e-5},
    "offset": {"unit": "V", "knots_c": [0, 40], "values": [0.0, 2e-3], "u": [0.0, 0.0]},
    "force": {**FORCE, "sample": "instant", "step": 0.0},
}  # fmt: skip
CODES = {
    **CHANNEL, "output": "code", "scale": {"unit": "code/g", "value": 4e5, "u": 40.0}, "offset": None,
    "force": {**FORCE, "sample": "mean", "step": 1.0},
}  # fmt: skip
OF_X = "the calibration of channel x is of an output in"
OF_1G = {"V": 0.5 * (1 + K0) + 1e-3, "code": 4e5 * (1 + K0)}


def samples(value, rows=11, name="x"):
    lines = [f"{row},20,{value!r}" for row in range(rows)]
    return "\n".join([f"t_s,T_C,{name}", *lines]) + "\n"


@pytest.mark.parametrize("sign", [1, -1])
def test_samples_give_velocity_and_specific_force(sign, tmp_path):
    for known, value in ((VOLTS, OF_1G["V"]), (CODES, round(OF_1G["code"]))):
        zero = known["offset"]["values"][1] / 2 if known["offset"] else 0.0
        turned = known | {"scale": known["scale"] | {"value": sign * known["scale"]["value"]}}
        rows, remarks = converted(tmp_path, samples(zero + sign * (value - zero)), calibration(tmp_path, turned))
        assert column(rows, "x_mps") == pytest.approx(9.8 * np.arange(11), abs=1e-6)
        assert column(rows, "u_x_mps")[-1] == pytest.approx(98e-4 * np.hypot(1 + K0, 0.1020), rel=1e-2)
        assert remarks == []


@pytest.mark.parametrize(("name", "factor"), [("x_V", 1), ("x_mV", 1000), ("x_µV", 1e6)])
def test_a_column_may_state_another_unit_of_the_same_kind(name, factor, tmp_path):
    rows, _ = converted(tmp_path, samples(OF_1G["V"] * factor, name=name), calibration(tmp_path, VOLTS))
    assert column(rows, "x_mps")[-1] == pytest.approx(98.0, rel=1e-9)


@pytest.mark.parametrize(
    ("known", "text", "options", "problem"),
    [
        (VOLTS, samples(4, name="x_code"), {}, f"column 'x_code' is in 'code', and {OF_X} V"),
        (VOLTS, samples(4, name="x_bananas"), {}, "column 'x_bananas' is in 'bananas'"),
        (CODES, samples(0.5, name="x_V"), {}, f"column 'x_V' is in 'V', and {OF_X} code"),
        (CODES, samples(0.5), {}, "column x has 0.5 at t_s = 0; codes are whole numbers"),
        (VOLTS, counts(names=("x_pos", "x_neg")), {}, f"column 'x_pos' has counts, and {OF_X} V"),
        (VOLTS, counts(), {}, "is the column in this unit, and are these samples, not counts"),
        (VOLTS, samples(1, name="y"), {}, "has no column 'x'; expected t_s, T_C or y; the calibration"),
        (VOLTS, samples(500 * (1 + K0) + 1), {}, "Name it with its unit, such as x_mV"),
        (VOLTS, samples(1e-3 - 0.5 * (1 - K0)), {"starts": ("x=1",)}, "are both lines of the output exchanged"),
        (CODES, samples(400_400), {"bits": 24}, "--counter-bits is for counts"),
        (CHANNEL, samples(0.5, name="x_V"), {}, "has no column 'x' but 'x_V', and the calibration is of the pulses"),
    ],
)  # fmt: skip
def test_a_record_of_another_kind_than_the_calibration_is_refused(known, text, options, problem, tmp_path):
    with pytest.raises(InputError) as refused:
        converted(tmp_path, text, calibration(tmp_path, known), **options)
    assert problem in str(refused.value)


def test_channels_of_several_kinds_are_refused(tmp_path):
    both = calibration(tmp_path, VOLTS, {**CODES, "channel": "y"})
    with pytest.raises(InputError, match="has channels of several kinds of output: x, y"):
        converted(tmp_path, samples(1), both)


def test_lost_and_wrong_samples_are_marked(tmp_path):
    lines = samples(400_400, rows=60).splitlines()
    lines[31] = lines[31].replace("400400", "400900")
    del lines[11:13], lines[40:55]
    rows, remarks = converted(tmp_path, "\n".join(lines), calibration(tmp_path, CODES))
    marked = {name: [float(r["t_s"]) for r in rows if r[name] == "1"] for name in ("gap", "glitch")}
    assert marked == {"gap": [12, 56], "glitch": [30]}
    assert [row["x_mps"] == "" for row in rows] == [float(row["t_s"]) >= 56 for row in rows]
    assert [remark.partition(": ")[2].partition(": ")[2] for remark in remarks] == [
        "samples are missing before the row; the output is taken to be between its neighbours",
        "too many samples are missing before the row; a velocity is blank from there on",
        "one sample differs from those before and after it",
    ]
