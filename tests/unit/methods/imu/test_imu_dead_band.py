"""Level accelerometers whose converters are in their dead band, or near it."""

import dataclasses

import numpy as np
import pytest

from bench.methods.imu.reduction.attitudes import NAMES, SPECIFIC_FORCE_G
from bench.methods.imu.reduction.closure import Sensitivity, closure_findings
from bench.methods.imu.reduction.run import reduce
from bench.metrology.run_data import RunData
from bench.report.flag_words import flag_in_words
from tests.support.flags import texts
from tests.unit.methods.imu.test_imu_closure import looked
from tests.unit.methods.imu.test_imu_windows import BENCH, BIAS_G, K1, SETTINGS, UNIT, block, record

PULSE_PPS = 0.1  # one in a window of 10 s
DEAD_BAND_G = SETTINGS["dead_band_g"]


def skewed(toward_y_g):
    """Windows in which z sees so much of y; within 20 µg of zero only every other one has a pulse."""
    found = []
    for each in block(BENCH, "s/hot", "xyz"):
        windows = dict(each.windows)
        name = each.step.rpartition("/")[2]
        if name in NAMES:
            pps = K1 * (BIAS_G + toward_y_g * SPECIFIC_FORCE_G[NAMES.index(name), 1])
            level = windows["acc_z"].mean + K1 * toward_y_g * SPECIFIC_FORCE_G[NAMES.index(name), 1]
            silent = abs(pps) < 20e-6 * K1 and SPECIFIC_FORCE_G[NAMES.index(name), 2] == 0
            fired = silent and int(name[-1]) % 2
            windows["acc_z"] = windows["acc_z"]._replace(
                mean=(PULSE_PPS if fired else 0.0) if silent else level,
                problems=("dead_band",) if silent and not fired else (),
            )
        found.append(dataclasses.replace(each, windows=windows))
    return found


def result(acquisitions, unit=UNIT, **settings):
    (found,) = reduce(RunData("imu", (unit,), tuple(acquisitions), record(BENCH)), SETTINGS | settings)
    return found


def of(found, quantity, axes):
    (each,) = [each for each in found.findings if each.quantity == quantity and f"/{axes}/" in each.id]
    return each


def test_readings_in_the_dead_band_are_left_out_with_all_at_the_same_input():
    found = result(skewed(BIAS_G - 10e-6))  # z sees 10 µg where y is down
    misalignment, other = of(found, "misalignment", "zy"), of(found, "misalignment", "zx")
    assert misalignment.value == pytest.approx(BIAS_G - 10e-6, abs=3 * misalignment.u)
    assert misalignment.u < 3e-6
    assert of(found, "K2", "z").value == pytest.approx(0.0, abs=3 * of(found, "K2", "z").u)
    assert other.u < misalignment.u < 2.5 * other.u, "half of the readings that tell it are left"
    assert texts(found.flags) == ("T=50:near_zero:acc_z Ay5..Ay8",)
    assert "acc_z Ay5..Ay8 is in the dead band" in flag_in_words(found.flags[0])


def test_a_reading_beside_the_dead_band_is_left_out_too():
    """Noise of its input reaches into the dead band: it has pulses, though not all."""
    beside = result(skewed(BIAS_G - 0.8 * DEAD_BAND_G))
    assert texts(beside.flags) == ("T=50:near_zero:acc_z Ay5..Ay8",)
    assert result(skewed(BIAS_G - 1.5 * DEAD_BAND_G)).flags == ()


def test_with_a_smaller_dead_band_it_is_kept():
    kept = result(skewed(BIAS_G - 0.8 * DEAD_BAND_G), dead_band_g=20e-6)
    assert kept.flags == ()
    assert of(kept, "misalignment", "zy").u == pytest.approx(of(kept, "misalignment", "zx").u)


def test_a_unit_that_sends_its_output_has_no_dead_band():
    sent = dataclasses.replace(UNIT, channel_units={"acc_z": "code"})
    assert result(skewed(BIAS_G - 0.8 * DEAD_BAND_G), sent).flags == ()


def test_the_gyro_is_read_where_the_accelerometer_is_silent():
    silent, loud = result(skewed(BIAS_G - 10e-6)), result(skewed(0.0))
    for axes in ("zx", "zy", "zz"):
        assert of(silent, "g_sensitivity", axes).value == of(loud, "g_sensitivity", axes).value


def test_a_vertical_accelerometer_that_falls_silent_is_a_fault():
    windows = [
        each if not each.step.endswith("/Az3") else dataclasses.replace(
            each, windows=each.windows | {"acc_z": each.windows["acc_z"]._replace(problems=("dead_band",))}
        )
        for each in block(BENCH, "s/hot", "xyz")
    ]  # fmt: skip
    assert "T=50:missing_position:Az3" in texts(result(windows).flags)


def test_a_change_of_a_bias_that_the_dead_band_hides_is_in_its_uncertainty():
    """Both times the input may be anywhere in the dead band."""
    closure = tuple(
        window for group in ("s/opening", "s/closing")
        for window in looked(group, (0, 0, -1.5e-3))  # z sees as much of x, which is up, and has 0.5 mg

    )  # fmt: skip
    data = RunData("imu", (UNIT,), (), record(BENCH), closure)

    def lines(dead_band_g):
        sensitive = {axis: Sensitivity(K1, 0.02, 100, 10e-6, dead_band_g) for axis in range(3)}
        return {
            each.id.split("a/", 1)[1]: [line.u for line in each.budget if line.source.endswith("dead band")]
            for each in closure_findings(data, UNIT, sensitive)
        }

    assert lines(40e-6)["z/K0/closure"] == pytest.approx([np.sqrt(2 / 3) * 40e-6])
    assert [name for name, each in lines(40e-6).items() if each] == ["z/K0/closure"]
    assert [each for each in lines(0.0).values() if each] == []
