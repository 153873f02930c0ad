"""From windows to readings: what is missing, exchanged, turned otherwise, or measured in another mount."""

import dataclasses

import numpy as np
import pytest

from bench.config.bench import load_bench
from bench.methods.imu.method import ImuCalibrationSettings
from bench.methods.imu.reduction.attitudes import NAMES, SPECIFIC_FORCE_G, earth_rate_dps
from bench.methods.imu.reduction.run import reduce
from bench.methods.imu.reduction.windows import ACCELEROMETERS, GYROS, visits
from bench.metrology.acquisition import Acquisition, ClockReading, Mount, Turned, Window
from bench.metrology.bench_uncertainty import AxisRecord, BenchRecord
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.report.flag_words import flag_in_words
from bench.sequence.steps.orienting import Orient, Pose, Turning
from tests.support.flags import flag_of, texts
from tests.support.runs import ROOT

BENCH = load_bench(ROOT / "config/imu.yaml").bench
TWO = load_bench(ROOT / "config/imu_two_axis.yaml").bench
CHANNELS_OF = (*ACCELEROMETERS, *GYROS)
CHANNELS = {name: name for name in CHANNELS_OF}
UNIT = UnitUnderTest("a", "S", "", 0.0, "t", channels=CHANNELS, gyro_temperature="t")
SETTINGS = ImuCalibrationSettings.model_validate({}).model_dump()
BIAS_G = 1e-3  # far from the dead band of a converter
K1, KG, LATITUDE, TURN_DPS = 11_000.0, 4_000.0, 34.25, (10.0, -10.0, 20.0, -20.0, 30.0, -30.0)


def record(bench):
    axes = {role: AxisRecord(points) for role, points in bench.axes.items()}
    return BenchRecord(9.8, 0, axes, bench.fixture.x, bench.fixture.z, 0, 0, 0, {}, latitude_deg=LATITUDE)


def acquired(step, group, bench, mount, name, pps, turned=None):
    windows = {channel: Window(float(rate), 10.0, 10.0, ()) for channel, rate in zip(CHANNELS_OF, pps, strict=True)}
    angles = Turning(bench).targets_deg(Orient(orient=name).attitude, Pose(mount=mount.name or None))
    at_c = np.full(3, 20.0 if "hot" not in group else 50.0)
    return Acquisition(
        step, group, {}, 0.0, 10.0, angles, 0.0, float(at_c[0]), {}, {"t": at_c}, {"t": np.arange(3.0)}, mount,
        turned=turned, windows=windows,
    )  # fmt: skip


def block(bench, group, axes, mount=Mount(), rng=None):  # noqa: B008  frozen
    """All windows of some axes at one set point."""
    rng = rng or np.random.default_rng(1)
    found = []
    for axis in axes:
        for index in range(8 * "xyz".index(axis), 8 * "xyz".index(axis) + 8):
            still = [K1 * (SPECIFIC_FORCE_G[index] + BIAS_G), KG * (1e-4 + earth_rate_dps(LATITUDE)[index])]
            pps = np.concatenate(still) + rng.normal(0, 0.02, 6)
            found.append(acquired(f"{group}/{NAMES[index]}", group, bench, mount, NAMES[index], pps))
        for rate in TURN_DPS:
            pps = np.zeros(6)
            pps[3 + "xyz".index(axis)] = KG * rate + rng.normal(0, 0.02)
            turned = Turned("outer", rate, 0.0, 0.0, 10.0, 10 * rate)
            up = f"A{axis}1"
            found.append(acquired(f"{group}/{axis}/{rate}", group, bench, mount, up, pps, turned))
    return found


def result(acquisitions, bench=BENCH):
    (found,) = reduce(RunData("imu", (UNIT,), tuple(acquisitions), record(bench)), SETTINGS)
    return found


def test_all_is_found_of_a_unit_without_errors():
    found = result(block(BENCH, "s/hot", "xyz") + block(BENCH, "s/cold", "xyz"))
    assert (found.left_out, texts(found.flags)) == ((), ())
    values = {(each.quantity, each.at["axis"]): each.value for each in found.findings if "visit" in each.at}
    assert values["K1", "y"] == pytest.approx(K1, rel=1e-5)
    assert values["KG", "z"] == pytest.approx(KG, rel=1e-5)
    assert values["D0", "x"] == pytest.approx(1e-4, abs=1e-5)
    assert len(found.compensations) == 6


def test_a_missing_attitude_leaves_its_axis_out_and_is_told_in_words():
    some = [each for each in block(BENCH, "s/hot", "xyz") if not each.step.endswith("Ay3")]
    found = result(some)
    assert found.left_out == ("hot/y",)
    reported = flag_in_words(flag_of(found.flags, "T=50:missing_position:Ay3"))
    assert reported == "Set point 50 °C: attitude Ay3 has no usable reading; its axis is left out there."


def test_missing_rates_leave_their_axis_out():
    some = [each for each in block(BENCH, "s/hot", "xyz") if each.step != "s/hot/z/30.0"]
    found = result(some)
    assert found.left_out == ("hot/z",)
    assert "T=50:missing_rate:z" in texts(found.flags)


def test_an_attitude_that_reads_otherwise_is_doubted():
    some = block(BENCH, "s/hot", "xyz")
    wrong = {name: window._replace(mean=0.0) for name, window in some[2].windows.items()}
    found = result([*some[:2], dataclasses.replace(some[2], windows=wrong), *some[3:]])
    assert "T=50:attitude_inconsistent:Ax3" in texts(found.flags)
    assert found.left_out == ("hot/x",)


def test_exchanged_headings_are_seen_by_the_gyros():
    some = block(BENCH, "s/hot", "xyz")
    some[0], some[2] = (dataclasses.replace(a, windows=b.windows) for a, b in ((some[0], some[2]), (some[2], some[0])))
    assert any("saw north elsewhere than scheduled: Ax1, Ax3" in flag for flag in texts(result(some).flags))


def test_of_a_repeated_attitude_the_last_counts():
    some = block(BENCH, "s/hot", "xyz")
    wrong = {name: each._replace(mean=9e9) for name, each in some[0].windows.items()}
    bad = dataclasses.replace(some[0], step="s/hot/Ax1~1", windows=wrong)
    assert result([bad, *some]).left_out == ()


def test_a_table_that_did_not_turn_as_told_is_left_out():
    some = block(BENCH, "s/hot", "xyz")
    slow = dataclasses.replace(some[-1], turned=some[-1].turned._replace(to_deg=-30.0))
    found = result([*some[:-1], slow])
    assert "T=50:missing_rate:z" in texts(found.flags)


def test_a_second_mounting_completes_the_set_points_that_lack_its_attitudes():
    along, across = (Mount(name, each.angle, each.roll, each.clock) for name, each in TWO.fixture.mounts.items())
    first = block(TWO, "s/hot", "xz", along) + block(TWO, "s/cold", "xz", along)
    second = block(TWO, "s/hot#2", "y", across) + block(TWO, "s/cold#2", "y", across)
    found = result(first + second, TWO)
    assert (found.left_out, texts(found.flags)) == ((), ())
    assert len(visits(RunData("imu", (UNIT,), tuple(first + second), record(TWO)), UNIT)) == 2


def test_a_second_visit_in_the_same_mount_is_one_of_its_own():
    found = result(block(BENCH, "s/cold", "xyz") + block(BENCH, "s/cold#2", "xyz", rng=np.random.default_rng(2)))
    repeated = [each for each in found.findings if each.quantity == "K0/repeatability"]
    assert len(repeated) == 3
    assert all(each.value < 4 * each.u for each in repeated)
    assert found.compensations == ()  # one temperature makes no table


def test_a_window_in_no_attitude_is_told():
    some = block(BENCH, "s/hot", "xyz")
    odd = dataclasses.replace(some[0], angles_deg={**some[0].angles_deg, "inner": 33.0})
    found = result([odd, *some[1:]])
    assert "none of the 24 attitudes" in flag_in_words(flag_of(found.flags, "s/hot/Ax1: no_attitude"))


def test_a_latch_that_one_channel_lacks_changes_no_other():
    """Its window is shorter then; a mean stays a mean, whatever the window of another."""
    some = block(BENCH, "s/hot", "xyz")
    short = {**some[0].windows, "gyro_z": some[0].windows["gyro_z"]._replace(span_s=9.9)}
    whole = {each.id: each.value for each in result(some).findings}
    found = result([dataclasses.replace(some[0], windows=short), *some[1:]])
    for each in found.findings:
        assert each.value == pytest.approx(whole[each.id], rel=1e-9, abs=1e-12)


# Codes


SENDS = dataclasses.replace(UNIT, channel_units=dict.fromkeys(CHANNELS_OF, "code"))


def sent(acquisitions, **changes):
    """The same windows as means of samples."""
    windows = [{name: each._replace(**changes) for name, each in one.windows.items()} for one in acquisitions]
    return [dataclasses.replace(one, windows=each) for one, each in zip(acquisitions, windows, strict=True)]


def result_of_codes(acquisitions, **bench):
    known = dataclasses.replace(record(BENCH), **bench)
    (found,) = reduce(RunData("imu", (SENDS,), tuple(acquisitions), known), SETTINGS)
    return {each.quantity: each for each in found.findings if each.at["axis"] == "y" and each.at.get("visit") == 0}


def lines(finding):
    return {line.source: line.u for line in finding.budget}


def test_scale_factors_of_codes_are_in_codes():
    found = result_of_codes(sent(block(BENCH, "s/hot", "xyz")))
    assert {name: found[name].unit for name in ("K0", "K1", "K1_si", "D0", "KG")} == {
        "K0": "g", "K1": "code/g", "K1_si": "code/(m/s²)", "D0": "°/s", "KG": "code/(°/s)",
    }  # fmt: skip
    assert found["KG"].value == pytest.approx(KG, rel=1e-5)


def test_the_clock_of_the_computer_is_in_the_scale_of_gyros_alone():
    found = result_of_codes(sent(block(BENCH, "s/hot", "xyz")), host_clock_u=1e-3, time_base_u=1e-3)
    assert lines(found["KG"])["computer: clock"] == pytest.approx(1e-3 * KG, rel=1e-4)
    for name in ("K0", "K1", "misalignment", "g_sensitivity", "gyro_misalignment"):
        assert not {"computer: clock", "counter: time base"} & lines(found[name]).keys()
    counted = {
        each.quantity: each
        for each in reduce(
            RunData(
                "imu", (UNIT,), tuple(block(BENCH, "s/hot", "xyz")),
                dataclasses.replace(record(BENCH), host_clock_u=1e-3, time_base_u=1e-3),
            ),
            SETTINGS,
        )[0].findings
    }  # fmt: skip
    assert "counter: time base" in lines(counted["K1"])
    assert not any("computer: clock" in lines(each) for each in counted.values())


def with_clocks(acquisitions, clock, begun_anew_at=None, wraps_s=4294.967296):
    """Windows a minute apart, of a counter whose clock wraps, by default after 71 min; readings scatter by 16 ms."""
    late_s, found = np.random.default_rng(2).uniform(0.0, 0.016, len(acquisitions)), []
    for number, each in enumerate(acquisitions):
        since_s = 60.0 * (number - (begun_anew_at or 0) if number >= (begun_anew_at or 0) else number)
        reading = ClockReading((4000.0 + since_s / clock) % wraps_s, wraps_s, 60.0 * number + late_s[number])
        windows = {name: window._replace(clock=reading) for name, window in each.windows.items()}
        found.append(dataclasses.replace(each, windows=windows))
    return found


def test_the_clock_of_the_counter_is_compared_over_the_whole_visit():
    """By 16 ms in a window of 10 s it would be known to 1600 ppm; the clock of the counter errs by less."""
    acquisitions = with_clocks(block(BENCH, "s/hot", "xyz"), 1 + 80e-6)
    (visit,) = visits(RunData("imu", (UNIT,), tuple(acquisitions), record(BENCH)), UNIT)
    assert len(visit.turning) == 18
    errors = [each.rate_dps / each.command_dps / (1 + 80e-6) - 1 for each in visit.turning]
    assert np.abs(errors).max() < 5e-6


def test_a_clock_that_wraps_between_windows_is_followed():
    acquisitions = with_clocks(block(BENCH, "s/hot", "xyz"), 1 + 80e-6, wraps_s=2**24 * 1e-6)
    (visit,) = visits(RunData("imu", (UNIT,), tuple(acquisitions), record(BENCH)), UNIT)
    assert np.abs([each.rate_dps / each.command_dps / (1 + 80e-6) - 1 for each in visit.turning]).max() < 5e-6


@pytest.mark.parametrize("more", [{"begun_anew_at": 20}, {"wraps_s": 2**16 * 1e-6}])
def test_of_a_counter_that_begins_anew_or_wraps_soon_each_window_counts_for_itself(more):
    acquisitions = with_clocks(block(BENCH, "s/hot", "xyz"), 1 + 80e-6, **more)
    (visit,) = visits(RunData("imu", (UNIT,), tuple(acquisitions), record(BENCH)), UNIT)
    assert {each.rate_dps / each.command_dps for each in visit.turning} == {1.0}


def test_steps_of_codes_are_alike_with_the_axis_up_and_with_it_down():
    """Eight readings fall onto two steps; their mean knows no more than two of them."""
    found = result_of_codes(sent(block(BENCH, "s/hot", "xyz"), quantisation_u=3.0))
    assert lines(found["K0"])["acc_y: steps of the codes"] == pytest.approx(3 / 2**0.5 / K1, rel=1e-3)
    assert lines(found["K1"])["acc_y: steps of the codes"] == pytest.approx(3 / 2**0.5, rel=1e-3)
    assert lines(found["D0"])["gyro_y: steps of the codes"] == pytest.approx(3 / 2**0.5 / KG, rel=1e-3)
    rates = np.array(TURN_DPS)
    assert lines(found["KG"])["gyro_y: steps of the codes"] == pytest.approx(3 / np.sqrt(np.sum(rates**2)), rel=1e-3)


def test_samples_scatter_no_less_than_they_tell_themselves():
    quiet, noisy = (result_of_codes(sent(block(BENCH, "s/hot", "xyz"), single_u=u)) for u in (0.0, 5.0))
    name = "readings: scatter pooled over the run"
    assert lines(noisy["K1"])[name] == pytest.approx(5.0 / 8**0.5, rel=1e-3)
    assert lines(quiet["K1"])[name] < 0.02
