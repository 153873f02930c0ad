"""Sensors of an inertial unit on a rate table: which are measured in a mounting, by which data, and what is noticed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.methods.rate_table.method import ACCELEROMETER_RESPONSE, GYRO_RANGE, GYRO_RESPONSE
from bench.methods.rate_table.reduction import response
from bench.methods.rate_table.reduction.range import reduce_gyro as reduce_range
from bench.metrology.acquisition import Codes, Mount
from bench.metrology.run_data import UnitUnderTest
from bench.report.flag_words import flag_in_words
from tests.support.flags import texts
from tests.support.table_runs import BENCH, at_rate, at_rest, data, swinging

PER_DEG, PER_G = 4000.0, 1e4
NAMES = tuple(f"{kind}_{axis}" for kind in ("acc", "gyro") for axis in "xyz")
CHANNELS = {name: name for name in NAMES}
UNIT = UnitUnderTest(
    "a", "SN", "", 0.0, "warm", channels=CHANNELS, gyro_temperature="warm", nominal_per_g=PER_G,
    arm_m=(0.3, 0.2, 0.0), arm_u_m=0.01,
)  # fmt: skip
Z_UP, Y_UP, X_UP = Mount("z_up"), Mount("y_up", roll_deg=90.0), Mount("x_up", angle_deg=90.0)
ARMS_M = {"acc_x": (0.31, 0.19), "acc_y": (0.19, -0.32)}  # with z up, each in the frame with its input axis along x
HZ = 20.37


def together(mount=Z_UP, **by_channel):
    """One latch of all channels, from acquisitions of one channel each."""
    first = next(iter(by_channel.values()))
    counts = {name: each.counts["x"] for name, each in by_channel.items()}
    return replace(first, counts=counts, mount=mount)


def swing(frequency_hz=HZ, amplitude_dps=50.0, mount=Z_UP, up="z", scale=1.0):
    """A swing about the axis that is up: its gyro and two accelerometers sense it, the third senses gravity."""
    a_rps, omega = np.radians(amplitude_dps), 2 * np.pi * frequency_hz

    def gyro(phase, time_s):
        return scale * amplitude_dps / omega * PER_DEG * np.sin(phase) + 20 * time_s

    def level(arms_m):
        x_m, y_m = arms_m

        def charge(phase, time_s):
            tangential = -y_m * a_rps * np.cos(phase)
            centripetal = -x_m * a_rps**2 / 2 * (time_s + np.sin(2 * phase) / (2 * omega))
            return PER_G / BENCH.gravity_mps2 * (tangential + centripetal) + 50 * time_s

        return charge

    charges = {name: level(ARMS_M.get(name, (0.3, 0.2))) for name in NAMES[:3]}
    charges |= dict.fromkeys(NAMES[3:], lambda _, time_s: 20 * time_s)
    charges |= {f"acc_{up}": lambda _, time_s: PER_G * time_s, f"gyro_{up}": gyro}
    made = {name: swinging(frequency_hz, charge, amplitude_dps) for name, charge in charges.items()}
    return together(mount, **made)


def reduced(reduce, method, *acquisitions, **settings):
    upright = replace(BENCH, axes={"table": BENCH.axes["table"]._replace(points=(0.0, 0.0, 1.0))})
    chosen = method.settings.model_validate(settings).model_dump()
    (found,) = reduce(data(*acquisitions, unit=UNIT, bench=upright), chosen)
    return found


def gyro(*acquisitions, **settings):
    return reduced(response.reduce_gyro, GYRO_RESPONSE, *acquisitions, **{"scale": f"{PER_DEG} pulse/°"} | settings)


def accelerometers(*acquisitions, **settings):
    given = {"scale": f"{PER_G} pulse/s/g", "lever_frequency": "1 Hz"} | settings
    return reduced(response.reduce_accelerometer, ACCELEROMETER_RESPONSE, *acquisitions, **given)


def sensors_of(found):
    return list(dict.fromkeys((each.at["mount"], each.at["sensor"]) for each in found.findings))


def test_of_one_swing_the_gyro_along_the_axis_and_the_accelerometers_across_it_are_found():
    swings = (swing(1.0, 100.0), swing())
    of_gyro, of_level = gyro(*swings, lever_frequency="1 Hz"), accelerometers(*swings)
    assert sensors_of(of_gyro) == [("z_up", "gyro_z")]
    assert sensors_of(of_level) == [("z_up", "acc_x"), ("z_up", "acc_y")]
    assert texts(of_gyro.flags + of_level.flags) == ("bandwidth_not_reached",) * 2
    found = {each.id: each for each in of_gyro.findings + of_level.findings}
    for sensor in ("gyro_z", "acc_x", "acc_y"):
        gain = found[f"range/a/z_up/{sensor}/gain@0"]
        assert abs(gain.value - 1) < 3 * gain.u < 5e-3
    for sensor, arms_m in ARMS_M.items():
        for axis, arm_m in zip("xy", arms_m, strict=True):
            assert found[f"range/a/z_up/{sensor}/lever_arm/{axis}"].value == pytest.approx(arm_m, abs=3e-4)
    assert (of_gyro.place, of_gyro.uut) == ("a", "SN")


def test_every_mounting_has_its_sensors_and_an_oscillation_for_the_arms_is_no_point_of_a_gyro():
    swings = [swing(hz, 50.0, mount, up) for mount, up in ((Z_UP, "z"), (Y_UP, "y"), (X_UP, "x")) for hz in (1.0, HZ)]
    found = gyro(*swings, lever_frequency="1 Hz")
    assert sensors_of(found) == [("z_up", "gyro_z"), ("y_up", "gyro_y"), ("x_up", "gyro_x")]
    assert {each.at["frequency_hz"] for each in found.findings if each.quantity == "gain"} == {HZ}
    assert "mounting_unlike_sequence" not in str(texts(found.flags))


def test_each_sensor_has_the_scale_factor_that_is_stated_for_it():
    own = {"gyro_z": "4000 pulse/°", "gyro_x": "8000 pulse/°", "gyro_y": "8000 pulse/°"}
    for scale, gain in ((own, 1.0), (own | {"gyro_z": "-4000 pulse/°"}, 1.0), ("8000 pulse/°", 0.5)):
        swung = swing(scale=-1.0 if "-4000" in str(scale) else 1.0)
        found = gyro(swung, scale=scale)
        (value,) = (each.value for each in found.findings if each.quantity == "gain")
        assert value == pytest.approx(gain, rel=2e-3)


def test_the_range_of_a_gyro_is_found_at_rest_and_at_rates():
    def all_at(make, up_pps):
        made = {name: make(20.0) for name in NAMES} | {"acc_z": make(PER_G), "gyro_z": make(up_pps)}
        return together(**made)

    rates = [
        all_at(lambda pps, w=w: at_rate(w, pps), w * PER_DEG * 1.001 + 20.0) for w in (100.0, -100.0, 200.0, -200.0)
    ]
    rests = [all_at(lambda pps, at=at: at_rest(pps, at), 20.0) for at in (0.0, 90.0, 180.0, 270.0)]
    rests = [replace(each, angles_deg={"table": 90.0 * n}) for n, each in enumerate(rests)]
    given = {"scale": f"{PER_DEG} pulse/°", "full_scale": "200 °/s", "clip": "400 °/s"}
    found = reduced(reduce_range, GYRO_RANGE, *rests, *rates, **given)
    errors = [each.value for each in found.findings if each.quantity == "rate_error/relative"]
    assert errors == pytest.approx([1e-3, -1e-3, 1e-3, -1e-3], abs=2e-5)
    (known,) = found.compensations
    assert known.channel == "gyro_z"


# Samples

SENDS = replace(UNIT, channel_units=dict.fromkeys(NAMES, "code"))


def as_sent(acquisition, latched="acc_x", averaged=True, late=0):
    """The same with samples, each the mean over the time before it, in place of the counts; the encoder may be late."""
    (encoder,) = acquisition.positions.values()
    codes = {}
    for name, counts in acquisition.counts.items():
        pulses = np.diff((counts.positive - counts.negative) % 2**24)
        steps_s = np.diff(counts.tick) % 2**counts.tick_bits * counts.tick_period_s
        rate = ((pulses + 2**23) % 2**24 - 2**23) / steps_s
        codes[name] = Codes(
            sequence=counts.sequence[1:], tick=counts.tick[1:], values=rate, host_s=counts.host_s[1:],
            tick_bits=counts.tick_bits, tick_period_s=counts.tick_period_s, step=1.0, lost=0, dropped=0, invalid=0,
            averaged=averaged,
        )  # fmt: skip
    rows = slice(1 + late, None)
    size = len(encoder.position) - 1 - late
    encoder = replace(
        encoder, sequence=encoder.sequence[1 : 1 + size], tick=encoder.tick[1 : 1 + size],
        position=encoder.position[rows], host_s=encoder.host_s[1 : 1 + size], channel=latched,
    )  # fmt: skip
    return replace(acquisition, counts={}, codes=codes, positions={"table": encoder})


def of_codes(reduce, method, *acquisitions, unit=SENDS, **settings):
    upright = replace(BENCH, axes={"table": BENCH.axes["table"]._replace(points=(0.0, 0.0, 1.0))})
    chosen = method.settings.model_validate(settings).model_dump()
    (found,) = reduce(data(*acquisitions, unit=unit, bench=upright), chosen)
    return found


LEVEL = (response.reduce_accelerometer, ACCELEROMETER_RESPONSE)
PER_G_SENT = {"scale": f"{PER_G} code/g", "lever_frequency": "1 Hz"}


@pytest.mark.parametrize("latched", ["acc_x", "gyro_y"])
def test_sensors_that_send_samples_share_the_encoder_latched_with_one_of_them(latched):
    swings = [as_sent(each, latched) for each in (swing(1.0, 100.0), swing())]
    of_gyro = of_codes(response.reduce_gyro, GYRO_RESPONSE, *swings, scale=f"{PER_DEG} code/(°/s)",
                       lever_frequency="1 Hz")  # fmt: skip
    of_level = of_codes(*LEVEL, *swings, **PER_G_SENT)
    assert sensors_of(of_gyro) == [("z_up", "gyro_z")]
    assert sensors_of(of_level) == [("z_up", "acc_x"), ("z_up", "acc_y")]
    assert texts(of_gyro.flags + of_level.flags) == ("bandwidth_not_reached",) * 2
    found = {each.id: each for each in of_gyro.findings + of_level.findings}
    for sensor in ("gyro_z", "acc_x", "acc_y"):
        gain, phase = (found[f"range/a/z_up/{sensor}/{name}@0"] for name in ("gain", "phase"))
        assert abs(gain.value - 1) < max(3 * gain.u, 2e-3)
        assert abs(phase.value) < 3 * phase.u
    for sensor, arms_m in ARMS_M.items():
        for axis, arm_m in zip("xy", arms_m, strict=True):
            assert found[f"range/a/z_up/{sensor}/lever_arm/{axis}"].value == pytest.approx(arm_m, abs=1e-3)


def test_an_encoder_that_is_a_sample_late_is_a_phase_error_of_many_u():
    """1.024 ms at 20.37 Hz: 7.5°."""
    late = of_codes(*LEVEL, as_sent(swing(1.0, 100.0), late=1), as_sent(swing(), late=1), **PER_G_SENT)
    phases = [each for each in late.findings if each.quantity == "phase"]
    assert len(phases) == 2
    assert all(abs(each.value) > 10 * each.u for each in phases)
    assert [round(abs(each.value), 1) for each in phases] == [7.5, 7.5]


def test_samples_of_exchanged_accelerometers_are_noticed_by_their_arms():
    exchanged = replace(SENDS, channels=CHANNELS | {"acc_x": "acc_y", "acc_y": "acc_x"})
    swings = [as_sent(swing(1.0, 100.0)), as_sent(swing())]
    found = of_codes(*LEVEL, *swings, unit=exchanged, **PER_G_SENT)
    assert "lever_arm_unlike_bench_file" in str(texts(found.flags))
    right = of_codes(*LEVEL, *swings, **PER_G_SENT)
    assert "lever_arm_unlike_bench_file" not in str(texts(right.flags))


def test_samples_in_another_mounting_than_said_are_noticed():
    found = of_codes(*LEVEL, as_sent(swing(1.0, 100.0, mount=Y_UP)), as_sent(swing(mount=Y_UP)), **PER_G_SENT)
    assert "mounting_unlike_sequence" in str(texts(found.flags))
    assert found.verdict == "INCOMPLETE"


def test_samples_of_another_swing_than_the_encoder_are_no_result():
    slow, one = as_sent(swing(1.0, 100.0)), as_sent(swing())
    wrong = {name: replace(each, tick=each.tick + 7) for name, each in one.codes.items() if name == "acc_y"}
    found = of_codes(*LEVEL, slow, replace(one, codes=one.codes | wrong), **PER_G_SENT)
    assert "not_one_swing" in str(texts(found.flags))
    assert found.verdict == "INCOMPLETE"


# What must be noticed


def test_two_kinds_of_sensors_from_different_swings_are_no_result():
    slow, one, other = swing(1.0, 100.0), swing(), swing()
    for taken in (
        {name: replace(each, sequence=each.sequence + 5000) for name, each in other.counts.items()},
        {name: replace(each, tick=each.tick + 5_000_000) for name, each in other.counts.items()},
    ):
        mixed = replace(one, counts={**one.counts, **{name: taken[name] for name in NAMES[:3]}})
        for reduce in (gyro, accelerometers):
            found = reduce(slow, mixed)
            assert "steps/n=1/acquire: not_one_swing" in texts(found.flags)
            assert found.verdict == "INCOMPLETE"
            assert [each for each in found.findings if each.at.get("frequency_hz") == HZ] == []


def test_a_latch_lost_in_one_channel_is_not_another_swing():
    one = swing()
    short = one.counts["acc_x"]
    kept = np.arange(len(short.sequence)) != 700
    lost = replace(
        short, sequence=short.sequence[kept], tick=short.tick[kept], positive=short.positive[kept],
        negative=short.negative[kept], host_s=short.host_s[kept],
    )  # fmt: skip
    found = accelerometers(swing(1.0, 100.0), replace(one, counts={**one.counts, "acc_x": lost}))
    assert texts(found.flags) == ("bandwidth_not_reached",)


@pytest.mark.parametrize(("said", "done"), [(Y_UP, "x"), (Z_UP, "y"), (X_UP, "z")])
def test_another_axis_up_than_said_is_noticed(said, done):
    for reduce in (gyro, accelerometers):
        found = reduce(swing(1.0, 100.0, said, done), swing(mount=said, up=done))
        (flag,) = [each for each in found.flags if each.code == "mounting_unlike_sequence"]
        assert found.verdict == "INCOMPLETE"
        assert "not mounted as the sequence says" in flag_in_words(flag)


def test_a_unit_upside_down_is_noticed():
    upside_down = swing()
    acc_z = upside_down.counts["acc_z"]
    turned = {**upside_down.counts, "acc_z": replace(acc_z, positive=acc_z.negative, negative=acc_z.positive)}
    found = gyro(replace(upside_down, counts=turned))
    assert [each.code for each in found.flags if each.at] == ["mounting_unlike_sequence"]


def test_a_mounting_without_a_suitable_sensor_is_left_out():
    found = gyro(swing(mount=Mount("askew", roll_deg=45.0)))
    assert found.findings == ()
    assert "askew: no_sensor" in texts(found.flags)
    assert found.verdict == "INCOMPLETE"
