"""Several rehearsals, each in a process of its own, and their outcomes as text, JSON and JUnit."""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

from bench.app.check_files import FileCheck
from bench.cli.exits import BENCH_ERROR, FAIL, INCOMPLETE, INPUT_ERROR, MEANINGS, NOT_JUDGED, PASS, worst
from bench.cli.junit import Case, Problem, junit
from bench.cli.streams import say, say_json
from bench.clock import Stopwatch

LINES_SHOWN = 20  # of a process that ended without an outcome
OF_THE_UNIT = (FAIL, NOT_JUDGED, INCOMPLETE)  # the rehearsal itself was made


class Outcome(NamedTuple):
    """Outcome of one rehearsal, as in JSON; without a run if it could not begin.

    `ended` is how the run ended, `unsafe` are the devices that were not made safe, `lost` what is missing on the disk.
    """

    file: str
    bench: str
    exit_code: int
    verdict: str | None = None
    ended: str | None = None
    planned_s: float | None = None
    bench_s: float | None = None
    wall_s: float = 0.0
    problems: Sequence[str] = ()
    unsafe: Sequence[str] = ()
    lost: Sequence[str] = ()
    run: str | None = None
    report: str | None = None

    @property
    def name(self) -> str:
        """File and bench."""
        return f"{self.file} on {self.bench}" if self.bench else self.file

    @property
    def meaning(self) -> str:
        """Meaning of the exit code, such as PASS."""
        return MEANINGS[self.exit_code].partition(":")[0]

    @property
    def lines(self) -> list[str]:
        """Problems for people."""
        unsafe = [f"not made safe: {', '.join(self.unsafe)}"] if self.unsafe else []
        return [*self.problems, *unsafe, *(f"not on the disk: {each}" for each in self.lost)]


def not_begun(check: FileCheck) -> Outcome:
    """Return the outcome for a sequence with errors."""
    problems = [shown.in_words for shown in check.errors]
    return Outcome(str(check.path), check.bench, INPUT_ERROR, problems=problems)


class Children:
    """Processes of rehearsals. `options` are the further words of their command line."""

    def __init__(self, options: Sequence[str]) -> None:
        self._options = options
        self._running: set[subprocess.Popen[str]] = set()
        self._is_ending = False

    def outcomes(self, checks: Iterable[FileCheck], jobs: int) -> Iterator[Outcome]:
        """Rehearse checked sequences, `jobs` at a time, and yield the outcomes in their order.

        If this is interrupted, all processes are ended, and their devices are made safe.
        """
        with ThreadPoolExecutor(jobs) as pool:
            try:
                yield from pool.map(self._outcome, checks)
            except BaseException:
                self._end()
                pool.shutdown(cancel_futures=True)
                raise

    def _end(self) -> None:
        self._is_ending = True
        for process in tuple(self._running):
            process.terminate()

    def _outcome(self, check: FileCheck) -> Outcome:
        if check.errors:
            return not_begun(check)
        words = [str(check.path), f"--bench={check.bench}", "--format=json", *self._options]
        watch = Stopwatch()
        process = subprocess.Popen(  # noqa: S603  our own command
            [sys.executable, "-P", "-m", "bench", "rehearse", *words],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, errors="replace",
        )  # fmt: skip
        self._running.add(process)
        if self._is_ending:
            process.terminate()
        out, err = process.communicate()
        self._running.discard(process)
        try:
            (entry,) = json.loads(out)["rehearsals"]
            return Outcome(**entry)
        except (ValueError, KeyError, TypeError):
            last = err.splitlines()[-LINES_SHOWN:] or ["its process ended without an outcome"]
            return Outcome(str(check.path), check.bench, BENCH_ERROR, wall_s=watch.elapsed_s(), problems=last)


def as_words(arguments: Iterable[Any], values: dict[str, Any]) -> Iterator[str]:
    """Yield the words of a command line that give these values to options."""
    for each in arguments:
        value = values.get(each.parameter)
        if each.name.startswith("--") and value is not None:
            yield from (f"{each.name}={one}" for one in (value if isinstance(value, tuple) else (value,)))


def show(outcomes: Iterable[Outcome], form: str) -> int:
    """Write outcomes on stdout, text line by line as they come; return the exit code of the worst."""
    if form == "text":
        return _as_text(outcomes)
    done = list(outcomes)
    code = worst(outcome.exit_code for outcome in done)
    if form == "json":
        say_json({"exit_code": code, "rehearsals": [outcome._asdict() for outcome in done]})
    else:
        say(junit("bench rehearse", list(map(_case, done))))
    return code


def _as_text(outcomes: Iterable[Outcome]) -> int:
    from bench.figures.times_and_sizes import duration

    done = []
    for outcome in outcomes:
        done.append(outcome)
        took = f", {duration(outcome.bench_s)} in {outcome.wall_s:.1f} s" if outcome.bench_s is not None else ""
        run = f", {outcome.run}" if outcome.run else ""
        say(f"{outcome.name}: {outcome.meaning}{took}{run}", *(f"  {line}" for line in outcome.lines))
    counts = Counter(outcome.meaning for outcome in done)
    say(f"{len(done)} rehearsals: {', '.join(f'{count} {what}' for what, count in counts.items())}")
    return worst(outcome.exit_code for outcome in done)


def _case(outcome: Outcome) -> Case:
    problem = None
    if outcome.exit_code != PASS:
        lines = outcome.lines or [MEANINGS[outcome.exit_code]]
        problem = Problem("failure" if outcome.exit_code in OF_THE_UNIT else "error", outcome.meaning, lines)
    output = [each for each in (outcome.run, outcome.report) if each]
    return Case("bench rehearse", outcome.name, outcome.wall_s, problem, output)
