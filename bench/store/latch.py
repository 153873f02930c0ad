"""Latch of runs that did not end by themselves with everything safe, until a person acknowledges it.

The latch is derived from the records. An acknowledgement names the latched state, so that a new incident latches the
run again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from bench.clock import wall_utc
from bench.errors import InputError, StoreError
from bench.files import append_line
from bench.store.energised import energised
from bench.store.followed import FOLLOWED, read_lines
from bench.store.machine_state import printable
from bench.store.runs import RunSummary, summary
from bench.store.signed import check_signed
from bench.store.unsafe import read_unsafe

INCIDENT, ACKNOWLEDGED = "incident.jsonl", "acknowledged.jsonl"


class Latch(NamedTuple):
    """Reasons of a latch, and the identifier that an acknowledgement refers to."""

    why: str
    key: str


def latch(run: RunSummary) -> Latch | None:
    """Return the latch of a run, or None if nothing happened or it was acknowledged."""
    ended = {str(role): str(why) for role, why in run.manifest.get("unsafe", {}).items()}
    unsafe = {**read_unsafe(run.path), **ended}
    incident = [entry for entry in read_lines(run.path / INCIDENT) if entry.get("event") not in ("alert", "alarm")]
    late = [entry for entry in read_lines(run.path / FOLLOWED) if entry.get("event", "not_arrived") == "not_arrived"]
    if not unsafe and not incident and not late:
        return None
    found = [unsafe, incident, *late]
    key = hashlib.sha256(json.dumps(found, sort_keys=True).encode()).hexdigest()
    if any(each.get("latch") == key for each in read_lines(run.path / ACKNOWLEDGED)):
        return None
    return Latch("; ".join(map(printable, [*_reasons(unsafe, incident), *_not_arrived(late)])), key)


def _reasons(unsafe: dict[str, str], incident: list[dict[str, Any]]) -> Iterator[str]:
    yield from (f"{role} could not be made safe: {why}" for role, why in unsafe.items())
    begins = [each for each in incident if each.get("event") == "begins"]
    if begins:
        yield f"its guardian made the bench safe: {begins[-1].get('why', '')}"
    elif incident:
        yield f"its guardian has written {INCIDENT}"
    for each in incident:
        if each.get("event") == "ends" and (left := each.get("unsafe")):
            yield f"the guardian could not make {', '.join(left) if isinstance(left, Mapping) else left} safe"


def _not_arrived(late: list[dict[str, Any]]) -> Iterator[str]:
    for each in late:
        yield f"{each.get('role', 'a chamber')} has not arrived at its safe set point: {each.get('why', 'unreadable')}"


def acknowledge(path: Path, by: str, reason: str, is_followed: Callable[[str], bool] = lambda _address: False) -> str:
    """Acknowledge a latched run, durably; return the reasons. Raises InputError if it cannot be acknowledged.

    Instruments at addresses for which `is_followed` is true may still be on: a guardian holds them.
    """
    run = summary(path)
    if run.state == "running":
        raise InputError(f"{run.id}: is under way; it can be acknowledged when it has ended")
    found = latch(run)
    if found is None:
        raise InputError(f"{run.id}: is not latched, or was acknowledged before")
    check_signed(by, reason)
    _check_switched_off(run, is_followed)
    line = {
        "at": wall_utc().isoformat(timespec="seconds"), "by": by, "reason": reason, "of": found.why, "latch": found.key,
    }  # fmt: skip
    try:
        append_line(path / ACKNOWLEDGED, json.dumps(line, ensure_ascii=False))
    except OSError as problem:
        raise StoreError(f"{path / ACKNOWLEDGED}: cannot be written ({problem})") from problem
    return found.why


def _check_switched_off(run: RunSummary, is_followed: Callable[[str], bool]) -> None:
    """Raise InputError if an instrument of the run may be on, or if that is not known."""
    problems: list[StoreError] = []
    for each in energised(problems.append):
        left = [role for role, address in each.connections.items() if not is_followed(address)]
        if left and Path(each.run).resolve() == run.path.resolve():
            raise InputError(
                f"{run.id}: {printable(', '.join(left))} may still be energised. Make the bench safe first: bench "
                f"make-safe --bench {printable(each.bench)}"
            )
    if problems:
        raise InputError(
            f"{run.id}: whether its instruments are off is not known: {problems[0]}. Make the bench safe with 'bench "
            "make-safe --bench FILE', then remove that file"
        )
