"""Progress display: on a terminal one line with state, step, end time and readings; otherwise lines of text."""

from __future__ import annotations

import math
import sys
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Self
from zoneinfo import ZoneInfo

from rich.cells import cell_len

from bench.clock import Clock, Stopwatch, wall_utc
from bench.config.channels import channels_of
from bench.config.models import BenchFile
from bench.engine.questions import Question
from bench.figures.times_and_sizes import duration, instant
from bench.quality import Invalid, Judged
from bench.sequence.estimate.estimate import Estimate
from bench.sequence.language.readings import unit_of
from bench.sequence.plan.plan import Plan, PlannedStep

if TYPE_CHECKING:  # a run without a terminal draws no bar
    from bench.runner.bar import Bar

LINE_EVERY_SHARE = 0.1  # share of the run between lines without a terminal
BAR_STRIDE = 0.002  # share of the run by which the bar moves within a step
STEP_CELLS = 24  # minimum of a step's id that is shown
GAP = "  "


class TerminalProgress:
    """Progress of a run for its operator, on stderr; times are in the zone of the bench.

    `speed` is bench seconds per second, infinite if virtual time runs as fast as possible.

    Lifetime: a context manager around the run. A thread draws the display from the values kept here, so that an update
    costs the run next to nothing.
    """

    def __init__(self, plan: Plan, bench: BenchFile, speed: float = math.inf) -> None:
        self._steps, self._bench, self._speed = len(plan), bench, speed
        self._zone = bench.site.time_zone
        self._stale_after_s = {name: channel.stale_after_s for name, channel in channels_of(bench).items()}
        self._watch = Stopwatch()
        self._spans_s: list[tuple[float, float]] = []
        self._total_s = 1.0
        self._done_s = 0.0  # of the total
        self.readings: dict[str, Judged] = {}
        self.notices: list[str] = []
        self._step, self._held_by, self._asks = "opening the bench", "", False
        self._next_line = LINE_EVERY_SHARE
        self._next_stride_s = 0.0
        self._step_late_s = 0.0  # delay of the start of the step against the estimate
        self._step_ends_s = 0.0
        self._began_s = 0.0  # by the clock of the readings, in real time that of the computer
        self.now_s = 0.0  # since the run began
        self._bar: Bar | None = None
        if sys.stderr.isatty():
            from bench.runner.bar import Bar

            self._bar = Bar(self.line)

    def __enter__(self) -> Self:
        """Start drawing."""
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(self, *exc: object) -> None:
        """Clear the display."""
        if self._bar is not None:
            self._bar.stop()

    def run_begins(self, path: Path, expected: Estimate, clock: Clock) -> None:
        """Show the directory and the start time."""
        self._spans_s = [(span.begin_s, span.end_s) for span in expected.spans]
        self._total_s = max(expected.total_s, 1.0)
        self._began_s = clock.monotonic()
        begins = instant(clock.utc().isoformat(), self._zone)
        self.notice(f"run {path}, about {duration(self._total_s)} of bench time, from {begins}")

    def step_begins(self, planned: PlannedStep, index: int) -> None:
        """Show a step that starts."""
        expected_s, self._step_ends_s = self._spans_s[index]
        self._step_late_s = self.now_s - expected_s
        self._step, self._asks = f"{index + 1}/{self._steps} {planned.id}", False
        self._advance(expected_s)
        share = expected_s / self._total_s
        if self._bar is None and share >= self._next_line:
            self._next_line = share + LINE_EVERY_SHARE
            self.notice(f"{share:4.0%}{GAP}{duration(self.now_s):>11}{GAP}{planned.id}")

    def step_ended(self, planned: PlannedStep, index: int) -> None:
        """Advance the bar past a finished step."""
        self._advance(self._step_ends_s)

    def reading(self, name: str, reading: Judged) -> None:
        """Show a new reading; within a step the bar follows bench time, in strides."""
        self.readings[name] = reading
        if isinstance(reading, Invalid):  # its time may be wrong as well
            return
        self.now_s = reading.at_s - self._began_s
        if self.now_s >= self._next_stride_s:
            self._next_stride_s = self.now_s + BAR_STRIDE * self._total_s
            self._advance(min(self.now_s - self._step_late_s, self._step_ends_s))

    def _advance(self, done_s: float) -> None:
        self._done_s = done_s
        if self._bar is not None:
            self._bar.show(done_s / self._total_s)

    def asked(self, question: Question) -> None:
        """Show an open question."""
        self._asks = True
        picture = f"\nPicture: {question.picture}" if question.picture else ""
        self.notice(f"\a{question.text}{picture}\nAnswer with 'bench answer RUN ANSWER': {question.expected}")

    def held(self, by: str) -> None:
        """Show that no step starts while `by` holds the run; "" ends the hold."""
        self._held_by = by

    def notice(self, text: str) -> None:
        """Show a notice."""
        self.notices.append(text)
        if self._bar is not None:
            self._bar.print(text)
        else:
            sys.stderr.write(text + "\n")

    def line(self, width: int) -> str:
        """Return state, step, end time and readings in at most `width` cells; a long step id keeps its end."""
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
        """Return the expected end by the clock of the bench's zone; at full speed from the pace so far."""
        done = self._done_s / self._total_s
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
        """Return the newest readings with units or problems: problems first, then named readings."""
        by_name = sorted(((*self._text_of(name, reading), name) for name, reading in self.readings.items()), key=_order)
        return [f"{name} {text}" for _, text, name in by_name]

    def _text_of(self, name: str, reading: Judged) -> tuple[bool, str]:
        """Return True for a reading that is valid and not stale, with its text."""
        if isinstance(reading, Invalid):
            return False, f"invalid: {reading.why}"
        age_s = self.now_s + self._began_s - reading.at_s
        if age_s > self._stale_after_s.get(name, math.inf):
            return False, f"stale: {age_s:.3g} s old"
        return True, f"{reading.value:.4g} {unit_of(name, self._bench) or ''}".rstrip()


def _order(shown: tuple[bool, str, str]) -> tuple[bool, bool]:
    """Return the sort key: problems first, then readings with a name on this bench."""
    is_good, _, name = shown
    return is_good, "." in name


def _day_and_time(now: datetime, later_s: float, zone: str) -> str:
    """Return the instant `later_s` from now: "07:12" if today in the zone, else "Tue 07:12"."""
    there = now.astimezone(ZoneInfo(zone))
    then = (now + timedelta(seconds=later_s)).astimezone(ZoneInfo(zone))
    return f"{then:%H:%M}" if then.date() == there.date() else f"{then:%a %H:%M}"
