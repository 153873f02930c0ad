"""Steps that only whole runs show: what waits for a reading, what must end in time, what is only said."""

import math

import pytest

from bench.reduce.stored_run import open_run
from bench.report.write import write_report
from bench.store.reader import RunReader
from tests.support.runs import copy_bench, run_short
from tests.support.sequences import TAIL, steps

RAMP = "{ramp: chamber, to: 30 °C, at: 3 °C/min}"
OFF = "teardown:\n  - {set: supply, output: off}\n"


def ran(tmp_path, *lines, **options):
    path = tmp_path / "s.yaml"
    path.write_text(steps(*lines) + OFF + TAIL, "utf-8")
    return run_short(tmp_path / "runs", sequence=str(path), **options)


def ended(result):
    with RunReader(result.path) as reader:
        return {event.step: event for event in reader.events("step_ended")}


def test_a_run_waits_until_the_unit_is_warm_and_has_been_so_for_the_time_it_is_told(tmp_path):
    condition = "{wait_until: unit_temperature, above: 27 °C, hold: 5 min, give_up_after: 2 h}"
    result = ran(tmp_path, RAMP, condition)
    assert result.outcome.how == "completed"
    done = ended(result)["steps/wait_until"]
    assert done.data["value"] > 27
    with RunReader(result.path) as reader:
        unit = reader.series("unit_temperature")
    first_s = unit.at_s[unit.values > 27][0]
    assert 5 * 60 <= done.at_s - first_s <= 5 * 60 + 7, "it looks every 5 s, at readings of a second ago"


def test_a_value_is_there_as_soon_as_its_sensor_has_told_one(tmp_path):
    result = ran(tmp_path, "{wait: 3 s}", "{measure: unit_temperature, as: t}")
    done = ended(result)
    assert done["steps/measure"].at_s - done["steps/wait"].at_s < 1.5, "its readings come every second"


@pytest.mark.parametrize(
    ("condition", "expected"),
    [
        ("above: 60 °C", "expected above 60 °C. Check what it measures"),
        ("below: -5.5 °C, hold: 1 min", "expected below -5.5 °C for 60 s. Check what it measures"),
        ("above: 40 °C, below: 50 °C", "expected above 40 °C and below 50 °C. Check what it measures"),
    ],
)
def test_a_condition_that_does_not_come_true_is_given_up_in_words(tmp_path, condition, expected):
    result = ran(tmp_path, f"{{wait_until: unit_temperature, {condition}, give_up_after: 10 min}}")
    assert result.outcome.how == "error"
    assert "s.yaml:2:5: step steps/wait_until: unit_temperature is 19." in result.problems[0]
    assert f"°C after 10.0 min, {expected}" in result.problems[0]
    assert result.bench_s < 11 * 60
    assert "teardown/set" in ended(result)


def test_a_unit_that_never_gets_stable_is_given_up_in_words(tmp_path):
    stable = "{band: 0.01 °C, slope: 1 °C/h, hold: 10 min}"  # its noise alone is more
    soak = f"{{soak: unit_temperature, at_least: 5 min, until_stable: {stable}, give_up_after: 30 min}}"
    result = ran(tmp_path, soak)
    assert "step steps/soak: unit_temperature is not stable after 0.5 h" in result.problems[0]
    assert "allowed are 0.01 °C and 1 °C/h" in result.problems[0]


def test_a_step_that_takes_longer_than_its_timeout_ends_the_run_with_its_teardown(tmp_path):
    result = ran(tmp_path, "{ramp: chamber, to: 30 °C, at: 1 °C/min, timeout: 5 min}", "wait: 1 s")
    assert result.outcome.how == "error"
    assert result.problems[0].endswith(
        "s.yaml:2:5: step steps/ramp: takes longer than its timeout of 300 s. Check what it waits for, or increase "
        "the timeout."
    )
    done = ended(result)
    assert "steps/ramp" not in done
    assert "steps/wait" not in done
    assert done["teardown/set"].at_s < 302


def test_a_step_that_ends_in_time_does_not_feel_its_timeout(tmp_path):
    assert ran(tmp_path, "{ramp: chamber, to: 21 °C, at: 1 °C/min, timeout: 5 min}").outcome.how == "completed"


def test_a_silent_instrument_is_told_as_such_also_under_a_timeout(tmp_path):
    bench = copy_bench(tmp_path / "config", faults="[{device: chamber, kind: silent, at: 1 min}]")
    result = ran(tmp_path, "{ramp: chamber, to: 30 °C, at: 1 °C/min, timeout: 8 min}", bench=bench)
    assert "chamber: no answer within 3 s" in result.problems[0]
    assert "timeout of" not in result.problems[0]


def test_a_note_is_shown_and_kept_with_its_time(tmp_path):
    result = ran(tmp_path, "wait: 10 min", "note: The cable of place a <was moved>.")
    assert ended(result)["steps/note"].data == {"note": "The cable of place a <was moved>."}
    with open_run(result.path) as stored:
        page = write_report(stored).read_text("utf-8")
    assert "The cable of place a &lt;was moved&gt;. (10 min after the start)" in page


def test_groups_and_repetitions_give_the_same_dwell_as_the_steps_alone(tmp_path):
    """The positions of one temperature belong together however they are written."""
    head = "results: [{method: temperature_tumble, data: a}]\n"
    count = "{acquire: counter, for: 5 s, label: a}"
    turn = "{for_each: p, in: [1°, 91°, 181°, 271°], steps: [{move: head, to: '${p}'}, " + count + "]}"
    passes = "{repeat: 2, steps: [{group: there, steps: [" + turn + "]}]}"
    supply = "{set: supply, voltage: 15 V, current_limit: 120 mA, output: on}"
    path = tmp_path / "s.yaml"
    path.write_text(head + steps(supply, "{ramp: chamber, to: 20 °C, at: 1 °C/min}", passes) + OFF + TAIL, "utf-8")
    result = run_short(tmp_path / "runs", sequence=str(path))
    assert result.outcome.how == "completed"
    bias = [finding for finding in result.results.units[0].findings if finding.quantity == "K0"]
    assert len(bias) == 1
    assert bias[0].at["temperature_set_c"] == 20.0


def test_a_tumble_without_a_ramp_has_results_whose_set_point_is_not_known(tmp_path):
    head = "results: [{method: temperature_tumble, data: a}]\n"
    supply = "{set: supply, voltage: 15 V, current_limit: 120 mA, output: on}"
    count = "{acquire: counter, for: 5 s, label: a}"
    turn = "{for_each: p, in: [1°, 91°, 181°, 271°], steps: [{move: head, to: '${p}'}, " + count + "]}"
    path = tmp_path / "s.yaml"
    path.write_text(head + steps(supply, "{group: room, steps: [" + turn + "]}") + OFF + TAIL, "utf-8")
    result = run_short(tmp_path / "runs", sequence=str(path))
    assert result.outcome.how == "completed"
    (bias,) = [finding for finding in result.results.units[0].findings if finding.quantity == "K0"]
    assert bias.at["temperature_set_c"] is None
    with open_run(result.path) as stored:
        assert "K0" in write_report(stored).read_text("utf-8")


@pytest.mark.parametrize(
    ("on_failure", "how", "noted"),
    [("stop", "failed", False), ("continue", "completed", True), (None, "completed", True)],
)
def test_a_unit_outside_its_limits_fails_which_is_no_error_of_the_bench(tmp_path, on_failure, how, noted):
    extra = f", on_failure: {on_failure}" if on_failure else ""
    measure = f"{{measure: unit_temperature, for: 10 s, limits: {{max: 5 °C}}{extra}}}"
    result = ran(tmp_path, "wait: 2 s", measure, "note: It goes on.")
    assert (result.outcome.how, result.results.verdict) == (how, "FAIL")
    assert ("steps/note" in ended(result)) == noted
    assert "teardown/set" in ended(result)


def test_what_is_acquired_where_a_move_did_not_end_is_not_reduced(tmp_path):
    lines = [
        line
        for angle_deg, way in ((90, ""), (270, ", timeout: 3 s, on_failure: continue"), (180, ""))
        for line in (f"{{move: head, to: {angle_deg}°{way}}}", "{acquire: counter, for: 5 s, label: a}")
    ]
    result = ran(tmp_path, "{ramp: chamber, to: 25 °C, at: 3 °C/min, timeout: 30 s, on_failure: continue}", *lines)
    assert result.outcome.how == "completed"
    with open_run(result.path) as run:
        acquired = run.data("a").acquisitions
    assert [each.angles_deg["head"] for each in acquired] == pytest.approx([90, 180], abs=1e-3)
    assert all(math.isnan(each.set_c) for each in acquired), "the chamber has not come to its set point"
