"""What a sine asks of a table and a current of a source, before anything moves."""

from __future__ import annotations

import pytest

from bench.config.bench import load_bench
from bench.sequence.load import load_judged_plan
from tests.support.sequences import BENCH, ROOT, plan_of, problems_of, steps

TABLE = load_bench(ROOT / "config/rate_table.yaml").bench
TAIL = "schema: itb-sequence/1\ntitle: T\nneeds: {table: rate_table}\n"


def nominal(**keys):
    """The shipped bench, its unit made to be otherwise."""
    place = BENCH.places["a"]
    changed = place.model_copy(update={"nominal": place.nominal.model_copy(update=keys)})
    return BENCH.model_copy(update={"places": {"a": changed}})


@pytest.mark.parametrize(
    ("sine", "problem"),
    [
        # 2 pi 2 Hz 90 deg = 1131 deg/s; the most is 90 x 1000 / 1131 = 79.6 deg
        ("amplitude: 90°, frequency: 2 Hz", "at 2 Hz, 1130.97335529 °/s is above the 1000 °/s that the bench file "
         "allows 'table'; the largest possible amplitude is 79.6° goes there"),
        # (2 pi 20 Hz)^2 0.25 deg = 3948 deg/s^2 = 68.90 rad/s^2, which 0.3 kg m^2 turn into 20.67 N m
        ("amplitude: 0.25°, frequency: 20 Hz", "20.6708511202 N·m is above the 20 N·m"),
        ("amplitude: 0.001°, frequency: 5 Hz", "is less than 20 counts of the encoder; expected at least 0.002°"),
        ("amplitude: 0.1°, frequency: 30 Hz", "30 Hz is above the 25 Hz that the bench file allows 'table'"),
        ("amplitude: 90°, sweep: {from: 0.5 Hz, to: 2 Hz}", "at 2 Hz, 1130.97335529 °/s is above the 1000 °/s"),
    ],
)  # fmt: skip
def test_a_sine_is_held_against_what_the_table_can_do(tmp_path, sine, problem):
    found = problems_of(tmp_path, steps(f"{{oscillate: table, {sine}, for: 10 s}}"), tail=TAIL, bench=TABLE)
    assert problem in "\n".join(found)


def test_a_sine_within_all_limits_is_good(tmp_path):
    line = "{oscillate: table, amplitude: 0.2°, frequency: 10 Hz, for: 10 s}"
    assert len(plan_of(tmp_path, steps(line), tail=TAIL, bench=TABLE)) == 1


def current(level):
    return f"{{set: source, {level}, compliance: 5 V, output: on}}"


@pytest.mark.parametrize(
    ("level", "keys", "problem"),
    [
        ("acceleration: 1 g, place: a", {"load": 5000.0}, "the unit in place 'a' needs 5.65 V for it, the compliance"),
        ("current: 2 mA", {"load": 5000.0}, "the unit in place 'a' needs 10 V for it"),
        ("current: 2 mA", {"max_current": 1e-3}, "0.002 A is more than the 0.001 A that the unit in place 'a' takes"),
        ("acceleration: 20 g, place: a", {}, "0.0226 A is above the 0.02 A that the bench file allows 'source'"),
        ("acceleration: 1 g, place: b", {}, "the bench has no unit in place 'b'"),
    ],
)  # fmt: skip
def test_a_current_is_held_against_the_unit_and_the_source(tmp_path, level, keys, problem):
    found = problems_of(tmp_path, steps(current(level)), bench=nominal(**keys))
    assert problem in "\n".join(found)


def test_a_current_that_the_unit_takes_is_good(tmp_path):
    off = "teardown: [{set: source, output: off}]\n"
    body = steps(current("acceleration: 1 g, place: a")) + off
    assert len(plan_of(tmp_path, body, bench=nominal(load=1000.0))) == 2


def test_an_acquisition_of_a_unit_whose_output_falls_is_as_short_as_of_one_whose_output_rises(tmp_path):
    (tmp_path / "s.yaml").write_text((ROOT / "tests/broken/rule_short_acquisition.yaml").read_text("utf-8"), "utf-8")
    for bench in (BENCH, nominal(K1=-BENCH.places["a"].nominal.K1)):
        (warning,) = (
            each for each in load_judged_plan(tmp_path / "s.yaml", bench)[1] if each.rule == "short-acquisition"
        )
        assert "one count of the unit in place 'a' is 1.47 µg" in warning.text
