"""Runs that are killed at any moment of virtual time and resumed: nothing is lost, and nothing is done twice."""

from __future__ import annotations

import random
import tempfile
from collections.abc import Iterator
from pathlib import Path

from bench.app.request import RunRequest, prepare
from bench.app.resume import read_interrupted
from bench.sequence.plan.dwells import first_visit
from bench.store.verify import examine
from campaigns.trials.rows import Row
from tests.support.killed import ended, interrupted, interrupted_again, journal, resumed
from tests.support.runs import ROOT

RUNS = {
    "tumble_static": "simulated", "imu_24_position": "imu", "ramp_dynamic": "simulated", "channel_full": "channel",
}  # fmt: skip
PRESET = "quick"
OF_EACH = 50
TWICE = 5  # of each
AS_WISHED = "complete, each acquisition once, the record intact"
VERDICTS = ("PASS", "INCOMPLETE")


def trials(scale: float) -> Iterator[Row]:
    """A row for each sequence, and one for runs that are killed again while or after they are resumed."""
    moments = random.Random(22)
    for sequence in RUNS:
        shares = [moments.random() for _ in range(OF_EACH)][: max(1, round(OF_EACH * scale))]
        yield _row(f"{sequence} killed and resumed", [(sequence, share, None) for share in shares])
    again = [(sequence, moments.random(), moments.random()) for sequence in RUNS for _ in range(TWICE)]
    yield _row("killed again when resumed", again[: max(1, round(len(again) * scale))])


def _row(line: str, some: list[tuple[str, float, float | None]]) -> Row:
    wrong = []
    for sequence, share, again in some:
        with tempfile.TemporaryDirectory() as folder:
            found = killed(Path(folder), sequence, share, again)
        if found:
            wrong.append(f"{sequence} at {share:.4f}{'' if again is None else f' and {again:.4f}'}: {found}")
    return Row(line, len(some), "; ".join(wrong) or AS_WISHED, not wrong)


def killed(folder: Path, sequence: str, share: float, again: float | None) -> str:
    """Problem of a run that was killed after a share of its time; "" for none."""
    bench = ROOT / "config" / f"{RUNS[sequence]}.yaml"
    prepared = prepare(RunRequest(sequence, bench=str(bench), preset=PRESET))
    at_s = share * prepared.expected.total_s
    path = interrupted(folder, at_s, sequence, bench, preset=PRESET)
    if again is not None:
        interrupted_again(path, at_s + 7300.0 + again * (prepared.expected.total_s - at_s))
    under_way = set(read_interrupted(path).past.under_way)
    result = resumed(path)
    if result.outcome.how != "completed" or result.outcome.problems or result.outcome.unsafe:
        return "; ".join(result.problems)
    entries = journal(path)
    wanted = {planned.id for planned in prepared.plan if planned.id.endswith("acquire") and planned.phase != "teardown"}
    counted = ended([entry for entry in entries if first_visit(entry.step) in wanted])
    if counted.keys() != wanted or any(count > 1 for step, count in counted.items() if not _inside(step, under_way)):
        return f"acquisitions missing or repeated: {sorted(wanted ^ counted.keys())[:3]} {counted.most_common(3)}"
    if damage := examine(path).damage:
        return "; ".join(damage)
    verdict = result.results.verdict if result.results is not None else "no results"
    return "" if verdict in VERDICTS else f"verdict {verdict}"


def _inside(step: str, under_way: set[str]) -> bool:
    return any(step.startswith(f"{outer}/") for outer in under_way)
