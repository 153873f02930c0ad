"""After `bench make-safe`: where the air of each chamber is, and with a wait until it has arrived."""

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
from bench.runner.held import A_VISIT, LOOKS, energising_addresses, owners
from bench.store.energised import Energised, energised
from bench.store.followed import Followed

BY_HAND = "'bench make-safe'"
SHOWN_EVERY_S = 60.0
_ON_REQUEST = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
Notice = Callable[[str], object]


class MadeSafe(NamedTuple):
    """A bench that was made safe by hand: its roles that are, and the run that had left it on, if it is on record."""

    loaded: LoadedBench
    safe: tuple[str, ...]
    run: Path | None


class Arrivals(NamedTuple):
    """Whether no chamber is late, and whether somebody ended the wait while one was on its way."""

    good: bool = True
    ended: bool = False


def run_of(loaded: LoadedBench) -> Path | None:
    """The newest run on record that may have left an instrument of a bench on; None where there is none."""
    addresses = {str(address) for address in energising_addresses(loaded.bench).values()}
    found: list[Energised] = []
    with suppress(StoreError):  # which was told where it is read first
        found = [each for each in energised(lambda _: None) if addresses & set(each.connections.values())]
    return Path(found[-1].run) if found else None


def look_after(made: Sequence[MadeSafe], notice: Notice, *, wait: bool) -> Arrivals:
    """Tell of each chamber whether its air has arrived; with a `wait` return when it has, or cannot.

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
    """Return the present state of a chamber in the form of the record; one that is left is still on its way."""
    state, end = course.state, course.end
    on_its_way = end is None or end.event == "ended"
    event, why = ("commanded", course.why_unseen) if end is None or on_its_way else (end.event, end.why)
    air_c = None if state is None else state.process_value_c
    return Followed(role, event, wall_utc().isoformat(), why, "", False, air_c, course.target_c)


class _Watched:
    """The chambers of one bench, and what a person is told of them."""

    def __init__(self, made: MadeSafe, notice: Notice) -> None:
        path = made.loaded.document.path
        self._zone = made.loaded.bench.site.time_zone
        self._bench = f"--bench {shlex.quote(str(path))}"
        self._notice, self._others = notice, _others(made)
        run = None if self._others else made.run  # its guardian keeps that record
        self.following = Following(Follower(BY_HAND, run, str(path)), made.loaded.bench, made.safe)
        self.good = True
        self._shown: dict[str, tuple[Stopwatch, bool]] = {}

    @property
    def on_its_way(self) -> list[str]:
        """The roles of chambers that are not looked at any more, though their air has not arrived."""
        return [role for role, course in self.following.courses.items() if course.end and course.end.event == "ended"]

    def glance(self) -> bool:
        """Look once, and say what is on its way and how to look again; whether nothing is late."""
        good = self.following.glance(f"{BY_HAND} without --wait")
        self.following.close()
        self._show_all()
        if left := self.on_its_way:
            who = f"followed by {' and '.join(self._others)}" if self._others else "followed by nobody"
            self._say(
                f"On its way, {who}: {', '.join(left)}. 'bench make-safe {self._bench} --wait' waits until its air has "
                f"arrived, 'bench devices {self._bench}' shows where it is."
            )
        return good

    def follow(self) -> None:
        """Look until all courses are over; `good` is whether all have arrived, or were taken over."""
        try:
            self.good = self.following.follow(self._show_all)
        except Exception as problem:  # noqa: BLE001  the thread has nobody else to tell
            self.good = False
            self._say(f"The chambers cannot be followed any more: {type(problem).__name__}: {problem}")
            return
        self._show_all()
        if left := self.on_its_way:
            self._say(
                f"Not followed any more: {', '.join(left)}. The safe set point stays commanded; whether the air "
                f"arrives is not known. 'bench make-safe {self._bench} --wait' follows it again."
            )

    def _say(self, text: str) -> None:
        """Tell a person, whose terminal may be closed; the record is kept all the same."""
        with suppress(OSError, ValueError):
            self._notice(text)

    def _show_all(self) -> None:
        """Tell of each chamber that was not told of for a while, or whose course is over."""
        for role, course in self.following.courses.items():
            last = self._shown.get(role)
            if last is None or (course.is_over and not last[1]) or self._is_due(course, last[0]):
                self._shown[role] = Stopwatch(), course.is_over
                self._say(f"{role}: {chamber_sentence(_entry(role, course), self._zone)}")

    @staticmethod
    def _is_due(course: Course, last: Stopwatch) -> bool:
        return not course.is_over and last.elapsed_s() >= SHOWN_EVERY_S


def _others(made: MadeSafe) -> list[str]:
    """Who else follows a chamber of a bench, such as the guardian of a run."""
    addresses = energising_addresses(made.loaded.bench)
    found = owners([addresses[role] for role in made.safe], LOOKS)
    return sorted(str(each).removeprefix(A_VISIT) for each in found if each.process != os.getpid())


@contextmanager
def _ends_on_request(watched: Sequence[_Watched]) -> Iterator[list[int]]:
    """Inside, signals by which a person or a run asks for the chambers end the following; those that came."""
    came: list[int] = []

    def end(number: int, _frame: FrameType | None) -> None:
        came.append(number)
        for each in watched:
            each.following.end()

    before = {each: handler for each in _ON_REQUEST if (handler := signal.getsignal(each)) is not signal.SIG_IGN}
    for number in before:
        signal.signal(number, end)
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
