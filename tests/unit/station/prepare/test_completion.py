"""Completion: what may stand at a cursor, marked | in a text that is not finished."""

from __future__ import annotations

import pytest

from bench.config.load import find
from bench.sequence.steps.verbs import BLOCKS
from bench.station.prepare.completion import complete
from tests.support.runs import ROOT

HEAD = """\
schema: itb-sequence/1
title: x
needs:
  chamber: thermal_chamber
  head: positioner
  out: output
parameters:
  gate: {help: long, default: 5 s}
"""


def options(marked):
    at = marked.index("|")
    found = complete(marked[:at] + marked[at + 1 :], at, find("simulated", "config"))
    return [each.label for each in found.options], marked[found.start : at]


@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        ("schema: |", {"itb-sequence/1"}),
        (f"{HEAD}st|\n", {"steps", "teardown", "results"}),
        (f"{HEAD}steps:\n  - ramp: |", {"chamber"}),
        (f"{HEAD}steps:\n  - ramp: ch|\n    to: 5 °C\n", {"chamber"}),
        (f"{HEAD}steps:\n  - {{ramp: chamber, to: 5 °C, a|", {"at", "timeout"}),
        (f"{HEAD}steps:\n  - {{ramp: chamber, to: 5 °C, a|}}\n  - wait: 5 s\n", {"at"}),
        (f"{HEAD}steps:\n  - acquire: out\n    l|: tumble\n", {"label"}),
        (f"{HEAD}steps:\n  - acquire: out\n    on_failure: |", {"stop", "continue", "ask"}),
        (f"{HEAD}steps:\n  - soak: t\n    until_stable: {{|}}\n", {"band", "slope", "hold"}),
        (f"{HEAD}steps:\n  - for_each: at\n    in: [1°]\n    steps:\n      - {{move: head, to: '${{|", {"gate", "at"}),
        (f"{HEAD}results:\n  - method: |", {"temperature_tumble"}),
        (f"{HEAD}results:\n  - method: temperature_tumble\n    settings: {{|}}", {"degree"}),
        (f"{HEAD}results:\n  - method: temperature_tumble\n    limits:\n      |", {"K0", "misalignment"}),
        (f"{HEAD}steps:\n  - {{acquire: out, label: rest}}\nresults:\n  - method: threshold\n    data: |", {"rest"}),
        ("needs:\n  |", {"chamber", "counter", "unit_temperature"}),
    ],
)  # fmt: skip
def test_what_the_schema_and_the_bench_allow_is_offered(typed, expected):
    found, _ = options(typed)
    assert expected <= set(found)


def test_a_step_begins_with_its_verb_and_then_has_its_own_keys_alone():
    assert options(f"{HEAD}steps:\n  - ra|") == (list(BLOCKS), "ra")
    found, word = options(f"{HEAD}steps:\n  - ramp: chamber\n    |")
    assert set(found) == {"timeout", "on_failure", "to", "at"}
    assert word == ""
    assert "at" not in options(f"{HEAD}steps:\n  - {{ramp: chamber, at: 1 °C/min, |}}")[0]


def test_the_capability_of_the_device_of_the_bench_comes_first():
    assert options("needs:\n  head: |")[0][:2] == ["positioner", "rate_table"]


def test_settings_are_those_of_the_method():
    assert "degree" not in options(f"{HEAD}results:\n  - method: gyro_range\n    settings: {{|}}")[0]


@pytest.mark.parametrize(
    "text",
    ["", "\0", "a: [", "[" * 5000, "{" * 5000, "- " * 5000, "&a [*a, *a]", "!!python/name:os.system x", "%TAG ! x\n",
     "a: 'x", "? a\n: ", "\ud800", "---\n---\n", "a: b: c: "],
)  # fmt: skip
def test_hostile_text_offers_something_or_nothing(text):
    for at in {0, len(text) // 2, len(text)}:
        complete(text, at, None)


def test_every_place_of_a_shipped_sequence_can_be_completed():
    text = (ROOT / "sequences/smoke.yaml").read_text("utf-8")
    lines = [at for at, letter in enumerate(text) if letter == ":" and "#" not in text[:at].rpartition("\n")[2]]
    assert len(lines) > 50
    offered = [bool(complete(text, at, None).options) for at in lines]
    assert sum(offered) > 0.7 * len(lines)  # not the names of parameters and of quantities
