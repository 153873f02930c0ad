"""Repeatability against the truth: units that scatter by a known amount, remounted and switched off and on."""

import math

import pytest

from bench.app.request import RunRequest
from bench.methods.tumble.reduction.repeatability import interval_of, reduce
from bench.reduce.stored_run import open_run
from bench.store.reader import RunReader
from campaigns.truth.campaign import results_of, run_one
from campaigns.truth.repeatability import compare_repeatability, scattering_bench, true_closure_g
from campaigns.truth.signs import differences
from tests.support.flags import texts
from tests.support.runs import latest

SHORT = ("repetitions=4", "steady_within=265 µg", "gate=20 s", "off_time=1 min")


def repeated(folder, *settings):
    bench = scattering_bench(folder / "config")
    request = RunRequest(
        "repeatability", bench=str(bench), seed=4, settings=latest(*SHORT, *settings), runs=folder / "runs"
    )
    return run_one(request)


@pytest.fixture(scope="module")
def remounted(tmp_path_factory):
    return repeated(tmp_path_factory.mktemp("remounted"))


def test_each_standard_deviation_is_that_of_the_unit_within_its_uncertainty(remounted):
    found = compare_repeatability(remounted)
    assert [each.quantity for each in found] == ["K0/sd", "misalignment/sd"]
    assert max(abs(each.ratio) for each in found) < 3
    for finding in results_of(remounted)["findings"]:
        if finding["quantity"].endswith("/sd"):
            low, high = (finding["interval"][end] for end in ("low", "high"))
            assert low < finding["value"] < high
            assert finding["u"] == pytest.approx(finding["value"] / math.sqrt(6))


def test_the_closure_is_what_the_bias_really_did(remounted):
    (closure,) = [found for found in results_of(remounted)["findings"] if found["quantity"] == "K0/closure"]
    assert abs(closure["value"] - true_closure_g(remounted)) < 4 * closure["u"] + 2e-6, (
        "what is left of the warm-up bends"
    )
    assert closure["at"]["ratio"] == pytest.approx(closure["value"] / closure["u"])


def test_a_remounting_is_asked_of_a_person_without_power(remounted):
    with RunReader(remounted) as reader:
        ended = [event for event in reader.events("step_ended") if "mount" in event.data or "output" in event.data]
    kinds = ["mount" if "mount" in event.data else event.data["output"] for event in ended]
    assert kinds == ["mount", True, False] * 4 + [False]


def test_the_report_draws_the_values_and_tells_their_interval(remounted):
    report = (remounted / "report.html").read_text("utf-8")
    assert "Values over the repetitions, less their means" in report
    assert "Scatter of the values" in report


def test_power_cycles_need_nobody(tmp_path):
    run = repeated(tmp_path, "between=power_cycle", "repetitions=3", "gate=5 s")
    with RunReader(run) as reader:
        ended = [event.data for event in reader.events("step_ended")]
    assert ended
    assert not [data for data in ended if "mount" in data]
    sds = {found["quantity"]: found["value"] for found in results_of(run)["findings"]}
    assert sds["misalignment/sd"] < 20e-6, "nobody has moved it, by 145 µrad"
    assert sds["K0/sd"] > 5e-6


def test_fewer_than_three_tumbles_say_nothing(remounted):
    with open_run(remounted) as stored:
        data = stored.data("repeat")
    few = data.__class__(data.label, data.units, data.acquisitions[:16], data.bench)
    (unit,) = reduce(few, {"bias_per_c_u": 0.0})
    assert (unit.findings, texts(unit.flags), unit.verdict) == ((), ("too_few_repetitions",), "INCOMPLETE")


def test_the_interval_is_the_published_one():
    assert interval_of(1.0, 9) == pytest.approx((0.688, 1.826), abs=0.001)


def test_a_unit_of_the_other_sign_differs_in_its_sign_alone(remounted):
    assert list(differences(remounted)) == []
