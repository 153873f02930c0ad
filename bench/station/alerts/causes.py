"""Causes of alerts in the journal of a run, at its end, in the queue and in bench files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from datetime import date, timedelta

from bench.config.models import BenchFile
from bench.station.alerts.kinds import Cause, Kind
from bench.station.queue.items import Item, ItemState
from bench.station.runs.catalogue import request_of
from bench.store.latch import latch
from bench.store.reader import Event
from bench.store.runs import RUNNER, RunSummary

WELL_ENDED = "completed"


def of_event(run: RunSummary, event: Event, bench: str, *, historical: bool) -> Cause | None:
    """Return the cause of an alert in an entry of a journal; None if it is none."""
    data = event.data
    match event.kind:
        case "asked":
            kind, text, values = Kind.QUESTION, "question", {"text": data.get("text")}
        case "problem" | "unit_dropped":
            kind, text, values = Kind.ALARM, "alarm", {"text": data.get("text")}
        case "held" if str(data.get("by", "")).startswith("interlock"):
            kind, text, values = Kind.ALARM, "interlock", {"text": data.get("by")}
        case "device_left_out" | "not_reached":
            kind, text = Kind.DEVICE_LOST, "device_lost"
            values = {"device": data.get("device"), "text": data.get("text")}
        case _:
            return None
    texts = {key: str(value or "") for key, value in values.items()} | {"bench": _name(run, bench), "run": run.id}
    return Cause(
        kind, f"{run.id}#{event.seq}", run.id, text, texts, bench, f"runs/{run.id}", event.step, historical=historical
    )


def key_of_end(run: RunSummary) -> str:
    """Return the key of the end of a run; a run that was interrupted may go on, and end again."""
    begun: object = ""
    with suppress(OSError):
        begun = (run.path / RUNNER).stat().st_mtime_ns if run.state == "interrupted" else ""
    return f"{run.id}#end/{run.state}/{begun}"


def of_end(run: RunSummary, bench: str, *, has_program: bool, historical: bool) -> Cause:
    """Return the cause of an alert in a run that has ended; `has_program` if its bench file names an alert program."""
    verdict = str(run.manifest.get("verdict") or "no verdict")
    latched = latch(run)
    is_well = run.state == WELL_ENDED and latched is None
    problems = run.manifest.get("problems") or [""]
    values = {
        "bench": _name(run, bench), "title": str(run.manifest.get("title") or run.id), "verdict": verdict,
        "state": run.state, "text": latched.why if latched is not None else str(problems[0]),
    }  # fmt: skip
    reported = has_program and not run.manifest.get("simulated") and (
        not is_well or verdict != "PASS" or bool(request_of(run.manifest).get("unattended"))
    )  # fmt: skip
    text = "end" if is_well else "safe_stop" if latched is None else "latched"
    return Cause(
        Kind.END if is_well else Kind.SAFE_STOP, key_of_end(run), run.id, text, values, bench, f"runs/{run.id}",
        by_program=reported, historical=historical,
    )  # fmt: skip


def of_item(item: Item) -> Cause | None:
    """Return the cause of an alert in an item that was refused, or held without a person; None if it is neither."""
    if item.state is ItemState.REFUSED:
        text = "item_refused"
    elif item.state is ItemState.HELD and not item.held_by:
        text = "item_held"
    else:
        return None
    bench = item.submission.bench
    values = {"bench": bench, "number": str(item.number), "title": item.title, "text": item.reason}
    return Cause(Kind.ITEM_REFUSED, f"item/{item.id}/{item.version}", bench, text, values, bench, "queue")


def of_stop(bench: str, reason: str, since: str) -> Cause:
    """Return the cause of an alert in a bench at which no further item begins."""
    return Cause(
        Kind.BENCH_STOPPED, f"stopped/{bench}/{since}", bench, "bench_stopped", {"bench": bench, "text": reason}, bench,
        f"benches/{bench}",
    )  # fmt: skip


def calibrations(bench: BenchFile, today: date, within_days: int) -> dict[str, date]:
    """Return the devices and readings whose calibration is due within some days or past due."""
    return bench.past_due(today + timedelta(days=within_days + 1))


def of_calibrations(bench: str, due: Mapping[str, date], today: date) -> Cause | None:
    """Return the cause of an alert in due calibrations; another one when one more is due, or past due."""
    if not due:
        return None
    parts = [f"{name} {'was due' if on < today else 'is due'} on {on}" for name, on in sorted(due.items())]
    key = f"due/{bench}/{json.dumps(parts)}"
    values = {"bench": bench, "text": "; ".join(parts)}
    return Cause(Kind.CALIBRATION_DUE, key, bench, "calibration_due", values, bench, f"benches/{bench}")


def _name(run: RunSummary, bench: str) -> str:
    return bench or str(run.manifest.get("bench") or run.id)
