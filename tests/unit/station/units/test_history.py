"""History of a unit and comparison of runs: which results are comparable, and which errors are the same."""

import json

import pytest

from bench.station.runs.findings import findings_of
from bench.station.units.comparison import compare
from bench.station.units.history import history
from bench.station.units.trends import YEAR
from bench.store.runs import list_runs, summary
from tests.support.stored_results import finding, instant, line, stored

OWN, ZERO = line("readings: scatter", 0.03, kind="A"), line("head: zero", 0.04, "head.zero")


def series(runs, uut="QF-1"):
    return history(uut, list_runs(runs)).series


def test_a_result_is_followed_over_the_runs_of_a_unit(tmp_path):
    for year in (2020, 2021, 2022):
        stored(tmp_path, instant(year), [finding(0.1 * (year - 2020), OWN)])
    stored(tmp_path, instant(2023), [finding(9.0, uut="other")], uut="other")
    (found,) = series(tmp_path)
    assert [each.value for each in found.points] == pytest.approx([0.0, 0.1, 0.2])
    assert found.points[0].e_n is None
    assert found.points[1].e_n == pytest.approx(0.1 / (2 * 0.03 * 2**0.5))
    assert found.drift.per_year == pytest.approx(0.1, rel=1e-3)
    assert found.drift.significant
    # 0.2 + 0.1·t + 2·0.03·sqrt(1/3 + (t + 1)²/2) = 1 at t = 5.3
    assert found.drift.reaches_limit.year == 2027
    assert found.chart is None
    assert history("QF-1", list_runs(tmp_path)).next_due == found.drift.reaches_limit


def test_an_instrument_with_the_same_certificate_has_the_same_error(tmp_path):
    stored(tmp_path, instant(2020), [finding(0.0, OWN, ZERO)])
    stored(tmp_path, instant(2021), [finding(0.1, OWN, ZERO)])
    stored(tmp_path, instant(2022), [finding(0.2, OWN, ZERO)], certificate="C-2")
    (found,) = series(tmp_path)
    assert found.points[1].e_n == pytest.approx(0.1 / (2 * 0.03 * 2**0.5))
    assert found.points[2].e_n == pytest.approx(0.1 / (2 * 0.05 * 2**0.5))
    assert found.shared == []


@pytest.mark.parametrize(
    ("name", "source"),
    [
        ("head.drift", "head: drift within the run"),
        ("fixture.level", "fixture: level"),
        ("tumble/a/K1", "K1"),
        (None, "head: repeatability"),
    ],
)
def test_an_error_that_is_new_in_each_run_is_not_shared(tmp_path, name, source):
    for year in (2020, 2021):
        stored(tmp_path, instant(year), [finding(0.1 * (year - 2020), OWN, line(source, 0.04, name))])
    (found,) = series(tmp_path)
    assert found.points[1].e_n == pytest.approx(0.1 / (2 * 0.05 * 2**0.5))


def test_an_error_enters_a_result_differently_with_other_parameters(tmp_path):
    stored(tmp_path, instant(2020), [finding(0.0, OWN, ZERO)])
    stored(tmp_path, instant(2021), [finding(0.1, OWN, ZERO)], parameters={"gate": "10 s"})
    (found,) = series(tmp_path)
    assert found.points[1].e_n == pytest.approx(0.1 / (2 * 0.05 * 2**0.5))


def test_the_place_of_the_unit_does_not_matter_but_simulation_and_unit_do(tmp_path):
    stored(tmp_path, instant(2020), [finding(0.0)])
    stored(tmp_path, instant(2021), [finding(0.1, id_="tumble/b/K0")], place="b")
    stored(tmp_path, instant(2022), [finding(0.2)], simulated=["head"])
    stored(tmp_path, instant(2023), [finding(0.3, unit="m/s²")])
    assert [len(each.points) for each in series(tmp_path)] == [2, 1, 1]


def test_invalid_results_and_runs_that_cannot_be_read_do_not_count(tmp_path):
    stored(tmp_path, instant(2020), [finding(0.0)])
    stored(tmp_path, instant(2021), [finding(0.1, verdict="INVALID")])
    (stored(tmp_path, instant(2022), [finding(0.2)]) / "results.json").write_text('{"findings": [{"value": "NaN"}]}')
    stored(tmp_path, instant(2023), [finding(0.3)], state="aborted")
    found = history("QF-1", list_runs(tmp_path))
    assert [len(each.points) for each in found.series] == [1]
    assert [run[:4] for run in found.unread] == ["2022", "2023"]
    assert len(found.runs) == 4


def test_twenty_calibrations_have_a_control_chart(tmp_path):
    for number in range(21):
        value = 0.5 if number == 20 else 0.01 * (-1) ** number
        stored(tmp_path, instant(2000 + number), [finding(value)])
    (found,) = series(tmp_path)
    assert found.chart.high == pytest.approx(3 * 0.02 / 1.128)
    assert found.points[20].signals == ["Western Electric 1"]
    assert not any(each.signals for each in found.points[:20])


def test_two_runs_are_compared_result_by_result(tmp_path):
    first = stored(tmp_path, instant(2020), [finding(0.0, OWN, ZERO), finding(1.0, id_="tumble/a/K1", quantity="K1")])
    second = stored(tmp_path, instant(2021), [finding(0.1, OWN, ZERO)], operator="boris")
    found = compare(summary(first), summary(second))
    bias, scale = found.results
    assert bias.difference == pytest.approx(0.1)
    assert bias.e_n == pytest.approx(0.1 / (2 * 0.03 * 2**0.5))
    assert (scale.second, scale.difference, scale.e_n) == (None, None, None)
    assert found.differs == {"operator": ("anna", "boris")}
    assert found.same_unit


def test_the_reasons_of_a_verdict_name_value_and_limit(tmp_path):
    run = stored(
        tmp_path, instant(2020), [finding(1.5, verdict="FAIL"), finding(0.0, verdict="INVALID", flags=["u_unknown"])],
        problems=["lost frames"],
    )  # fmt: skip
    found = findings_of(summary(run))
    assert found.reasons == [
        "lost frames", "QF-1: tumble/a/K0: 1.5 g is beyond the limit 1 g", "QF-1: tumble/a/K0 is invalid: u_unknown",
    ]  # fmt: skip


def test_steps_that_were_left_out_are_a_reason_in_words(tmp_path):
    run = stored(tmp_path, instant(2020))
    content = json.loads((run / "results.json").read_text())
    left_out = [{"step": "steps/measure", "why": "head: no answer within 2 s"}, "of an earlier version"]
    (run / "results.json").write_text(json.dumps({**content, "left_out": left_out}))
    assert findings_of(summary(run)).problems == [
        "step steps/measure was left out: head: no answer within 2 s", "of an earlier version",
    ]  # fmt: skip


def test_results_that_somebody_has_broken_are_a_problem_in_words(tmp_path):
    run = stored(tmp_path, instant(2020))
    (run / "results.json").write_text(json.dumps({"verdict": "PASS", "findings": [{"id": 3}]}))
    found = findings_of(summary(run))
    assert found.findings == []
    assert "results.json" in found.problem


@pytest.mark.parametrize(
    ("months", "moved", "within"),
    [
        (6, 0.2, True), (6, -0.2, True), (6, 0.4, False), (6, -0.4, False), (6, 0.3, None), (12, 0.4, True),
        (0.5, 0.04, True), (0.5, 0.06, False),  # less than a month counts as one
    ],
)  # fmt: skip
def test_the_next_calibration_is_compared_with_the_drift_that_the_last_one_specified(tmp_path, months, moved, within):
    """0.05 a month, each value with a U of 0.001 of its own."""
    own, first = line("readings: scatter", 0.0005, kind="A"), instant(2020)
    stored(tmp_path, first, [{**finding(0.0, own), "monthly_drift": 0.05}])
    stored(tmp_path, first + months * YEAR / 12, [finding(moved, own)])
    (found,) = series(tmp_path)
    assert found.points[0].change is None
    change = found.points[1].change
    assert (change.value, change.within) == (pytest.approx(moved), within)
    assert change.allowed == pytest.approx(0.05 * max(months, 1))
    assert change.expanded == pytest.approx(2 * 0.0005 * 2**0.5)


def test_without_a_specified_drift_nothing_is_compared(tmp_path):
    for year in (2020, 2021):
        stored(tmp_path, instant(year), [finding(0.1, OWN)])
    (found,) = series(tmp_path)
    assert [each.change for each in found.points] == [None, None]
