"""A run on a terminal: one line with its state, step, end by the clock and readings. Without a terminal, lines."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path
from typing import Self
from zoneinfo import ZoneInfo

from rich.cells import cell_len
from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskProgressColumn
from rich.table import Column
from rich.text import Text

from bench.clock import Clock, Stopwatch, wall_utc
from bench.config.channels import channels_of
from bench.config.models import BenchFile
from bench.engine.questions import Question
from bench.figures.times_and_sizes import duration, instant
from bench.quality import Invalid, Judged
from bench.sequence.estimate.estimate import Estimate
from bench.sequence.language.readings import unit_of
from bench.sequence.plan.plan import Plan, PlannedStep

LINE_EVERY_SHARE = 0.1  # of the run, where there is no terminal
BAR_STRIDE = 0.002  # of the run, by which the bar moves within a step
BAR_CELLS = 16
MARGIN_CELLS = BAR_CELLS + 8  # bar, percentage and the blanks between the columns
STEP_CELLS = 24  # the least that is shown of a step's id
GAP = "  "


class TerminalProgress:
    """Progress of a run for the person who started it, on stderr; times are in the zone of the bench.

    `speed` is bench seconds per second, infinite when virtual time runs as fast as it can.

    Lifetime: a context manager around the run. The display is drawn by a thread of its own from the values kept here,
    so that an update costs the run next to nothing.
    """

    def __init__(self, plan: Plan, bench: BenchFile, speed: float = math.inf) -> None:
        self._steps, self._bench, self._speed = len(plan), bench, speed
        self._zone = bench.site.time_zone
        self._stale_after_s = {name: channel.stale_after_s for name, channel in channels_of(bench).items()}
        self._console = Console(stderr=True)
        self._watch = Stopwatch()
        self._spans_s: list[tuple[float, float]] = []
        self._total_s = 1.0
        self.readings: dict[str, Judged] = {}
        self.said: list[str] = []
        self._step, self._held_by, self._asks = "opening the bench", "", False
        self._next_line = LINE_EVERY_SHARE
        self._next_stride_s = 0.0
        self._step_late_s = 0.0  # by how much the step began later than estimated
        self._step_ends_s = 0.0
        columns: tuple[ProgressColumn, ...] = (
            BarColumn(bar_width=BAR_CELLS),
            TaskProgressColumn(),
            _Line(lambda: self.line(self._console.width - MARGIN_CELLS)),
        )
        self._progress = Progress(*columns, console=self._console, transient=True, refresh_per_second=5)
        self._task = self._progress.add_task("", total=1.0)
        self._began_s = 0.0  # by the clock of the readings, which in real time is that of the computer
        self.now_s = 0.0  # since the run began

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
        self._began_s = clock.monotonic()
        self._progress.update(self._task, total=self._total_s)
        begins = instant(clock.utc().isoformat(), self._zone)
        self.notice(f"run {path}, about {duration(self._total_s)} of bench time, from {begins}")

    def step_begins(self, planned: PlannedStep, index: int) -> None:
        """A step of the plan begins."""
        expected_s, self._step_ends_s = self._spans_s[index]
        self._step_late_s = self.now_s - expected_s
        self._step, self._asks = f"{index + 1}/{self._steps} {planned.id}", False
        self._progress.update(self._task, completed=expected_s)
        share = expected_s / self._total_s
        if not self._console.is_terminal and share >= self._next_line:
            self._next_line = share + LINE_EVERY_SHARE
            self.notice(f"{share:4.0%}{GAP}{duration(self.now_s):>11}{GAP}{planned.id}")

    def step_ended(self, planned: PlannedStep, index: int) -> None:
        """A step is done."""
        self._progress.update(self._task, completed=self._step_ends_s)

    def reading(self, name: str, reading: Judged) -> None:
        """A channel has a new value; within a step the bar follows bench time, in strides."""
        self.readings[name] = reading
        if isinstance(reading, Invalid):  # whose time may be wrong as well
            return
        self.now_s = reading.at_s - self._began_s
        if self.now_s >= self._next_stride_s:
            self._next_stride_s = self.now_s + BAR_STRIDE * self._total_s
            self._progress.update(self._task, completed=min(self.now_s - self._step_late_s, self._step_ends_s))

    def asked(self, question: Question) -> None:
        """A question to a person is open."""
        self._asks = True
        picture = f"\nPicture: {question.picture}" if question.picture else ""
        self.notice(f"\a{question.text}{picture}\nAnswer with 'bench answer RUN ANSWER': {question.expected}")

    def held(self, by: str) -> None:
        """No step begins while `by` holds the run; an empty `by` means no hold."""
        self._held_by = by

    def notice(self, text: str) -> None:
        """Something a person should see now."""
        self.said.append(text)
        if self._console.is_terminal:
            self._console.print(Text(text))
        else:
            sys.stderr.write(text + "\n")

    def line(self, width: int) -> str:
        """State, step, end and readings in at most `width` terminal cells; the end of a long step's id is kept."""
        fixed = [self._state(), self.ends()]
        room = max(STEP_CELLS, width - sum(cell_len(text) + len(GAP) for text in fixed))
        step = self._step if len(self._step) <= room else f"…{self._step[1 - room :]}"
        line = GAP.join(filter(None, (fixed[0], step, fixed[1])))
        for reading in self.live():
            if cell_len(line) + len(GAP) + cell_len(reading) > width:
                break
            line += GAP + reading
        return line

    def _state(self) -> str:
        if self._asks:
            return "WAITS FOR AN ANSWER"
        if self._held_by:
            return f"HELD by the {self._held_by}"
        return "teardown" if "teardown/" in self._step else ""

    def ends(self) -> str:
        """When the run will end by the clock of the bench's zone; by the pace so far at full speed."""
        done = self._progress.tasks[self._task].completed / self._total_s
        if self._speed < math.inf:
            to_go_s = self._total_s * (1 - done) / self._speed
        elif done > 0.01:
            to_go_s = self._watch.elapsed_s() * (1 - done) / done
        else:
            return ""
        if to_go_s < 90:
            return f"{to_go_s:.0f} s to go"
        return f"ends {_day_and_time(wall_utc(), to_go_s, self._zone)}"

    def live(self) -> list[str]:
        """The newest readings with their units or what is wrong with them: these first, then named ones."""
        by_name = sorted(((*self._said(name, reading), name) for name, reading in self.readings.items()), key=_order)
        return [f"{name} {text}" for _, text, name in by_name]

    def _said(self, name: str, reading: Judged) -> tuple[bool, str]:
        """Whether a reading is valid and not stale, and the text for it."""
        if isinstance(reading, Invalid):
            return False, f"invalid: {reading.why}"
        age_s = self.now_s + self._began_s - reading.at_s
        if age_s > self._stale_after_s.get(name, math.inf):
            return False, f"stale: {age_s:.3g} s old"
        return True, f"{reading.value:.4g} {unit_of(name, self._bench) or ''}".rstrip()


def _order(shown: tuple[bool, str, str]) -> tuple[bool, bool]:
    """What is wrong first, then readings that have a name on this bench."""
    is_good, _, name = shown
    return is_good, "." in name


def _day_and_time(now: datetime, later_s: float, zone: str) -> str:
    """The instant `later_s` from now: "07:12" when that is today in the zone, else "Tue 07:12"."""
    there = now.astimezone(ZoneInfo(zone))
    then = (now + timedelta(seconds=later_s)).astimezone(ZoneInfo(zone))
    return f"{then:%H:%M}" if then.date() == there.date() else f"{then:%a %H:%M}"


class _Line(ProgressColumn):
    """A column that asks for its text each time it is drawn, and is never wrapped."""

    def __init__(self, text: Callable[[], str]) -> None:
        super().__init__(table_column=Column(no_wrap=True, overflow="ellipsis"))
        self._text = text

    def render(self, task: Task) -> Text:
        return Text(self._text(), no_wrap=True, overflow="ellipsis")
