"""Rules on plans as a whole where the bench decides, and the forms in which a check is told."""

from __future__ import annotations

import json
import math
import re
import shutil
from collections import namedtuple
from itertools import combinations

import pytest

from bench.app.request import RunRequest, load_checked
from bench.config.bench import load_bench
from bench.errors import InputError
from bench.methods.tumble.rules import _dwells, _inseparable
from bench.reduce.acquisitions import run_data
from bench.sequence.checks.output import RENDERERS, Shown
from bench.sequence.load import load_judged_plan
from bench.store.reader import RunReader
from drivers.can.dbc_outline import lengths_bits
from tests.support.runs import copy_bench, run_short
from tests.support.sequences import BENCH, ROOT, plan_of, steps

REAL = load_bench(ROOT / "config/simulated_wires.yaml").bench
HEAD = "schema: itb-sequence/1\ntitle: T\n"
NOISE = "thermometer: {noise: 0.005 °C"


def rules_of(folder, body, bench=BENCH, tail=HEAD):
    """Place and rule of each warning."""
    path = folder / "s.yaml"
    path.write_text(body + tail, "utf-8")
    plan, warnings = load_judged_plan(path, bench)
    return [(plan.document.mark(warning.place).line, warning.rule) for warning in warnings]


def soak(band):
    stable = f"{{band: {band}, slope: 1 °C/h, hold: 1 min}}"
    soaking = f"{{soak: unit_temperature, at_least: 5 s, give_up_after: 1 h, until_stable: {stable}}}"
    return steps(soaking) + "needs: {unit_temperature: thermometer}\n"


def test_a_band_is_held_against_the_noise_of_a_simulated_thermometer_only(tmp_path):
    noisy = load_bench(copy_bench(tmp_path / "config", (NOISE, "thermometer: {noise: 0.05 °C"))).bench
    assert rules_of(tmp_path, soak("0.2 °C"), noisy) == [(2, "soak-never-stable")]
    assert rules_of(tmp_path, soak("0.31 °C"), noisy) == []
    assert rules_of(tmp_path, soak("0.02 °C"), BENCH) == [(2, "soak-never-stable")]
    assert rules_of(tmp_path, soak("0.02 °C"), REAL) == []


def test_a_chamber_has_no_noise_of_a_thermometer_at_a_unit(tmp_path):
    reading = "readings:\n  air: {from: chamber.process_value}\n"
    bench = load_bench(copy_bench(tmp_path / "config", ("readings:\n", reading))).bench
    body = soak("0.02 °C").replace("unit_temperature", "air")
    assert rules_of(tmp_path, body, bench) == []


def test_a_place_without_a_window_has_no_limit_to_be_below_of(tmp_path):
    on = steps("{set: supply, voltage: 5 V, current_limit: 10 mA, output: on}")
    body = on + "needs: {supply: power_supply}\nteardown: [{set: supply, output: off}]\n"
    window = "    supply_current: {min: 30 mA, max: 110 mA}"
    without = load_bench(copy_bench(tmp_path / "config", (window, "   "))).bench
    assert rules_of(tmp_path, body) == [(2, "limit-below-window")]
    assert rules_of(tmp_path, body, without) == []


def test_units_on_one_supply_are_held_against_it_together(tmp_path):
    shutil.copytree(ROOT / "config", tmp_path / "config")
    path = tmp_path / "config" / "three_units.yaml"
    text = path.read_text("utf-8").replace("current: {max: 200 mA}", "current: {max: 1 A}")
    path.write_text(text.replace("supply: supply_b\n", "supply: supply_a\n"), "utf-8")
    bench = load_bench(path).bench
    assert [bench.current_range(f"supply_{place}") for place in "abc"] == [
        (0.06, 0.22),
        (-math.inf, math.inf),
        (0.03, 0.11),
    ]
    teardown = "needs: {supply: power_supply}\nteardown: [{set: supply, output: off}]\n"
    for limit, expected in (("200 mA", [(2, "limit-below-window")]), ("220 mA", [])):
        on = steps(f"{{set: supply, voltage: 5 V, current_limit: {limit}, output: on}}")
        assert rules_of(tmp_path, on + teardown, bench) == expected
    on = steps("{set: supply, voltage: 5 V, current_limit: 120 mA, output: on}")
    (tmp_path / "s.yaml").write_text(on + teardown + HEAD, "utf-8")
    (warning,) = load_judged_plan(tmp_path / "s.yaml", bench)[1]
    assert warning.text == (
        "the supply stops at 0.12 A, the units on it, in places 'a' and 'b', together may draw 0.22 A, so that their "
        "supply windows never detect that they draw too much. Give a current_limit of at least 0.22 A, or lower "
        "places.a.supply_current.max of the bench file [limit-below-window]"
    )


def test_a_warning_of_every_pass_of_a_loop_is_told_once_with_the_first(tmp_path):
    on = "{set: supply, voltage: 5 V, current_limit: '${i}', output: on}"
    path = tmp_path / "s.yaml"
    path.write_text(
        f"{HEAD}needs: {{supply: power_supply}}\nteardown: [{{set: supply, output: off}}]\n"
        + steps(f"{{for_each: i, in: [10 mA, 20 mA, 10 mA], steps: [{on}]}}"),
        "utf-8",
    )
    (warning,) = load_judged_plan(path, BENCH)[1]
    assert warning.problem.startswith("the supply stops at 0.01 A, ")


def test_rules_are_for_plans_that_lack_nothing(tmp_path):
    on = "{set: supply, voltage: 5 V, current_limit: 110 mA, output: on}"
    with pytest.raises(InputError) as caught:
        plan_of(tmp_path, steps(on, "wait: 5"))
    assert [problem.split(": ", 1)[1] for problem in caught.value.problems] == [
        "wait: 5 has no unit, write it like '5 s'"
    ]
    assert len(plan_of(tmp_path, steps(on), bench=None)) == 1


def test_each_dwell_is_looked_at_for_its_angles(tmp_path):
    """Beside each other in one block two ramps begin two dwells, as in the record of a run."""
    tumble = [line for angle in ("0°", "90°", "180°", "270°")
              for line in (f"{{move: head, to: {angle}}}", "{acquire: counter, for: 5 s, label: x}")]  # fmt: skip
    ramps = ["{ramp: chamber, to: 20 °C, at: 1 °C/min}", "{ramp: chamber, to: 30 °C, at: 1 °C/min}"]
    tail = "teardown: [{move: head, to: 0°}]\nresults: [{method: temperature_tumble, data: x, settings: {degree: 1}}]\n"
    assert len(plan_of(tmp_path, steps(ramps[0], *tumble, ramps[1], *tumble) + tail)) == 19
    with pytest.raises(InputError, match="has 2 in steps/ramp#2: K0, K1, misalignment and K2 cannot be separated"):
        plan_of(tmp_path, steps(ramps[0], *tumble, ramps[1], *tumble[:4]) + tail)


def test_dwells_are_those_of_the_record_of_a_run(tmp_path):
    run = run_short(tmp_path, sequence="smoke", settings=("temperatures=[20 °C, 22 °C, 20 °C]",))
    plan, _ = load_judged_plan(run.path / "sequence.yaml", BENCH, settings=("temperatures=[20 °C, 22 °C, 20 °C]",))
    with RunReader(run.path) as reader:
        recorded = run_data(reader, BENCH, {"a": "SIM-A"}, "tumble").acquisitions
    dwells = _dwells(plan, BENCH, "tumble")
    assert [group for group, (_, angles) in dwells.items() for _ in angles] == [done.group for done in recorded]
    assert [at for _, positions in dwells.values() for at in positions] == [
        (done.angle_deg, False) for done in recorded
    ]
    assert [set_c for set_c, _ in dwells.values()] == [20, 22, 20]


def test_whatever_angles_there_are_the_constants_that_cannot_be_told_apart_are_named():
    for count in (1, 2, 3):
        for angles_deg in combinations(range(0, 360, 30), count):
            names = _inseparable(list(angles_deg), BENCH).removesuffix(" cannot be separated").replace(" and ", ", ")
            assert 2 <= len(names.split(", ")) <= 4, angles_deg
    assert _inseparable([0, 90, 180], BENCH) == "K1 and K2 cannot be separated"  # sin θ = sin² θ at all three
    assert _inseparable([0, 90, 270], BENCH) == "K0, misalignment and K2 cannot be separated"


def test_the_thermometer_of_a_result_need_not_be_soaked_on_and_others_must(tmp_path):
    needs = "needs: {counter: pulse_counter, source: current_source, unit_temperature: thermometer}\n"
    assert rules_of(tmp_path, "steps: [wait: 1 s]\n" + needs) == [
        (2, "unused-need"), (2, "unused-need"), (2, "unused-need"),
    ]  # fmt: skip


# The disk


@pytest.mark.parametrize(("free_bytes", "rules"), [(10_000, ["little-disk-space"]), (10**12, [])])
def test_a_disk_too_small_for_the_run_is_told_before_it_begins(tmp_path, monkeypatch, free_bytes, rules):
    asked = []
    usage = namedtuple("usage", "free")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: asked.append(path) or usage(free_bytes))
    warnings = load_checked(RunRequest("smoke", runs=tmp_path / "not" / "yet")).warnings
    assert [warning.rule for warning in warnings] == rules
    assert asked == [tmp_path]
    assert [f"{tmp_path} has 0 MB left" in warning.problem for warning in warnings] == [True] * len(rules)


# Counters


@pytest.mark.parametrize(
    ("bits", "problem"),
    [
        (14, "'AxisY.Negative' has 14 bits and wraps around after 16384 pulses; max_rate gives up to 25600 in a "
        "period: "
             "shorten the period, or use a longer signal"),
        (15, ""),
    ],
)  # fmt: skip
def test_a_counter_that_may_come_round_between_two_latches_is_refused(tmp_path, bits, problem):
    path = copy_bench(tmp_path)
    dbc = tmp_path / "if_counter.dbc"
    y = 'BO_ 258 AxisY: 8 COUNTER\n SG_ Positive : 0|24@1+ (1,0) [0|16777215] "pulse" BENCH\n SG_ Negative : 24|24@1+'
    text = dbc.read_text("ascii")
    assert y in text
    dbc.write_text(text.replace(y, y.replace("|24@", f"|{bits}@")), "ascii")
    if problem:
        with pytest.raises(InputError) as caught:
            load_bench(path)
        reported = caught.value.problems
        assert len(reported) == 2, "both counts of the axis"
        assert reported[1].endswith(f": negative: {problem}")
    else:
        load_bench(path)


@pytest.mark.parametrize(
    ("change", "refused"),
    [
        (lambda text: text, False),
        (lambda text: text.replace("channel: ax}", "channel: gz}"), False),
        (lambda text: re.sub(r"      positions: .*\n        table: .*\n", "", text), True),
        (lambda text: re.sub(r"(AxisY.Sequence, period:) 2 ms", r"\1 4 ms", text), True),
    ],
    ids=["as shipped", "latched with a gyro", "no encoder", "two periods"],
)  # fmt: skip
def test_channels_that_are_sent_are_sampled_together_with_the_encoder(tmp_path, change, refused):
    shutil.copytree(ROOT / "config", tmp_path / "config")
    path = tmp_path / "config/table_imu_telemetry.yaml"
    path.write_text(change(path.read_text("utf-8")), "utf-8")
    bench = load_bench(path).bench
    if refused:
        with pytest.raises(InputError, match="sampled together, and the encoder of 'table' latched with the samples"):
            load_judged_plan(ROOT / "sequences/table_full.yaml", bench, preset="quick")
    else:
        load_judged_plan(ROOT / "sequences/table_full.yaml", bench, preset="quick")


def test_lengths_are_those_that_cantools_reads():
    import cantools

    text = (ROOT / "config/if_counter.dbc").read_text("ascii")
    theirs = cantools.database.load_string(text, "dbc")
    assert lengths_bits(text) == {
        f"{message.name}.{signal.name}": signal.length for message in theirs.messages for signal in message.signals
    }
    assert lengths_bits('BO_ 1 A: 8 X\n SG_ B : rubbish "V" X\n') == {}


# How it is told

ERROR = Shown.of_error("a folder/ü,1.yaml:7:3: 100 % wrong. Do better [left-energised]")


@pytest.mark.parametrize(
    ("problem", "shown"),
    [
        ("s.yaml:7:3: to: 5 has no unit, write it like '5 °'",
         Shown("error", "input", "s.yaml", 7, 3, "to: 5 has no unit, write it like '5 °'")),
        ("a:1:b.yaml:7:3: odd [rule] name [left-cold]",
         Shown("error", "left-cold", "a:1:b.yaml", 7, 3, "odd [rule] name")),
        ("nowhere.yaml: there is no such file",
         Shown("error", "input", None, 1, 1, "nowhere.yaml: there is no such file")),
        ("--set a=[5]: no parameter [5]", Shown("error", "input", None, 1, 1, "--set a=[5]: no parameter [5]")),
    ],
)  # fmt: skip
def test_a_problem_is_taken_apart_into_place_text_and_rule(problem, shown):
    assert Shown.of_error(problem) == shown


def test_sarif_says_what_the_standard_requires():
    log = json.loads(RENDERERS["sarif"]([ERROR, ERROR, Shown.of_error("--set a: no")]))
    assert log["version"] == "2.1.0"
    (run,) = log["runs"]
    assert run["tool"]["driver"] == {
        "name": "bench check",
        "rules": [
            {"id": "left-energised", "shortDescription": {"text": "the teardown switches every output off"}},
            {"id": "input"},
        ],
    }
    first, _, last = run["results"]
    assert first == {
        "ruleId": "left-energised",
        "level": "error",
        "message": {"text": "100 % wrong. Do better"},
        "locations": [{
            "physicalLocation": {
                "artifactLocation": {"uri": "a%20folder/%C3%BC%2C1.yaml"}, "region": {"startLine": 7, "startColumn": 3},
            },
        }],
    }  # fmt: skip
    assert "locations" not in last


def test_an_absolute_path_is_a_file_uri():
    (result,) = json.loads(RENDERERS["sarif"]([Shown.of_error("/a b/s.yaml:1:2: no")]))["runs"][0]["results"]
    assert result["locations"][0]["physicalLocation"]["artifactLocation"]["uri"] == "file:///a%20b/s.yaml"


def test_a_workflow_command_escapes_what_has_a_meaning_in_it():
    assert RENDERERS["github"]([ERROR]) == (
        "::error file=a folder/ü%2C1.yaml,line=7,col=3::100 %25 wrong. Do better [left-energised]"
    )
    assert RENDERERS["github"]([Shown.of_error("there is no preset 'p'")]) == (
        "::error::there is no preset 'p' [input]"
    )


def test_every_form_tells_nothing_of_nothing():
    assert {name: render([]) for name, render in RENDERERS.items() if name != "sarif"} == {"github": ""}
