"""Interlocks in bench files, and those of a sequence beside them; more of their messages are in tests/broken."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from bench.config.bench import load_bench
from bench.config.channels import channels_of
from bench.config.document import parse_document
from bench.config.interlocks import AgeInterlock, DifferenceInterlock, RateInterlock, ReadingInterlock
from bench.config.schema import bench_schema
from bench.errors import InputError
from drivers.quantity.quantities import parse
from tests.support.sequences import load_plan, plan_of, problems_of, steps

CONFIG = Path(__file__).parents[3] / "config"
SHIPPED = (CONFIG / "simulated.yaml").read_text(encoding="utf-8")
LINE = SHIPPED.count("\n") + 2
GOOD = {
    "hot": "{reading: unit_temperature, above: 85 °C, for: 5 s, then: stop}",
    "fast": "{rate_of: unit_temperature, over: 2 min, above: 5 °C/min, for: 30 s, then: hold, good_for: 1 min}",
    "astray": "{difference: [chamber.process_value, chamber.set_point], above: 5 °C, for: 30 min, then: pause}",
    "silent": "{age_of: unit_temperature, above: 30 s, then: abort}",
    "supply": "{reading: supply.current, above: 110 mA, below: 30 mA, then: stop}",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with everything that the shipped bench file names."""
    return Path(shutil.copytree(CONFIG, tmp_path_factory.mktemp("bench") / "config"))


def loaded(folder, shipped=SHIPPED, **interlocks):
    lines = [f"  {name}: {entry}\n" for name, entry in interlocks.items()]
    (folder / "b.yaml").write_text(f"{shipped}interlocks:\n{''.join(lines)}", encoding="utf-8")
    return load_bench(folder / "b.yaml").bench


def problems(folder, shipped=SHIPPED, **interlocks):
    with pytest.raises(InputError) as caught:
        loaded(folder, shipped, **interlocks)
    return [problem.removeprefix(f"{folder}/b.yaml:") for problem in caught.value.problems]


def test_a_bench_file_declares_interlocks(folder):
    found = loaded(folder, **GOOD).interlocks
    hot, fast, astray, silent, supply = found.values()
    assert list(found) == list(GOOD)
    assert isinstance(hot, ReadingInterlock)
    assert (hot.names, hot.above, hot.below, hot.for_s, hot.then, hot.good_for_s) == (
        ("unit_temperature",), parse("85 °C"), None, 5, "stop", 0
    )  # fmt: skip
    assert isinstance(fast, RateInterlock)
    assert (fast.over_s, fast.above.to("°C/h"), fast.good_for_s) == (120, 300, 60)
    assert isinstance(astray, DifferenceInterlock)
    assert astray.names == ("chamber.process_value", "chamber.set_point")
    assert isinstance(silent, AgeInterlock)
    assert (silent.names, silent.above_s) == (("unit_temperature",), 30)
    assert (supply.above, supply.below) == (parse("0.11 A"), parse("0.03 A"))


def test_a_bench_without_interlocks_has_none():
    assert load_bench(CONFIG / "simulated.yaml").bench.interlocks == {}


@pytest.mark.parametrize(
    ("entry", "at", "problem"),
    [
        ("{reading: chambr.set_point, above: 5 °C, then: stop}", "reading",
         "there is no reading 'chambr.set_point'; did you mean 'chamber.set_point'?"),
        ("{reading: supply.power, above: 5 W, then: stop}", "reading",
         "supply has no channel 'power'; expected voltage or current"),
        ("{reading: source.current, above: 5, then: stop}", "above", "above: 5 has no unit, write it like '5 A'"),
        ("{reading: head.angle, above: 5, below: 1 V, then: stop}", "watch",
         "watch: above is 5, below is 1 V: they need the same unit"),
        ("{reading: unit_temperature, above: 5 °C, below: 5 °C, then: stop}", "watch",
         "watch: every value is above 5 °C or below 5 °C: no value would be good"),
        ("{rate_of: head.angle, over: 1 s, above: 5°, then: stop}", "above",
         "above: is in °, expected a quantity in °/s"),
        ("{rate_of: supply.voltage, over: 1 s, above: 5 V, then: stop}", "above",
         "above: is in V, expected a quantity in V/s"),
        ("{rate_of: unit_temperature, over: 0 s, above: 5 °C/min, then: hold}", "over",
         "over: is 0 s, expected more than 0 s"),
        ("{difference: [chamber.air, chamber.setpoint], above: 5 °C, then: stop}", "chamber.air",
         "chamber has no channel 'air'; expected process_value or set_point"),
        ("{difference: [supply.current, supply.voltage], above: 5 A, then: stop}", "difference",
         "supply.current is in A, supply.voltage is in V: their difference cannot be formed"),
        ("{difference: 5 °C, above: 5 °C, then: stop}", "difference",
         "difference: needs two readings, like [chamber.process_value, chamber.set_point]"),
        ("{age_of: head.angle, above: 0 s, then: stop}", "above", "above: is 0 s, expected more than 0 s"),
        ("{age_of: head.angle, above: 10 s, then: stop}", "above",
         "above: the newest value of head.angle is up to 10 s old in normal operation; expected more than that"),
        ("{age_of: unit_temperature, above: 30 s, then: abort, good_for: 0 s}", "watch",
         "watch: 'good_for' goes with hold and pause: after 'abort' the run does not go on"),
        ("{}", "watch",
         "watch: is empty, expected an interlock: a mapping whose first key names the monitored quantity"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_an_interlock_is_told_at_its_place(folder, entry, at, problem):
    column = f"  watch: {entry}".index(at) + 1
    assert f"{LINE}:{column}: {problem}" in problems(folder, watch=entry)


def test_every_mistake_is_told_at_once(folder):
    found = problems(folder, Hot=GOOD["hot"], x="{reading: supply.power, above: 5 W, then: stop}", y="{then: stop}")
    assert [problem.split(":")[0] for problem in found] == [str(LINE), str(LINE + 2)]
    found = problems(
        folder,
        x="{difference: [chamber.air, chamber.setpoint], above: 5 °C, then: stop}",
        y="{reading: source.current, above: 5, below: 1, then: stop}",
    )
    assert [problem.split(": ", 1)[1].split(";")[0] for problem in found] == [
        "chamber has no channel 'air'",
        "chamber has no channel 'setpoint'",
        "above: 5 has no unit, write it like '5 A'",
        "below: 1 has no unit, write it like '1 A'",
    ]


def test_a_named_reading_that_is_wrong_itself_is_told_once(folder):
    wrong = SHIPPED.replace("from: counter.Temperatures.Unit", "from: countr.Temperatures.Unit")
    (problem,) = problems(folder, wrong, **GOOD, odd="{reading: unit_temperature, above: 5 V, then: stop}")
    assert "there is no device 'countr'" in problem


def test_channels_have_their_names_units_and_usual_ages(folder):
    channels = channels_of(loaded(folder, **GOOD))
    assert channels["unit_temperature"] == channels["counter.Temperatures.Unit"]
    unit, air = channels["unit_temperature"], channels["chamber.process_value"]
    assert (unit.source, unit.unit, unit.usual_age_s) == ("counter.Temperatures.Unit", "°C", 11.0)
    assert (air.source, air.unit, air.usual_age_s) == ("chamber.process_value", "°C", 10.0)


@pytest.mark.parametrize("entry", GOOD.values())
def test_the_schema_takes_what_the_loader_takes(folder, entry):
    text = f"{SHIPPED}interlocks:\n  watch: {entry}\n"
    assert list(Draft202012Validator(bench_schema()).iter_errors(parse_document(text, folder).value)) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [("reading:", "readng:"), ("then: stop", "then: halt"), (", then: stop", ""), ("for: 5 s", "for: 5"),
     ("above:", "abov:"), ("85 °C", "[85 °C]"), ("unit_temperature", "Unit temperature")],
)  # fmt: skip
def test_the_schema_refuses_what_the_loader_refuses(folder, old, new):
    entry = GOOD["hot"].replace(old, new)
    assert problems(folder, watch=entry)
    text = f"{SHIPPED}interlocks:\n  watch: {entry}\n"
    assert list(Draft202012Validator(bench_schema()).iter_errors(parse_document(text, folder).value))


# Those of a sequence, beside those of the bench


def test_a_sequence_declares_interlocks_of_its_own_beside_those_of_the_bench(tmp_path, folder):
    bench = loaded(folder, **GOOD)
    body = f"{steps('{wait: 1 s}')}interlocks: {{warm: {GOOD['hot']}}}\n"
    assert list(plan_of(tmp_path, body, bench=bench).sequence.interlocks) == ["warm"]


def test_an_interlock_of_the_bench_cannot_be_replaced_by_a_sequence(tmp_path, folder):
    bench = loaded(folder, **GOOD)
    body = f"interlocks: {{hot: {GOOD['hot']}}}\n{steps('{wait: 1 s}')}"
    assert problems_of(tmp_path, body, bench=bench) == [
        "1:14: the bench 'Simulated accelerometer bench' has an interlock 'hot', which stays in force; "
        "name this one otherwise"
    ]


def test_without_a_bench_only_what_an_interlock_says_itself_is_checked(tmp_path):
    path = tmp_path / "s.yaml"
    text = "schema: itb-sequence/1\ntitle: T\nneeds: {}\nsteps: [wait: 1 s]\ninterlocks: {x: "
    path.write_text(f"{text}{{reading: oven.air, above: 5, then: stop}}}}\n", "utf-8")
    assert load_plan(path, None).sequence.interlocks["x"].names == ("oven.air",)
    path.write_text(f"{text}{{reading: oven.air, then: stop}}}}\n", "utf-8")
    with pytest.raises(InputError, match="x: needs above, or below, or both"):
        load_plan(path, None)
