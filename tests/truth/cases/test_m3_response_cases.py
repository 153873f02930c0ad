"""Sweeps of M3, made from a known sensor on a swinging table, reduced and held against the truth."""

import json

import numpy as np
import pytest
from scipy.optimize import brentq

from bench.methods.rate_table.reduction.blocks import TableRecord
from bench.methods.rate_table.reduction.lever_arm import AccelerometerSweep, accelerometer_response
from bench.methods.rate_table.reduction.response_points import gyro_response
from bench.offline.case import reduce_case
from tests.support.m3_cases import (
    G_MPS2,
    accelerometer_block,
    gyro_block,
    joined,
    second_order,
    shuffled,
    write_case,
)

UNIT = second_order(60, 0.65, 0.002)
SLOW_HZ = 401.3  # samples a second, for sweeps up to 100 Hz
FREQUENCIES_HZ = [10.0, 20.0, 40.0, 50.0, 60.0, 62.0, 64.0, 66.0, 70.0, 80.0, 100.0]
LEVER_HZ = 0.5
ARM_M = (0.047, -0.052)


@pytest.fixture
def rng():
    return np.random.default_rng(20_240_304)


def gyro_sweep(rng, frequencies_hz=FREQUENCIES_HZ, response=UNIT, **changed):
    changed = {"sample_hz": SLOW_HZ, "seconds": 1.5} | changed
    return [gyro_block(rng, f, response, **changed) for f in frequencies_hz]


def reduced(tmp_path, blocks, *, sub="gyro_freq", **settings):
    return reduce_case(write_case(tmp_path, sub, settings, joined(blocks)))


def true_bandwidth_hz(response):
    return brentq(lambda f: abs(response(f)) - np.sqrt(0.5), 10, 200)


def unwrapped_deg(response, frequencies_hz):
    fine_hz = np.linspace(0.01, max(frequencies_hz), 5000)
    phase_deg = np.degrees(np.unwrap([np.angle(response(f)) for f in fine_hz]))
    return np.interp(frequencies_hz, fine_hz, phase_deg)


def test_gyro_response_is_that_of_the_unit(tmp_path, rng):
    result = reduced(tmp_path, gyro_sweep(rng))
    assert list(result) == [
        "method", "sub", "points", "bandwidth_Hz", "bandwidth_status", "bandwidth_crossings",
        "phase_at_bandwidth_deg", "flags", "notes", "rejected",
    ]  # fmt: skip
    assert list(result["points"][0]) == ["f_Hz", "table_amp_dps", "gain", "gain_dB", "phase_deg", "u_gain"]
    points = result["points"]
    assert [point["f_Hz"] for point in points] == FREQUENCIES_HZ
    assert [point["gain"] for point in points] == pytest.approx([abs(UNIT(f)) for f in FREQUENCIES_HZ], abs=2e-3)
    assert [point["phase_deg"] for point in points] == pytest.approx(unwrapped_deg(UNIT, FREQUENCIES_HZ), abs=0.2)
    assert min(point["phase_deg"] for point in points) < -180
    for point in points:
        assert point["gain_dB"] == pytest.approx(20 * np.log10(point["gain"]))
        assert point["table_amp_dps"] == pytest.approx(3, rel=2e-3)
        assert 1e-5 < point["u_gain"] < 1e-3
    assert result["bandwidth_status"] == "ok"
    assert result["bandwidth_Hz"] == pytest.approx(true_bandwidth_hz(UNIT), abs=0.1)
    assert result["phase_at_bandwidth_deg"] == pytest.approx(
        unwrapped_deg(UNIT, [true_bandwidth_hz(UNIT)])[0], abs=0.5
    )  # fmt: skip
    assert (result["flags"], result["notes"], result["bandwidth_crossings"]) == ([], [], 1)
    assert result["rejected"] == {"missing": 0, "duplicate": 0, "outlier": 0}


@pytest.mark.parametrize("first_deg", [0.0, -180.0])
def test_an_encoder_may_begin_anew_within_the_swing(tmp_path, rng, first_deg):
    blocks = gyro_sweep(rng)
    reported = reduced(tmp_path, blocks)
    for block in blocks:  # the swing is about where the encoder begins anew
        block["enc_deg"] = (block["enc_deg"] - np.median(block["enc_deg"])) % 360 + first_deg
        assert np.ptp(block["enc_deg"]) > 359
    wrapped = reduced(tmp_path, [shuffled(block, rng) for block in blocks])
    gains, expected = ([point["gain"] for point in each["points"]] for each in (wrapped, reported))
    assert gains == pytest.approx(expected, rel=1e-6)
    assert wrapped["bandwidth_Hz"] == pytest.approx(reported["bandwidth_Hz"], rel=1e-6)
    assert wrapped["flags"] == []


def test_the_table_droops_and_the_response_does_not(tmp_path, rng):
    loop = second_order(60, 1.0)
    blocks = [
        gyro_block(rng, f, UNIT, amplitude_dps=3 * abs(loop(f)), sample_hz=SLOW_HZ, seconds=1.5)
        for f in FREQUENCIES_HZ
    ]  # fmt: skip
    result = reduced(tmp_path, blocks)
    held = [f for f in FREQUENCIES_HZ if abs(loop(f)) > 0.5 * abs(loop(10))]
    assert [point["f_Hz"] for point in result["points"]] == held
    assert result["flags"] == [f"{f:g} Hz droop" for f in FREQUENCIES_HZ if f not in held]
    assert len(result["flags"]) > 1
    assert [point["gain"] for point in result["points"]] == pytest.approx([abs(UNIT(f)) for f in held], abs=3e-3)
    assert result["points"][-1]["table_amp_dps"] == pytest.approx(3 * abs(loop(held[-1])), rel=3e-3)


def test_gains_over_the_lowest(tmp_path, rng):
    blocks = gyro_sweep(rng, response=lambda f: 0.66 * UNIT(f))
    absolute = reduced(tmp_path, blocks)
    assert (absolute["bandwidth_status"], absolute["bandwidth_Hz"]) == ("below_at_start", None)
    assert absolute["phase_at_bandwidth_deg"] is None
    relative = reduced(tmp_path, blocks, gain_reference="lowest")
    assert relative["points"][0]["gain"] == 1
    assert relative["points"][0]["u_gain"] == 0
    expected = [abs(UNIT(f) / UNIT(10)) for f in FREQUENCIES_HZ]
    assert [point["gain"] for point in relative["points"]] == pytest.approx(expected, abs=3e-3)
    assert relative["bandwidth_status"] == "ok"


def test_bandwidth_beyond_the_sweep_is_not_reached(tmp_path, rng):
    result = reduced(tmp_path, gyro_sweep(rng, [10.0, 20.0, 30.0]))
    assert (result["bandwidth_status"], result["bandwidth_Hz"]) == ("not_reached", None)


def test_several_crossings_are_told(tmp_path, rng):
    def notched(f):
        return 0.4 if 19 < f < 21 or f > 60 else 1.0

    result = reduced(tmp_path, gyro_sweep(rng, [10.0, 20.0, 40.0, 80.0], response=notched))
    assert result["flags"] == []
    assert result["notes"] == ["the gain falls through 1/√2 2 times; the bandwidth is the first"]
    assert result["bandwidth_crossings"] == 2
    assert 10 < result["bandwidth_Hz"] < 20


PRINTS = ["{!r}", "{:.12g}", "{:.9g}", "{:.6f}"]


def printed(blocks, form, *, offset=0.0, start_s=0.0, increments=False):
    """The columns of a record as a reader gets them from a file."""
    f_hz, time_s, table, output = joined(blocks).values()
    fine = form.replace(".6f", ".10f") if increments else form
    columns = ((time_s + start_s, form), (table + offset, fine), (output, fine))
    return TableRecord(f_hz, *(np.array([float(how.format(v)) for v in values.tolist()]) for values, how in columns))


@pytest.mark.parametrize("form", PRINTS)
@pytest.mark.parametrize(
    ("offset_deg", "start_s", "sample_hz"),
    [(-1.7, 0.0, 1024.0), (98.3, 0.0, 997.0), (-1.7, 970.0, 1024.0), (99_998.3, 0.0, 997.0)],
)
def test_the_rounding_of_a_clean_swing_is_no_outlier(rng, form, offset_deg, start_s, sample_hz):
    clean = {"count": False, "jitter_counts": 0, "drift_counts_per_s": 0, "noise_dps": 0, "sample_hz": sample_hz}
    blocks = gyro_sweep(rng, [10.0, 20.3, 50.0, 100.3], **clean)
    found = gyro_response(printed(blocks, form, offset=offset_deg, start_s=start_s), settle_s=0.2)
    assert found.flags == ()
    coarse = form == "{:.9g}" and offset_deg > 1e3  # 0.4 and 4 arcsec
    assert found.excluded["outlier"] < 0.01 * sum(len(block["t_s"]) for block in blocks)
    for point in found.points:
        assert point.gain == pytest.approx(abs(UNIT(point.frequency_hz)), rel=0.02 if coarse else 1e-4)


@pytest.mark.parametrize("form", PRINTS)
def test_the_rounding_of_clean_increments_is_no_outlier(rng, form):
    clean = {"arm_m": ARM_M, "count": False, "jitter_counts": 0, "noise_g": 0}
    blocks = [accelerometer_block(rng, LEVER_HZ, UNIT, amplitude_dps=60, seconds=6, **clean)]
    blocks += [accelerometer_block(rng, f, UNIT, seconds=1.5, **clean) for f in (10.0, 50.0, 100.3)]
    sweep = AccelerometerSweep(G_MPS2, 1 / 999.7, LEVER_HZ, 0.2)
    arm, found = accelerometer_response(printed(blocks, form, increments=True), sweep)
    assert found.flags == ()
    assert arm.y_m == pytest.approx(ARM_M[1], rel=1e-3)
    for point in found.points:
        assert point.gain == pytest.approx(abs(UNIT(point.frequency_hz) / UNIT(LEVER_HZ)), rel=1e-4)


def test_small_outliers_of_a_clean_swing_are_left_out(rng):
    clean = {"count": False, "jitter_counts": 0, "drift_counts_per_s": 0, "noise_dps": 0}
    block = gyro_block(rng, 50.3, UNIT, seconds=1.5, **clean)
    block["enc_deg"][100:200:10] += 5e-6  # 5e-4 of the amplitude
    block["enc_deg"][700] += 1e6
    found = gyro_response(printed([block], "{!r}"))
    assert found.excluded["outlier"] == 11
    assert found.points[0].gain == pytest.approx(abs(UNIT(50.3)), rel=1e-9)


@pytest.mark.parametrize("off_hz", [-0.3, 0.004, 0.6])
def test_a_frequency_that_is_off_is_measured_first(tmp_path, rng, off_hz):
    blocks = [gyro_block(rng, f, UNIT, true_hz=f + off_hz, sample_hz=SLOW_HZ, seconds=3.0) for f in (20.0, 40.0, 60.0)]
    result = reduced(tmp_path, blocks)
    assert [point["f_Hz"] for point in result["points"]] == [20, 40, 60]
    expected = [abs(UNIT(f + off_hz)) for f in (20, 40, 60)]
    assert [point["gain"] for point in result["points"]] == pytest.approx(expected, abs=1e-3)
    assert len(result["notes"]) == (0 if abs(off_hz) < 0.01 else 3)


def test_phase_steps_that_are_too_coarse_are_flagged(tmp_path, rng):
    delayed = second_order(200, 0.7, 0.02)
    result = reduced(tmp_path, gyro_sweep(rng, [5.0, 10.0, 15.0, 40.0], response=delayed))
    assert result["flags"] == ["40 Hz phase_step"]
    result = reduced(tmp_path, gyro_sweep(rng, [5.0, 10.0, 15.0, 20.0, 25.0], response=delayed))
    assert result["flags"] == []
    assert result["points"][-1]["phase_deg"] == pytest.approx(unwrapped_deg(delayed, [25.0])[0], abs=0.2)


def test_slip_ring_noise_blanks_and_order_change_little(tmp_path, rng):
    blocks = gyro_sweep(rng, [10.0, 40.0, 60.0], seconds=3.0)
    expected = reduced(tmp_path, blocks)
    hurt = {name: column.copy() for name, column in joined(blocks).items()}
    hurt["gyro_dps"][::29] += 40 * rng.standard_normal(len(hurt["gyro_dps"][::29]))
    hurt["gyro_dps"][11::301] = -1e200
    hurt["enc_deg"][5::37] = np.nan
    hurt["gyro_dps"][6::41] = np.inf
    hurt["t_s"][7::200] = np.nan
    hurt["f_Hz"][8::200] = np.nan
    found = reduced(tmp_path, [shuffled(hurt, rng)])
    assert found["flags"] == []
    assert found["rejected"]["outlier"] > 80
    assert found["rejected"]["missing"] > 100
    assert found["rejected"]["duplicate"] > 300
    for got, want in zip(found["points"], expected["points"], strict=True):
        assert got["gain"] == pytest.approx(want["gain"], abs=5 * want["u_gain"])
        assert got["phase_deg"] == pytest.approx(want["phase_deg"], abs=0.1)


def test_what_settles_is_passed_over(tmp_path, rng):
    blocks = gyro_sweep(rng, [10.0, 40.0])
    for block in blocks:
        block["t_s"] = block["t_s"] + 1000.0
        block["gyro_dps"] = block["gyro_dps"] + 20 * np.exp(-(block["t_s"] - 1000) / 0.05)
    result = reduced(tmp_path, blocks, settle_s=0.75)
    assert [point["gain"] for point in result["points"]] == pytest.approx([abs(UNIT(10)), abs(UNIT(40))], abs=2e-3)
    assert reduced(tmp_path, blocks, settle_s=5.0)["flags"] == ["10 Hz invalid", "40 Hz invalid", "invalid"]


def test_blocks_that_cannot_be_used_are_left_out(tmp_path, rng):
    blocks = gyro_sweep(rng, [10.0, 20.0, 30.0, 40.0, 50.0, 190.0])
    few, many, still, bare = blocks[1], blocks[2], blocks[3], blocks[4]
    few["gyro_dps"][: len(few["t_s"]) * 6 // 10] = np.nan
    many["gyro_dps"][::8] += 100
    still["enc_deg"] = 0 * still["enc_deg"] + 1e-4 * np.round(rng.standard_normal(len(still["t_s"])))
    blocks[4] = {name: column[:2] for name, column in bare.items()}
    blocks[5]["t_s"] = blocks[5]["t_s"] * 2  # 190 Hz at 200 samples a second
    result = reduced(tmp_path, blocks)
    assert [point["f_Hz"] for point in result["points"]] == [10]
    assert result["flags"] == [f"{f} Hz invalid" for f in (20, 30, 40, 50, 190)]


def test_two_visits_of_a_frequency_are_not_one(tmp_path, rng):
    blocks = gyro_sweep(rng, [10.0, 20.0, 20.0])
    blocks[2]["t_s"] = blocks[2]["t_s"] + 300
    blocks[0]["t_s"][3] = 1e40
    assert reduced(tmp_path, blocks)["flags"] == ["10 Hz invalid", "20 Hz invalid", "invalid"]


def test_a_record_without_a_usable_row_is_invalid(tmp_path):
    empty = dict.fromkeys(("f_Hz", "t_s", "enc_deg", "gyro_dps"), np.array([np.nan, np.nan]))
    result = reduced(tmp_path, [empty])
    assert (result["points"], result["flags"], result["bandwidth_status"]) == ([], ["invalid"], None)
    result = reduced(tmp_path, [{name: column[:0] for name, column in empty.items()}])
    assert result["flags"] == ["invalid"]


def test_a_dead_gyro_has_no_gain_and_no_decibel(tmp_path, rng):
    blocks = gyro_sweep(rng, [10.0, 20.0])
    for block in blocks:
        block["gyro_dps"] = 0 * block["gyro_dps"]
    result = reduced(tmp_path, blocks)
    assert [point["gain"] for point in result["points"]] == [0, 0]
    assert [point["gain_dB"] for point in result["points"]] == [None, None]
    assert result["bandwidth_status"] == "below_at_start"
    json.dumps(result, allow_nan=False)


def test_an_encoder_in_radians_shows_in_gain_and_amplitude(tmp_path, rng):
    blocks = gyro_sweep(rng, [10.0, 20.0])
    for block in blocks:
        block["enc_deg"] = np.radians(block["enc_deg"])
    result = reduced(tmp_path, blocks)
    assert result["points"][0]["gain"] == pytest.approx(np.degrees(abs(UNIT(10))), rel=2e-3)
    assert result["points"][0]["table_amp_dps"] == pytest.approx(np.radians(3), rel=2e-3)


def accelerometer_sweep(rng, frequencies_hz, *, response=UNIT, arm_m=ARM_M, lever_dps=60.0, **changed):
    interval_s = 1 / SLOW_HZ
    lever = {"amplitude_dps": lever_dps, "seconds": 5.0, "interval_s": interval_s} | changed
    rest = {"seconds": 1.5, "interval_s": interval_s} | changed
    return [
        accelerometer_block(rng, LEVER_HZ, response, arm_m=arm_m, **lever),
        *(accelerometer_block(rng, f, response, arm_m=arm_m, **rest) for f in frequencies_hz),
    ]


ACC = {"g_mps2": G_MPS2, "Ts_s": 1 / SLOW_HZ, "lever_f_Hz": LEVER_HZ}


def test_accelerometer_response_and_its_arms(tmp_path, rng):
    result = reduced(tmp_path, accelerometer_sweep(rng, FREQUENCIES_HZ), sub="acc_freq", **ACC)
    assert list(result) == [
        "method", "sub", "lever", "points", "bandwidth_Hz", "bandwidth_status", "bandwidth_crossings",
        "phase_at_bandwidth_deg", "flags", "notes", "rejected",
    ]  # fmt: skip
    lever = result["lever"]
    assert list(lever) == ["rxx_m", "rxy_m", "u_rxx_m", "u_rxy_m"]
    assert lever["rxx_m"] == pytest.approx(ARM_M[0], abs=max(4 * lever["u_rxx_m"], 1e-5))
    assert lever["rxy_m"] == pytest.approx(ARM_M[1], abs=max(4 * lever["u_rxy_m"], 1e-5))
    assert [point["f_Hz"] for point in result["points"]] == FREQUENCIES_HZ
    expected = [abs(UNIT(f) / UNIT(LEVER_HZ)) for f in FREQUENCIES_HZ]
    assert [point["gain"] for point in result["points"]] == pytest.approx(expected, abs=2e-3)
    phases = [point["phase_deg"] for point in result["points"]]
    assert phases == pytest.approx(unwrapped_deg(UNIT, FREQUENCIES_HZ), abs=0.2)
    assert result["bandwidth_Hz"] == pytest.approx(true_bandwidth_hz(UNIT), abs=0.1)
    assert result["flags"] == []


def test_printed_amplitudes_of_a_lever_of_50_mm(tmp_path):
    time_s = np.arange(2000) / 200
    phase = np.pi * time_s  # 0.5 Hz
    mean = np.sinc(0.5 / 200), np.sinc(1 / 200)  # over 5 ms, without the delay: it is in both columns
    for rate_dps, once_ug, twice_ug in ((3, 839, 7), (30, 8390, 699), (100, 27_970, 7766)):
        columns = {
            "f_Hz": np.full(2000, 0.5),
            "t_s": time_s,
            "dtheta_rad": np.radians(rate_dps) * mean[0] * np.sin(phase) / 200,
            "acc_g": -1e-6 * once_ug * mean[0] * np.cos(phase) + 1e-6 * twice_ug * mean[1] * np.cos(2 * phase),
        }
        result = reduced(tmp_path, [columns], sub="acc_freq", **(ACC | {"Ts_s": 1 / 200, "g_mps2": 9.80665}))
        assert result["lever"]["rxy_m"] == pytest.approx(0.05, rel=1e-3)
        assert result["lever"]["rxx_m"] == pytest.approx(0.05, rel=0.07 if rate_dps == 3 else 1e-3)


def test_two_arms_that_are_short_make_it_invalid(tmp_path, rng):
    blocks = accelerometer_sweep(rng, [10.0, 20.0], arm_m=(0.003, -0.004))
    result = reduced(tmp_path, blocks, sub="acc_freq", **ACC)
    assert result["flags"] == ["invalid"]
    assert "shorter than 5 mm" in result["notes"][-1]
    assert result["lever"]["rxy_m"] == pytest.approx(-0.004, abs=2e-5)
    assert (result["points"], result["bandwidth_status"], result["bandwidth_Hz"]) == ([], None, None)


def test_a_short_y_alone_is_told(tmp_path, rng):
    result = reduced(tmp_path, accelerometer_sweep(rng, [10.0], arm_m=(0.05, 0.004)), sub="acc_freq", **ACC)
    assert result["flags"] == []
    assert "shorter than 5 mm" in result["notes"][-1]
    assert result["points"][0]["gain"] == pytest.approx(abs(UNIT(10) / UNIT(LEVER_HZ)), rel=0.02)


def test_increments_in_degrees_are_arms_that_are_too_short(tmp_path, rng):
    blocks = accelerometer_sweep(rng, [10.0])
    for block in blocks:
        block["dtheta_rad"] = np.degrees(block["dtheta_rad"])
    assert reduced(tmp_path, blocks, sub="acc_freq", **ACC)["flags"] == ["invalid"]


@pytest.mark.parametrize("frequencies_hz", [[], [10.0]])
def test_without_the_lever_frequency_there_is_no_response(tmp_path, rng, frequencies_hz):
    blocks = accelerometer_sweep(rng, frequencies_hz)
    lever = {"lever_f_Hz": 0.6} if frequencies_hz else {}
    result = reduced(tmp_path, blocks if frequencies_hz else [blocks[0]], sub="acc_freq", **(ACC | lever))
    if frequencies_hz:
        assert result["flags"] == ["0.6 Hz invalid", "invalid"]
        assert result["lever"] == dict.fromkeys(("rxx_m", "rxy_m", "u_rxx_m", "u_rxy_m"))
    else:
        assert result["flags"] == ["invalid"]
        assert result["lever"]["rxy_m"] == pytest.approx(ARM_M[1], rel=1e-3)
    assert result["points"] == []


def test_blocks_of_an_accelerometer_that_cannot_be_used(tmp_path, rng):
    blocks = accelerometer_sweep(rng, [10.0, 20.0, 30.0])
    blocks[1]["dtheta_rad"] = 0 * blocks[1]["dtheta_rad"]
    blocks[2]["acc_g"][::7] += 1
    result = reduced(tmp_path, blocks, sub="acc_freq", **ACC)
    assert result["flags"] == ["10 Hz invalid", "20 Hz invalid"]
    assert [point["f_Hz"] for point in result["points"]] == [30]
    blocks[0]["acc_g"][::7] += 1
    result = reduced(tmp_path, blocks, sub="acc_freq", **ACC)
    assert result["flags"] == ["0.5 Hz invalid", "invalid"]


def test_a_second_harmonic_at_half_the_sample_rate_is_left_out(tmp_path, rng):
    blocks = accelerometer_sweep(rng, [50.0], interval_s=1 / 200, seconds=5.0)
    result = reduced(tmp_path, blocks, sub="acc_freq", **(ACC | {"Ts_s": 1 / 200}))
    assert result["flags"] == []
    assert result["points"][0]["gain"] == pytest.approx(abs(UNIT(50) / UNIT(LEVER_HZ)), abs=4e-3)


def test_blanks_and_glitches_of_an_accelerometer_sweep(tmp_path, rng):
    columns = {name: column.copy() for name, column in joined(accelerometer_sweep(rng, [10.0, 40.0])).items()}
    columns["dtheta_rad"][5::40] = np.nan
    columns["acc_g"][7::31] += rng.standard_normal(len(columns["acc_g"][7::31]))
    columns["dtheta_rad"][8::97] += 0.1
    result = reduced(tmp_path, [shuffled(columns, rng)], sub="acc_freq", **ACC)
    assert result["flags"] == []
    expected = [abs(UNIT(f) / UNIT(LEVER_HZ)) for f in (10, 40)]
    assert [point["gain"] for point in result["points"]] == pytest.approx(expected, abs=4e-3)


def test_two_samples_keep_the_order_and_the_gaps(tmp_path):
    columns = {"dtheta1_rad": [0.001, None, 0.002, 1e300], "dtheta2_rad": [0.003, 0.1, 0.002, 1.0]}
    result = reduce_case(write_case(tmp_path, "two_sample", {"h_s": 0.002, "rx_m": 0.05, "ry_m": -0.03}, columns))
    assert list(result) == ["method", "sub", "dvx_mps", "dvy_mps", "flags", "notes", "rejected"]
    assert [value is None for value in result["dvx_mps"]] == [False, True, False, True]
    # ω = 2 rad/s, no dω/dt: -ω² r over 2 ms.
    assert result["dvx_mps"][2] == pytest.approx(-4 * 0.05 * 0.002)
    assert result["dvy_mps"][2] == pytest.approx(-4 * -0.03 * 0.002)
    assert result["rejected"] == {"missing": 2}


def rms(values):
    return np.sqrt(np.mean(np.square(values), axis=0))


def test_uncertainties_of_gyro_gains_are_as_large_as_the_errors():
    rng = np.random.default_rng(11)
    errors = []
    for _ in range(200):
        columns = joined(gyro_sweep(rng, [60.0], sample_hz=301.3, seconds=1.3))
        record = TableRecord(*(columns[name] for name in ("f_Hz", "t_s", "enc_deg", "gyro_dps")))
        point = gyro_response(record).points[0]
        errors.append((point.gain - abs(UNIT(60))) / point.u_gain)
    assert rms(errors) == pytest.approx(1, abs=0.15)


def test_uncertainties_of_arms_and_gains_are_as_large_as_the_errors():
    rng = np.random.default_rng(12)
    settings = AccelerometerSweep(G_MPS2, 1 / 101.3, LEVER_HZ)
    expected = abs(UNIT(10) / UNIT(LEVER_HZ))
    # At 1 Hz, where x is found, the unit has a gain of its own.
    x_m, y_m = ARM_M[0] * abs(UNIT(2 * LEVER_HZ)), ARM_M[1] * abs(UNIT(LEVER_HZ))
    errors = []
    for _ in range(200):
        columns = joined(accelerometer_sweep(rng, [10.0], interval_s=1 / 101.3, noise_g=2e-4))
        record = TableRecord(*(columns[name] for name in ("f_Hz", "t_s", "dtheta_rad", "acc_g")))
        arm, found = accelerometer_response(record, settings)
        point = found.points[0]
        errors.append(
            [(point.gain - expected) / point.u_gain, (arm.x_m - x_m) / arm.u_x_m, (arm.y_m - y_m) / arm.u_y_m]
        )
    assert rms(errors) == pytest.approx([1, 1, 1], abs=0.15)
