"""What a bench file may say of an inertial unit that sends its outputs itself."""

import pytest

from bench.config.bench import load_bench
from bench.errors import InputError
from campaigns.truth.campaign import full_bench
from tests.support.runs import ROOT
from tests.support.sequences import problems_of

BENCH = load_bench(ROOT / "config/imu_telemetry.yaml").bench
M2 = """\
schema: itb-sequence/1
title: Test
needs: {output: output}
steps: [{acquire: output, for: 10 s, label: imu}]
results: [{method: imu_calibration, data: imu, limits: {LIMIT}}]
"""


def edited(folder, *edits, bench="imu_telemetry"):
    full_bench(folder)
    path = folder / f"{bench}.yaml"
    text = path.read_text("utf-8")
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new)
    path.write_text(text, "utf-8")
    return path


def remarks_of(folder, bench, limit="K1: {min: 1 code/g}"):
    return problems_of(folder, M2.replace("LIMIT", limit), tail="", bench=bench)


def test_the_devices_that_measure_it_are_those_that_have_its_channels():
    place = BENCH.places["a"]
    assert BENCH.measuring(place) == ("telemetry",)
    assert BENCH.acquired_from("output") == ("telemetry",)
    assert (BENCH.output_unit("a"), BENCH.gyro_output_unit("a")) == ("code", "code")
    assert BENCH.nominal_per_g("a") == pytest.approx(52_000)


def test_values_that_are_decoded_are_in_units_of_their_own(tmp_path):
    bench = load_bench(
        edited(
            tmp_path,
            *((f"AxisX.{name}".replace("X", axis) + ", tick", f"Axis{axis}.{name}, unit: {unit}, tick")
              for name, unit in (("Acceleration", "m/s²"), ("Rate", "°/s")) for axis in "XYZ"),
            ("output: 52000 code/g", "output: 9.8 m/s²/g"),
        )
    ).bench  # fmt: skip
    assert (bench.output_unit("a"), bench.gyro_output_unit("a")) == ("m/s²", "°/s")
    (reported,) = remarks_of(tmp_path, bench, "KG: {min: 1 code/(°/s)}")
    assert "expected a quantity in °/s/(°/s)" in reported


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("acc_x: ax", "acc_x: bx", "no counter and no telemetry has a channel 'bx'; expected"),
        ("acc_x: ax", "acc_x: ay", "'ay' carries place 'a' already"),
        ("        unused:", "        ax:", "'ax' is a channel of a counter and of telemetry; give one of them another"),
        ("acc_x: ax", "acc_x: unused", "the outputs of the accelerometers are in pulse/s and code; one is needed"),
        ("52000 code/g", "2 A/g", "is 2 A/g, expected a quantity in code/g"),
    ],
)
def test_a_bench_whose_parts_do_not_fit_is_told(tmp_path, old, new, problem):
    with pytest.raises(InputError) as caught:
        load_bench(edited(tmp_path, (old, new)))
    assert problem in str(caught.value)


def test_a_voltmeter_reads_no_inertial_unit(tmp_path):
    (old, new) = ("    voltmeter: dvm", "    channels: {" + ", ".join(
        f"{name}: dvm" for name in ("acc_x", "acc_y", "acc_z", "gyro_x", "gyro_y", "gyro_z")) + "}")  # fmt: skip
    with pytest.raises(InputError, match="'dvm' is a voltmeter, which reads one channel; those of an"):
        load_bench(edited(tmp_path, (old, new), bench="volts"))
    (reported,) = remarks_of(tmp_path, load_bench(ROOT / "config/volts.yaml").bench, "K1: {min: 1 V/g}")
    assert "place 'a' is for units with one channel; a voltmeter reads one channel, not six simultaneously" in reported


def test_rates_that_are_sent_need_a_clock_of_which_something_is_known(tmp_path):
    site = BENCH.site.model_copy(update={"host_clock": None})
    (reported,) = remarks_of(tmp_path, BENCH.model_copy(update={"site": site}))
    assert "for place 'a' the bench file does not state the uncertainty of that clock. Add it under site" in reported


def test_limits_are_in_the_unit_that_is_sent(tmp_path):
    (reported,) = remarks_of(tmp_path, BENCH, "K1: {min: 1 pulse/s/g}")
    assert "expected a quantity in code/g" in reported
