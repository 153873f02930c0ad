"""State of the chambers after `bench make-safe`, with an optional wait until their air has arrived."""

from __future__ import annotations

import os
import shlex
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import NamedTuple

from bench.clock import Stopwatch, wall_utc
from bench.config.bench import LoadedBench
from bench.errors import StoreError
from bench.figures.after_run import chamber_sentence
from bench.guardian.course import Course
from bench.guardian.follow import Follower, Following
from bench.runner.held import LOOKS, energising_addresses, owners
from bench.store.energised import Energised, energised
from bench.store.followed import Followed

BY_HAND = "'bench make-safe'"
SHOWN_EVERY_S = 60.0
_ON_REQUEST = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
Notice = Callable[[str], object]


class MadeSafe(NamedTuple):
    """Bench that was made safe by hand: safe roles, and the recorded run that had left it on, if any."""

    loaded: LoadedBench
    safe: tuple[str, ...]
    run: Path | None


class Arrivals(NamedTuple):
    """Result of supervision: no chamber is late (`good`), and the wait was ended with one on its way (`ended`)."""

    good: bool = True
    ended: bool = False


def run_of(loaded: LoadedBench) -> Path | None:
    """Return the newest recorded run that may have left an instrument of a bench on, or None."""
    addresses = {str(address) for address in energising_addresses(loaded.bench).values()}
    found: list[Energised] = []
    with suppress(StoreError):  # reported where the register is read first
        found = [each for each in energised(lambda _: None) if addresses & set(each.connections.values())]
    return Path(found[-1].run) if found else None


def report_arrivals(made: Sequence[MadeSafe], notice: Notice, *, wait: bool) -> Arrivals:
    """Report for each chamber whether its air has arrived; with `wait` return when it has, or cannot.

    A chamber that another program has taken over is no longer waited for. SIGINT, SIGTERM and SIGHUP end a wait.
    """
    watched = [_Watched(each, notice) for each in made if each.safe]
    if not wait:
        return Arrivals(not [each for each in watched if not each.glance()])
    with ExitStack() as entered, _ends_on_request(watched) as request:
        for each in watched:
            entered.enter_context(each.following)
        followers = [threading.Thread(target=each.follow, name="arrival") for each in watched]
        for thread in followers:
            thread.start()
        for thread in followers:
            thread.join()
    return Arrivals(all(each.good for each in watched), bool(request) and any(each.on_its_way for each in watched))


def _entry(role: str, course: Course) -> Followed:
    """Return the present state of a chamber as an entry of the record; one left before arrival is still on its way."""
    state, end = course.state, course.end
    on_its_way = end is None or end.event == "ended"
    event, why = ("commanded", course.why_unseen) if end is None or on_its_way else (end.event, end.why)
    air_c = None if state is None else state.process_value_c
    return Followed(role, event, wall_utc().isoformat(), why, "", False, air_c, course.target_c)


class _Watched:
    """Supervised chambers of one bench, and the display of their states."""

    def __init__(self, made: MadeSafe, notice: Notice) -> None:
        path = made.loaded.document.path
        self._zone = made.loaded.bench.site.time_zone
        self._bench = f"--bench {shlex.quote(str(path))}"
        self._notice, self._others = notice, _others(made)
        run = None if self._others else made.run  # the guardian that supervises them keeps that record
        self.following = Following(Follower(BY_HAND, run, str(path)), made.loaded.bench, made.safe)
        self.good = True
        self._shown: dict[str, tuple[Stopwatch, bool]] = {}

    @property
    def on_its_way(self) -> list[str]:
        """Roles of chambers that are no longer supervised although their air has not arrived."""
        return [role for role, course in self.following.courses.items() if course.end and course.end.event == "ended"]

    def glance(self) -> bool:
        """Read each chamber once, show chambers on their way and how to check again; return True if none is late."""
        good = self.following.glance(f"{BY_HAND} without --wait")
        self.following.close()
        self._show_all()
        if left := self.on_its_way:
            who = f"followed by {' and '.join(self._others)}" if self._others else "not followed"
            self._say(
                f"On its way, {who}: {', '.join(left)}. 'bench make-safe {self._bench} --wait' waits until its air has "
                f"arrived, 'bench devices {self._bench}' shows the temperature."
            )
        return good

    def follow(self) -> None:
        """Supervise until all courses are over; `good` is True if all chambers arrived or were taken over."""
        try:
            self.good = self.following.follow(self._show_all)
        except Exception as problem:  # noqa: BLE001  the thread has no caller to report to
            self.good = False
            self._say(f"Supervision of the chambers has failed: {type(problem).__name__}: {problem}")
            return
        self._show_all()
        if left := self.on_its_way:
            self._say(
                f"No longer followed: {', '.join(left)}. The safe set point stays commanded; whether the air "
                f"arrives is not known. 'bench make-safe {self._bench} --wait' follows it again."
            )

    def _say(self, text: str) -> None:
        """Show a line to a person; the terminal may be closed."""
        with suppress(OSError, ValueError):
            self._notice(text)

    def _show_all(self) -> None:
        """Show each chamber whose course has ended, or that was not shown for a while."""
        for role, course in self.following.courses.items():
            last = self._shown.get(role)
            if last is None or (course.is_over and not last[1]) or self._is_due(course, last[0]):
                self._shown[role] = Stopwatch(), course.is_over
                self._say(f"{role}: {chamber_sentence(_entry(role, course), self._zone)}")

    @staticmethod
    def _is_due(course: Course, last: Stopwatch) -> bool:
        return not course.is_over and last.elapsed_s() >= SHOWN_EVERY_S


def _others(made: MadeSafe) -> list[str]:
    """Return the other programs that supervise a chamber of a bench, such as the guardian of a run."""
    addresses = energising_addresses(made.loaded.bench)
    found = owners([addresses[role] for role in made.safe], LOOKS)
    return sorted(str(each) for each in found if each.process != os.getpid())


@contextmanager
def _ends_on_request(watched: Sequence[_Watched]) -> Iterator[list[int]]:
    """End supervision on signals during the block; yield the list of received signals."""
    received: list[int] = []

    def end(number: int, _frame: FrameType | None) -> None:
        received.append(number)
        for each in watched:
            each.following.end()

    before = {each: handler for each in _ON_REQUEST if (handler := signal.getsignal(each)) is not signal.SIG_IGN}
    for number in before:
        signal.signal(number, end)
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
