"""Short runs of channels over temperature and input level, on any of the benches that have one."""

from __future__ import annotations

import json

from campaigns.truth.campaign import full_bench
from tests.support.runs import read_json, run_short

SHORT = (
    "low=20 °C", "high=29 °C", "ramp_rate=30 °C/h", "return_rate=3 °C/min", "time_constant=1 min", "point=1 min",
)  # fmt: skip
FULL = (*SHORT, "warm_up=30 min", "source_warm_up=10 min")
SOURCE = (*SHORT, "source_warm_up=0 s", "levels=[1 g]")


def ran(folder, sequence, settings, *edits, bench="channel", answers=None, **options):
    bench = full_bench(folder / "config", bench)
    for name, old, new in edits:
        path = bench.parent / name
        text = path.read_text("utf-8")
        assert old in text, old
        path.write_text(text.replace(old, new), "utf-8")
    if answers is not None:
        options["answers"] = folder / "answers.yaml"
        options["answers"].write_text("schema: itb-answers/1\nanswers: " + json.dumps(answers) + "\n", "utf-8")
    return run_short(folder / "runs", bench=bench, sequence=sequence, settings=settings, **options)


def findings(result):
    """The findings of the unit in place a, by what their ids end with."""
    return {each["id"].removeprefix("channel/a/"): each for each in read_json(result, "results.json")["findings"]}
