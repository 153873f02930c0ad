"""Three units share one stimulus: each is measured and judged by itself, and one that fails is dropped."""

import pytest

from bench.config.bench import load_bench
from bench.config.simulation import FaultSimulation
from bench.errors import InputError
from bench.store.reader import RunReader
from campaigns.truth.campaign import compare_one
from tests.support.engines import run_plan
from tests.support.flags import texts
from tests.support.runs import copy_bench, read_json, run_short
from tests.support.sequences import ROOT, TAIL, plan_of, steps

THREE = load_bench(ROOT / "config" / "three_units.yaml").bench
NEEDS = TAIL.replace("  source: current_source\n", "")
ON = "{set: supply, voltage: 15 V, current_limit: 120 mA, output: on}"
UP = "{move: head, to: 45°}"
OFF = "teardown:\n  - {set: supply, output: off}\n"
FAULTS = {
    "silent": ("silent", "no frame of its channel 'y' for"),
    "dead": ("silent", "its count on channel 'y' has not changed for"),
    "open_thermometer": ("thermometer", "temperature_b was read as 320 °C, outside the possible range"),
    "current": ("draws_too_much", "supply_b: the units draw 120 mA, expected 30 to 110 mA"),
}


def broken(*faults, bench=THREE):
    """The bench with faults, each as UNIT KIND TIME, or of a device."""
    found = []
    for fault in faults:
        name, kind, at = fault.split(" ", 2)
        found.append(
            FaultSimulation.model_validate({"unit" if len(name) == 1 else "device": name, "kind": kind, "at": at})
        )
    simulation = bench.simulation.model_copy(update={"faults": tuple(found)})
    return bench.model_copy(update={"simulation": simulation})


def ran(tmp_path, bench, *lines):
    tmp_path.mkdir(exist_ok=True)
    plan = plan_of(tmp_path, steps(ON, UP, *lines) + OFF, tail=NEEDS, bench=bench)
    return run_plan(tmp_path / "run", plan, bench)


def run_three(folder, fault="", sequence="smoke", **options):
    copy_bench(folder / "config")
    path = folder / "config" / "three_units.yaml"
    path.write_text(path.read_text("utf-8") + (f"  faults: [{fault}]\n" if fault else ""), "utf-8")
    return run_short(folder / "runs", bench=path, sequence=sequence, **options)


def events(result, *kinds):
    with RunReader(result.path) as reader:
        return list(reader.events(*kinds))


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    return run_three(tmp_path_factory.mktemp("good"), no_report=False, units=("a=QF-1", "b=QF-2", "c=QF-3"))


@pytest.fixture(scope="module")
def one_failed(tmp_path_factory):
    fault = "{unit: b, kind: current, at: 75 s}"
    settings = ("temperatures=[20 °C, 20 °C]", "soak=20 s", "gate=5 s")
    return run_three(tmp_path_factory.mktemp("failed"), fault, settings=settings, no_report=False)


def test_two_units_on_one_supply_may_draw_what_both_may(tmp_path):
    copy_bench(tmp_path / "config")
    path = tmp_path / "config" / "three_units.yaml"
    path.write_text(path.read_text("utf-8").replace("supply: supply_b\n", "supply: supply_a\n"), "utf-8")
    for serials, how in ((("a=QF-1", "b=QF-2"), "completed"), (("a=QF-1",), "completed")):
        result = run_short(tmp_path / "runs", bench=path, sequence="smoke", units=serials)
        assert (result.outcome.how, result.problems) == (how, [])


def test_each_unit_has_its_findings_its_verdict_and_its_section(good):
    assert good.problems == []
    units = [(unit.place, unit.uut, unit.verdict) for unit in good.results.units]
    assert units == [("a", "QF-1", "PASS"), ("b", "QF-2", "PASS"), ("c", "QF-3", "PASS")]
    results = read_json(good, "results.json")
    found = [each for each in compare_one(good.path, results) if each.quantity in ("K2", "misalignment")]
    assert len(found) == 6
    assert max(abs(each.ratio) for each in found) < 4, "each with its own mount angle"
    report = (good.path / "report.html").read_text("utf-8")
    assert all(f"{unit} in place" in report for unit in ("QF-1", "QF-2", "QF-3"))
    assert report.count("fewer temperatures than the model asked for") == 2, "of K0 and of K1, once for all units"


def test_what_one_name_stands_for_is_set_at_each_and_waited_for_at_all(good):
    ended = {event.step: event.data for event in events(good, "step_ended")}
    outputs = ended["setup/set"]["outputs"]
    assert {role: found["output"] for role, found in outputs.items()} == dict.fromkeys(THREE.together["supply"], True)
    assert set(ended["steps/temperature=20/soak"]["temperature_c"]) == set(THREE.together["unit_temperature"])


def test_a_unit_that_draws_too_much_fails_and_the_others_are_judged_by_what_they_gave(one_failed):
    assert one_failed.outcome.how == "completed", one_failed.problems
    assert {unit.place: unit.verdict for unit in one_failed.results.units} == {"a": "PASS", "b": "FAIL", "c": "PASS"}
    assert one_failed.results.verdict == "FAIL"
    record = {unit["place"]: unit for unit in read_json(one_failed, "results.json")["units"]}
    assert (record["b"]["dropped"]["fault"], record["b"]["dropped"]["bad"]) == ("draws_too_much", True)
    assert "dropped" not in record["a"]


def test_what_a_dropped_unit_gave_before_is_kept_and_nothing_after(one_failed):
    units = {unit.place: unit for unit in one_failed.results.units}
    dwells = {place: {f.at["dwell"] for f in unit.findings if "dwell" in f.at} for place, unit in units.items()}
    assert dwells == {"a": {0, 1}, "b": {0}, "c": {0, 1}}
    assert not [flag for flag in texts(units["b"].flags) if "incomplete" in flag]


def test_a_dropped_unit_is_the_first_thing_that_the_report_tells(one_failed):
    report = (one_failed.path / "report.html").read_text("utf-8")
    first = report.partition("What happened")[2].partition("</li>")[0]
    assert "The unit in place b is dropped: supply_b: the units draw 120 mA" in first
    assert "The run goes on with a, c." in first


@pytest.mark.parametrize("kind", FAULTS)
def test_a_unit_that_fails_is_switched_off_and_dropped_and_the_others_go_on(tmp_path, kind):
    fault, reported = FAULTS[kind]
    run = ran(tmp_path, broken(f"b {kind} 30 s"), "{soak: unit_temperature, at_least: 70 s}")
    assert run.outcome.how == "completed", run.outcome.problems
    (dropped,) = run.events_of("unit_dropped")
    assert (dropped.data["place"], dropped.data["fault"], dropped.data["bad"]) == ("b", fault, kind == "current")
    assert reported in dropped.data["text"]
    assert any(dropped.data["text"] in notice for notice in run.notices)
    (off,) = run.events_of("unit_off")
    assert (off.data["device"], off.data["output"]) == ("supply_b", False)
    assert off.at_s - dropped.at_s < 5
    assert 30 <= dropped.at_s < 75
    assert set(run.state.dropped) == {"b"}
    assert run.series["supply_b.current"].values[-1] == 0
    assert set(run.ended("steps/soak").data["temperature_c"]) == {"temperature_a", "temperature_c"}


def test_counts_that_stand_still_say_nothing_where_the_input_axis_is_level(tmp_path):
    """At 0° a and c are level and b upright; a converter's dead band may hold those two still."""
    level = ("{move: head, to: 0°}", "{soak: unit_temperature, at_least: 80 s}")
    run = ran(tmp_path, broken("a dead 1 s", "b dead 1 s"), *level)
    assert [event.data["place"] for event in run.events_of("unit_dropped")] == ["b"]


def test_when_no_unit_is_left_the_run_ends(tmp_path):
    faults = ("a current 10 s", "b current 30 s", "c current 50 s")
    run = ran(tmp_path, broken(*faults), "{soak: unit_temperature, at_least: 10 min}")
    assert run.outcome.how == "error"
    assert [event.data["place"] for event in run.events_of("unit_dropped")] == ["a", "b", "c"]
    assert "No unit is left" in run.outcome.problems[0]
    assert run.events[-1].at_s < 80
    assert not run.powered


@pytest.mark.parametrize(
    ("faults", "reported"),
    [
        (
            ("a silent 10 s", "b silent 10 s"),
            "counter: 2 units fail in the same way at the same time, which points to the bench",
        ),
        (("counter silent 10 s",), "counter: counter frames have stopped"),
        (("b dead 1 s", "supply_b stuck 9 s"), "supply_b cannot be switched off after the unit in place b was dropped"),
    ],
)
def test_what_is_the_bench_ends_the_run(tmp_path, faults, reported):
    run = ran(tmp_path, broken(*faults), "{soak: unit_temperature, at_least: 2 min}")
    assert run.outcome.how == "error"
    assert reported in run.outcome.problems[0]


def test_an_interlock_on_the_thermometer_of_a_dropped_unit_is_judged_no_more(tmp_path):
    interlocks = "interlocks:\n  hot: {reading: temperature_b, above: 85 °C, then: stop}\n"
    bench = broken("b open_thermometer 20 s")
    body = steps(ON, "{soak: unit_temperature, at_least: 1 min}") + OFF + interlocks
    run = run_plan(
        tmp_path / "run", plan_of(tmp_path, body, tail=NEEDS + "  temperature_b: thermometer\n", bench=bench), bench
    )
    assert run.outcome.how == "completed", run.outcome.problems
    (dropped,) = run.events_of("unit_dropped")
    assert "are disabled: hot" in dropped.data["text"]
    assert run.events_of("interlock") == []


@pytest.mark.parametrize(
    ("wait", "reported"),
    [
        (
            "{soak: unit_temperature, at_least: 1 min, until_stable: {band: 0.3 °C, slope: 30 °C/h, hold: 1 min}, "
            "give_up_after: 15 min}",
            "temperature_b is not stable after 0.3 h",
        ),
        ("{wait_until: unit_temperature, above: 22 °C, give_up_after: 15 min}", "temperature_b is 20."),
    ],
)
def test_a_unit_that_keeps_the_others_waiting_is_dropped_when_the_step_gives_up(tmp_path, wait, reported):
    """The thermometer of b hangs in the air, which swings, and is not warmed by the unit."""
    lost = THREE.readings["temperature_b"].model_copy(update={"from_": "chamber.process_value"})
    bench = THREE.model_copy(update={"readings": {**THREE.readings, "temperature_b": lost}})
    run = ran(tmp_path, bench, wait)
    assert run.outcome.how == "completed", run.outcome.problems
    (dropped,) = run.events_of("unit_dropped")
    assert (dropped.data["place"], dropped.data["fault"]) == ("b", "not_settled")
    assert reported in dropped.data["text"]
    assert 900 < dropped.at_s < 960


def test_an_empty_place_is_neither_fed_nor_waited_for(tmp_path):
    result = run_three(tmp_path, "{unit: b, kind: open_thermometer, at: 2 s}", units=("a=QF-1", "c=QF-3"))
    assert result.outcome.how == "completed", result.problems
    assert [unit.place for unit in result.results.units] == ["a", "c"]
    outputs = {event.step: event.data for event in events(result, "step_ended")}["setup/set"]["outputs"]
    assert set(outputs) == {"supply_a", "supply_c"}
    assert events(result, "unit_dropped") == []


def test_one_of_several_is_meant_alone_where_it_is_the_only_one_in_the_run(tmp_path):
    path, measure = tmp_path / "s.yaml", "{measure: unit_temperature, for: 5 s, as: t}"
    path.write_text(steps(measure) + NEEDS, "utf-8")
    with pytest.raises(InputError, match="name one of them"):
        run_three(tmp_path, sequence=str(path))
    fault = "{unit: a, kind: open_thermometer, at: 0 s}"
    result = run_three(tmp_path, fault, sequence=str(path), units=("b=QF-2",))
    assert result.outcome.how == "completed", result.problems
    (ended,) = events(result, "step_ended")
    with RunReader(result.path) as reader:
        of_b, of_c = (reader.series(name).values.mean() for name in ("temperature_b", "temperature_c"))
    assert abs(ended.data["value"] - of_b) < 0.01 < abs(ended.data["value"] - of_c)


def test_one_unit_alone_that_fails_ends_the_run(tmp_path):
    result = run_three(tmp_path, "{unit: b, kind: open_thermometer, at: 2 s}", units=("b=QF-2",))
    assert result.outcome.how == "error"
    assert result.problems[0] == (
        "temperature_b was read as 320 °C, outside the possible range, and the reading before it was "
        "implausible too. Check the sensor, its cable, and the instrument that reads it."
    )
    assert events(result, "unit_dropped") == []
