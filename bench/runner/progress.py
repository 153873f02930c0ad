"""Shows a run on a terminal: step, bar, bench time, time to go, live readings. Where there is no terminal, lines."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskProgressColumn, TextColumn
from rich.text import Text

from bench.clock import Clock, Stopwatch
from bench.engine.questions import Question
from bench.report.shown import duration
from bench.sequence.estimate import Estimate
from bench.sequence.plan import Plan, PlannedStep
from drivers.values import Reading

LINE_EVERY_SHARE = 0.1  # of the run, where there is no terminal
LIVE_READINGS = 4
BAR_STRIDE = 0.002  # of the run, by which the bar moves within a step


class TerminalProgress:
    """What a person sees on stderr while a run goes on.

    Lifetime: a context manager around the run. The display is drawn by a thread of its own from the values kept here,
    so that telling it something costs the run next to nothing.
    """

    def __init__(self, plan: Plan) -> None:
        self._steps = len(plan)
        self._console = Console(stderr=True)
        self._watch = Stopwatch()
        self._spans_s: list[tuple[float, float]] = []
        self._total_s = 1.0
        self.readings: dict[str, Reading] = {}
        self.said: list[str] = []
        self._next_line = LINE_EVERY_SHARE
        self._next_stride_s = 0.0
        self._step_late_s = 0.0  # by how much the step began later than estimated
        self._step_ends_s = 0.0
        columns: tuple[ProgressColumn, ...] = (
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            TaskProgressColumn(),
            _Said(self.times),
            _Said(self.live),
        )
        self._progress = Progress(*columns, console=self._console, transient=True, refresh_per_second=5)
        self._task = self._progress.add_task("opening the bench", total=1.0)
        self.now_s = 0.0

    def __enter__(self) -> Self:
        """Begins to draw."""
        if self._console.is_terminal:
            self._progress.start()
        return self

    def __exit__(self, *exc: object) -> None:
        """Clears what was drawn."""
        self._progress.stop()

    def run_begins(self, path: Path, expected: Estimate, clock: Clock) -> None:
        """The directory is made; the clock is that of the bench."""
        self._spans_s = [(span.begin_s, span.end_s) for span in expected.spans]
        self._total_s = max(expected.total_s, 1.0)
        self._progress.update(self._task, total=self._total_s)
        self.notice(f"run {path}, about {duration(self._total_s)} of bench time, from {clock.utc():%Y-%m-%d %H:%M} UTC")

    def step_begins(self, planned: PlannedStep, index: int) -> None:
        """A step of the plan begins."""
        expected_s, self._step_ends_s = self._spans_s[index]
        self._step_late_s = self.now_s - expected_s
        self._progress.update(self._task, completed=expected_s, description=f"{index + 1}/{self._steps} {planned.id}")
        share = expected_s / self._total_s
        if not self._console.is_terminal and share >= self._next_line:
            self._next_line = share + LINE_EVERY_SHARE
            self.notice(f"{share:4.0%}  {planned.id}")

    def step_ended(self, planned: PlannedStep, index: int) -> None:
        """A step is done."""
        self._progress.update(self._task, completed=self._step_ends_s)

    def reading(self, name: str, reading: Reading) -> None:
        """A channel has a new value; within a step the bar follows bench time, in strides."""
        self.readings[name] = reading
        self.now_s = reading.at_s
        if reading.at_s >= self._next_stride_s:
            self._next_stride_s = reading.at_s + BAR_STRIDE * self._total_s
            self._progress.update(self._task, completed=min(reading.at_s - self._step_late_s, self._step_ends_s))

    def asked(self, question: Question) -> None:
        """A question to a person is open."""
        picture = f"\nPicture: {question.picture}" if question.picture else ""
        self.notice(f"\a{question.text}{picture}\nAnswer with 'bench answer RUN ANSWER': {question.expected}")

    def notice(self, text: str) -> None:
        """Something a person should see now."""
        self.said.append(text)
        if self._console.is_terminal:
            self._console.print(Text(text))
        else:
            sys.stderr.write(text + "\n")

    def times(self) -> str:
        """Bench time gone by, and real time to go by the pace so far."""
        done = self._progress.tasks[self._task].completed / self._total_s
        elapsed_s = self._watch.elapsed_s()
        to_go = duration(elapsed_s * (1 - done) / done) if done > 0.01 else "?"
        return f"bench {duration(self.now_s)}, {to_go} to go"

    def live(self) -> str:
        """The newest readings, those that have a name on this bench first."""
        by_name = sorted(self.readings.items(), key=lambda item: "." in item[0])
        return "  ".join(f"{name} {reading.value:.4g}" for name, reading in by_name[:LIVE_READINGS])


class _Said(ProgressColumn):
    """A column that asks for its text each time it is drawn."""

    def __init__(self, say: Callable[[], str]) -> None:
        super().__init__()
        self._say = say

    def render(self, task: Task) -> Text:
        return Text(self._say())
