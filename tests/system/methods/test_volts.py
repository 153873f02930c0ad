"""Whole runs whose units are measured by a voltmeter, by the same sequences as those whose pulses are counted."""

import json

import pytest

from bench.config.bench import load_bench
from bench.store.reader import RunReader
from campaigns.truth.campaign import compare
from campaigns.truth.ramp import compare_ramp
from tests.support.runs import ROOT, SHORT, read_json, run_short
from tests.support.sequences import BENCH, plan_of, problems_of, steps

pytestmark = pytest.mark.slow

RAMP = ("low=10 °C", "high=40 °C", "ramp_rate=3 °C/min")  # warmed up: what K1 is found by rests
VOLTS = load_bench(ROOT / "config/volts.yaml").bench
TAIL = "schema: itb-sequence/1\ntitle: Test\nneeds: {output: output, head: positioner}\n"
TUMBLE = steps(
    *(line for deg in (0, 90, 180, 270) for line in (f"{{move: head, to: {deg}°}}",
      "{acquire: output, for: 60 s, label: tumble}"))
) + "teardown:\n  - {move: head, to: 0°}\n"  # fmt: skip
RESULT = "results:\n  - {method: temperature_tumble, data: tumble, settings: {degree: 1}, limits: {K1: {min: LIMIT}}}\n"


@pytest.fixture(scope="module")
def tumble(tmp_path_factory):
    return run_short(
        tmp_path_factory.mktemp("volts"), bench=ROOT / "config/volts.yaml", settings=SHORT, no_report=False
    )


def test_a_tumble_in_volts_finds_the_truth(tumble):
    assert tumble.problems == []
    comparisons = compare([tumble.path])
    assert len(comparisons) == 15
    assert max(abs(comparison.ratio) for comparison in comparisons) < 3.5
    found = {finding["quantity"]: finding for finding in read_json(tumble, "results.json")["findings"]}
    assert (found["K1"]["unit"], found["K1_si"]["unit"], found["K0"]["unit"]) == ("V/g", "V/(m/s²)", "g")
    assert found["K1"]["value"] == pytest.approx(1.13, rel=1e-3)


def test_the_certificate_of_the_voltmeter_is_in_the_budgets(tumble):
    found = {finding["quantity"]: finding for finding in read_json(tumble, "results.json")["findings"]}
    budgets = {name: {line["source"]: line for line in found[name]["budget"]} for name in ("K0", "K1")}
    assert budgets["K1"]["dvm: gain"]["u"] == pytest.approx(4e-6 * 1.13, rel=1e-3)
    assert budgets["K1"]["dvm: gain"]["shared"] == "dvm.gain"
    assert budgets["K0"]["dvm: offset"]["u"] == pytest.approx(1e-6 / 1.13, rel=1e-3)
    assert not any("time base" in source for budget in budgets.values() for source in budget)


def test_every_reading_is_kept_as_it_was_read(tumble):
    truth = json.loads((tumble.path / "truth.json").read_text("utf-8"))
    assert truth["bench"]["voltmeters"]["dvm"]["gain"] != 0
    with RunReader(tumble.path) as reader:
        ends = {event.step: event.data for event in reader.events("step_ended") if event.data.get("label") == "tumble"}
        samples = reader.samples_by_step()
    assert set(samples) == set(ends)
    for step, read in samples.items():
        at_s = read["dvm"][:, 0]
        assert ends[step]["begin_s"] < at_s[0] < at_s[-1] < ends[step]["end_s"] + 1
        assert 4 <= len(at_s) <= 6  # in 10 s


def test_the_report_tells_volts(tumble):
    page = (tumble.path / "report.html").read_text("utf-8")
    for words in ("K1 relative to 1.1", "V/g", "Voltmeter dvm", "readings in 24 acquisitions"):
        assert words in page
    assert "pulse/s/g" not in page


def test_a_ramp_in_volts_finds_the_truth(tmp_path):
    result = run_short(tmp_path, bench=ROOT / "config/volts.yaml", sequence="ramp_dynamic", settings=RAMP, seed=1)
    assert result.problems == []
    comparisons = compare_ramp(result.path)  # of legs that are all turns, where K1 is behind its temperature
    assert "K0/model_residual_rms" in {comparison.quantity for comparison in comparisons}
    assert max(abs(comparison.ratio) for comparison in comparisons) < 2.5


def test_limits_are_in_the_unit_that_the_bench_measures(tmp_path):
    volts, pulses = (RESULT.replace("LIMIT", limit) for limit in ("1 V/g", "11000 pulse/s/g"))
    for limits, bench in ((volts, VOLTS), (volts, None), (pulses, BENCH), (pulses, None)):
        plan_of(tmp_path, TUMBLE, tail=TAIL + limits, bench=bench)
    for limits, bench, unit in ((volts, BENCH, "pulse/s/g"), (pulses, VOLTS, "V/g")):
        (problem,) = problems_of(tmp_path, TUMBLE, tail=TAIL + limits, bench=bench)
        assert f"expected a quantity in {unit}" in problem


def test_the_output_of_one_unit_is_measured_in_g_for_a_time(tmp_path):
    good = steps("{measure: output.a, for: 5 s, as: u, limits: {min: 0.1 g}}")
    plan_of(tmp_path, good, tail=TAIL, bench=VOLTS)
    body = steps(
        "{measure: output, for: 5 s, as: u}", "{measure: output.b, for: 5 s, as: v}", "{measure: output.a, as: w}",
        "{measure: output.a, for: 5 s, as: x, limits: {min: 1 V}}",
        "{wait_until: output.a, above: 0.5 g, give_up_after: 1 min}",
    )  # fmt: skip
    assert problems_of(tmp_path, body, tail=TAIL, bench=VOLTS) == [
        "2:6: 'output' is the output of all units; name one by its place: output.a",
        "3:6: the bench has no unit in place 'b'; expected a",
        "4:6: measure: the output of a unit is measured over a time: give 'for' (step steps/measure#3)",
        "5:42: limits: min: is in V, expected a quantity in g (step steps/measure#4)",
        "6:6: wait_until: output.a has no continuous reading; use a measure step (step steps/wait_until)",
    ]
