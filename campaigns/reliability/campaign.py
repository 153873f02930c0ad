"""Order of trials and their outcomes: a file to which every result is appended."""

from __future__ import annotations

import json
import subprocess
import sys
import time
import traceback
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import suppress
from datetime import UTC, datetime
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from campaigns.reliability.kept import Result, read_kept
from campaigns.reliability.scorecard import LINES, Line
from tests.support.runs import ROOT

FILE = ROOT / "build" / "reliability" / "results.jsonl"
KEPT = ROOT / "campaigns" / "reliability" / "results.tsv"
TRIALS_OF_A_PROCESS = 20  # after which another one takes its place, with memory of its own


class Results:
    """The last result of each trial: those that are kept in the repository, then those of this computer."""

    def __init__(self, path: Path = FILE, kept: Path | None = KEPT) -> None:
        self._path = path
        self._found: dict[tuple[str, int], Result] = {}
        if kept is not None:
            for result in read_kept(kept):
                self._keep(result)
        with suppress(FileNotFoundError):
            for text in path.read_text("utf-8").splitlines():
                self._keep(Result(**json.loads(text)))

    def add(self, result: Result) -> None:
        """Keep a result, also in the file."""
        self._keep(result)
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(result._asdict(), ensure_ascii=False) + "\n")

    def of(self, line: Line) -> list[Result]:
        """Those of a line, in the order in which they came."""
        return [result for (key, _), result in self._found.items() if key == line.key]

    def failed(self, line: Line) -> list[Result]:
        """Those that are not as they should be."""
        return [result for result in self.of(line) if result.wrong]

    def all(self) -> list[Result]:
        """Those of all lines, by line and number."""
        return sorted(self._found.values())

    def next_of(self, line: Line) -> int:
        """The number of the first trial after all that were tried."""
        return max((result.trial for result in self.of(line)), default=-1) + 1

    def _keep(self, result: Result) -> None:
        self._found.pop((result.line, result.trial), None)
        self._found[result.line, result.trial] = result


def carry_on(lines: Sequence[Line], results: Results, for_s: float, workers: int, *, failed: bool) -> None:
    """Try for a time, the line that is furthest from its bar first; an interrupt ends it sooner."""
    until_s, commit = time.monotonic() + for_s, _commit()
    again = iter([(line, result.trial) for line in lines for result in results.failed(line)] if failed else ())
    begun = {line.key: results.next_of(line) for line in lines}
    under_way: set[Future[Result]] = set()
    spawn = get_context("spawn")
    with ProcessPoolExecutor(workers, spawn, max_tasks_per_child=TRIALS_OF_A_PROCESS) as pool, suppress(
        KeyboardInterrupt
    ):  # fmt: skip
        while True:
            while time.monotonic() < until_s and len(under_way) < workers:
                wanted = next(again, None) or next(_furthest(lines, begun), None)
                if wanted is None:
                    break
                line, number = wanted
                begun[line.key] = max(begun[line.key], number + 1)
                under_way.add(pool.submit(_tried, line.key, number, commit))
            if not under_way:
                return
            done, under_way = wait(under_way, return_when=FIRST_COMPLETED)
            for each in done:
                results.add(result := each.result())
                sys.stderr.write(f"{result.line}:{result.trial} {result.took_s:.1f} s {result.wrong}\n")


def _furthest(lines: Iterable[Line], begun: dict[str, int]) -> Iterator[tuple[Line, int]]:
    left = [line for line in lines if begun[line.key] < line.bar]
    if left:
        line = min(left, key=lambda line: begun[line.key] / line.bar)
        yield line, begun[line.key]


def _tried(key: str, number: int, commit: str) -> Result:
    """Play a trial; whatever is raised is its result."""
    began_s = time.monotonic()
    try:
        wrong = LINES[key].trial(number)
    except Exception as problem:  # noqa: BLE001  a trial that breaks has failed
        wrong = f"{type(problem).__name__}: {problem} at {traceback.extract_tb(problem.__traceback__)[-1].lineno}"
    at = datetime.now(UTC).isoformat(timespec="seconds")
    return Result(key, number, wrong[:1000], round(time.monotonic() - began_s, 1), at, commit)


def _commit() -> str:
    command: list[Any] = ["git", "-C", str(ROOT), "describe", "--always", "--dirty"]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip() or "unknown"
