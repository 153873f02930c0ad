"""Channels whose converters make volts or codes, through every wire: a voltmeter, the unit's own telemetry."""

from __future__ import annotations

import numpy as np
import pytest

from bench.offline.calibration_file import compensated, read_calibration
from bench.offline.motion import axes_of, converted, wanted
from bench.reduce.output_in_run import output_in_run
from bench.reduce.stored_run import open_run
from bench.store.reader import RunReader
from campaigns.truth.channel import compare_channel
from tests.support.channel import FULL, SOURCE, findings, ran
from tests.support.runs import ROOT, run_short

pytestmark = pytest.mark.slow

BENCHES = {"channel_volts": ("dvm", "V"), "channel_telemetry": ("x", "code")}


@pytest.fixture(scope="module", params=BENCHES)
def full(request, tmp_path_factory):
    result = ran(
        tmp_path_factory.mktemp(request.param), "channel_full", FULL, bench=request.param, seed=3, no_report=False
    )
    return request.param, result


def test_all_levels_are_found_in_the_unit_of_the_output_and_within_their_uncertainties(full):
    bench, result = full
    assert (result.outcome.how, result.problems, result.results.verdict) == ("completed", [], "PASS")
    unit, found = BENCHES[bench][1], findings(result)
    assert {name.partition("@")[2] for name in found} == {"up_1g", "skew", "src_1g", "src_12g", "src_0g", ""}
    assert (found["rate@up_1g"]["unit"], found["rate@up_1g"]["name"]) == (unit, "output at 25 °C")
    assert found["tempco_offset"]["unit"] == found["rate/temperature_coefficient@skew"]["unit"] == f"{unit}/°C"
    compared = compare_channel(result.path)
    assert len(compared) == 4 * 3 + 3 * 2 + 2
    assert max(abs(each.ratio) for each in compared.values()) < 3.5


def test_the_certificate_of_the_voltmeter_is_in_the_budgets_and_a_unit_that_sends_has_none(full):
    bench, result = full
    of_rate = {line["source"]: line for line in findings(result)["rate@src_12g"]["budget"]}
    of_zero = {line["source"] for line in findings(result)["zero@src_0g"]["budget"]}
    assert not any(source.startswith("counter") for source in of_rate)
    assert ("dvm: gain" in of_rate) == ("dvm: offset" in of_zero) == (bench == "channel_volts")
    if bench == "channel_volts":
        assert of_rate["dvm: gain"]["u"] == pytest.approx(4e-6 * findings(result)["rate@src_12g"]["value"], rel=1e-3)
        assert of_rate["dvm: gain"]["shared"] == "dvm.gain"


def test_what_was_read_before_the_ramps_is_told_in_g(full):
    _, result = full
    with RunReader(result.path) as reader:
        reported = [event.data for event in reader.events("step_ended") if event.data.get("reading") == "output.a"]
    assert [each["unit"] for each in reported] == ["g"] * 3
    assert [each["value"] for each in reported] == pytest.approx([1.0, 0.577, 0.0], abs=0.005)
    assert all(0 < each["u"] < 1e-4 for each in reported)


def test_a_run_is_reduced_again_to_the_same(full):
    _, result = full
    with open_run(result.path) as stored:
        again = stored.evaluate().to_json()
    assert [each["value"] for each in again["findings"]] == [each["value"] for each in findings(result).values()]


def test_the_calibration_file_takes_the_temperature_out_of_the_output(full, tmp_path):
    bench, result = full
    channel = f"{BENCHES[bench][0]}@up_1g"
    found = findings(result)
    at_25, slope = found["rate@up_1g"]["value"], found["rate/temperature_coefficient@up_1g"]["value"]
    data = tmp_path / "data.csv"
    data.write_text(f"channel,T_C,output\n{channel},27,{at_25 + 2 * slope!r}\n", "utf-8")
    (calibration,) = result.path.glob("calibration_*.json")
    row = compensated(read_calibration(calibration), data, "hold").splitlines()[1].split(",")
    assert float(row[3]) == pytest.approx(at_25, rel=1e-9)


def test_an_acquisition_of_the_run_is_a_velocity(full):
    """15 min at 1 g, the local gravity, with the default uncertainties of the accelerometer."""
    _, result = full
    (path,) = result.path.glob("calibration_*.json")
    known = read_calibration(path)
    at_1g = findings(result)["rate@up_1g"]["steps"][0]
    with open_run(result.path) as stored:
        series = output_in_run(stored, known.uut, axes_of(known), at_1g)
    force, velocity = (
        {
            name: values
            for name, _, values in converted(known, "run", series, wanted(to, "g", "hold", None, None, ())).columns
        }
        for to in ("acceleration", "velocity")
    )
    (channel,) = axes_of(known)
    assert np.nanmean(force[f"{channel}_g"]) == pytest.approx(1.0, abs=15e-6)
    elapsed_s = velocity["t_s"][-1]
    assert elapsed_s > 850
    error_mps = velocity[f"{channel}_mps"][-1] - known.gravity_mps2 * elapsed_s
    assert abs(error_mps) < 3 * velocity[f"u_{channel}_mps"][-1]


def test_the_report_speaks_of_outputs_in_their_unit(full):
    bench, result = full
    page = (result.path / "report.html").read_text("utf-8")
    assert "Output of the channel over the temperature of its converter" in page
    assert "relative to the output alike" in page
    assert f"makes slopes in {BENCHES[bench][1]}/°C follow the level" in page
    assert "pulse/s" not in page


@pytest.mark.parametrize(
    ("bench", "sequence"), [("channel_volts", "channel_gravity"), ("channel_telemetry", "channel_source")]
)
def test_the_quick_preset_finds_the_truth(bench, sequence, tmp_path):
    result = run_short(tmp_path, bench=ROOT / "config" / f"{bench}.yaml", sequence=sequence, preset="quick", seed=2)
    assert (result.outcome.how, result.results.verdict) == ("completed", "PASS")
    assert [unit.flags for unit in result.results.units] == [()]
    assert max(abs(each.ratio) for each in compare_channel(result.path).values()) < 3


@pytest.mark.parametrize("bench", BENCHES)
def test_an_accelerometer_that_nobody_has_disconnected_ends_the_run_before_its_ramps(bench, tmp_path):
    hurried = {"setup/prompt": {"does": {}, "by": "A. Hurry"}}
    result = ran(tmp_path, "channel_source", SOURCE, bench=bench, answers=hurried)
    assert result.outcome.how == "failed"
    assert any("output.a is 1.00" in problem or "setup/measure" in problem for problem in result.problems)
