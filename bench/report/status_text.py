"""Text output of `bench status` and `bench runs`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from bench.figures.columns import in_columns
from bench.figures.times_and_sizes import duration
from bench.store.latch import latch
from bench.store.runs import RunSummary

HEADER = ("run", "state", "verdict", "units", "operator")


def status_lines(run: RunSummary, status: Mapping[str, Any]) -> Iterator[str]:
    """Lines on a run, from the JSON of its status; a line without a value is left out."""
    verdict = f", {status['verdict']}" if status.get("verdict") else ""
    yield f"{run.id}: {status['state']}{verdict}"
    yield from in_columns([(name, text) for name, text in _facts(run, status) if text], "<<")
    if readings := list(_readings(status)):
        yield ""
        yield from in_columns(readings, "<><>")


def _facts(run: RunSummary, status: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Names and values, in the order of a technician's questions."""
    for question in status.get("questions", ()):
        yield "waits for an answer", f"{question['text']} ({question['expected']}): bench answer {run.id} ANSWER"
    if latched := status.get("latched"):
        yield "latched", f"{latched}: bench acknowledge {run.id} --reason TEXT"
    yield "held by", ", ".join(status["held_by"])
    yield from (("step", step) for step in status["under_way"])
    yield "steps done", str(status["done"])
    yield "units", ", ".join(run.units)
    yield from (("measured", f"{name} = {value}") for name, value in status["variables"].items())
    yield from (("outside its limits", step) for step in status["limits_failed"])
    yield from (("left out", step) for step in status["left_out"])
    yield from (("dropped", f"{place}: {text}") for place, text in status["dropped"].items())
    yield from (("lost on the bus", f"{name}: {count} latches or samples") for name, count in status["lost"].items())
    yield from (("made safe", f"{role}: {course}") for role, course in status.get("made_safe", {}).items())
    yield from (("problem", line) for text in status["problems"] for line in text.splitlines())


def _readings(status: Mapping[str, Any]) -> Iterator[tuple[str, str, str, str]]:
    """Name, value, unit and age of the newest readings; for an invalid or stale one the reason instead."""
    for name, reading in status.get("readings", {}).items():
        if "value" not in reading:
            yield name, reading["quality"], "", reading["why"]
            continue
        age = f"{duration(max(0.0, status['now_s'] - reading['at_s']))} ago"
        yield name, f"{reading['value']:.6g}", reading["unit"], age


def runs_table(runs: Sequence[RunSummary]) -> Iterator[str]:
    """A header and a line for each run."""
    rows = []
    for run in runs:
        verdict, operator = (run.manifest.get(key) or "-" for key in ("verdict", "operator"))
        state = run.state if latch(run) is None else f"{run.state}, latched"
        rows.append((run.id, state, verdict, ", ".join(run.units), operator))
    yield from in_columns([HEADER, *rows], "<<<<<", indent="")
