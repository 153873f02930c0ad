"""What a guardian does after a run, and `bench make-safe`: looking at each chamber until its air is where it is safe.

A look is short: it takes the lock of the address, connects, identifies, reads, closes, and lets go. Whoever wants the
address meanwhile waits for that (`holding`), and a run that begins ends the following (`relieve`).
"""

from __future__ import annotations

import asyncio
import os
import signal
import threading
from collections.abc import Callable, Collection, Mapping
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import NamedTuple, Self

from bench.clock import Stopwatch
from bench.config.models import BenchFile
from bench.errors import InUseError, StoreError, in_words
from bench.guardian.course import Course, Noted
from bench.guardian.notes import Notes
from bench.rig import CLOSE_S, device_of, limits_to_make_safe
from bench.runner.alert import alert
from bench.runner.held import (
    A_RESCUE,
    A_RUN,
    A_VISIT,
    LOOKS,
    energising_addresses,
    holding,
    is_locked_out,
    owners,
    why_locked_out,
)
from bench.store.energised import note_safe
from bench.store.followed import FOLLOWED
from drivers.capabilities import ThermalChamber
from drivers.kinds.chamber.description import ChamberOptions, ChamberSafe
from drivers.timing.awake import patience
from drivers.transport.wires import RealWires

FIRST_S, EVERY_S = 1.0, 30.0  # between looks: twice as long each time
VISIT_S = 8.0  # less than others wait for
BETWEEN_TRIES_S = 0.1  # while the run has the address: it lets go in a moment
LAST_TRIES = 50
_pause = threading.Event().wait


class Follower(NamedTuple):
    """Who follows, in words; the run whose record it keeps, if any, and what an alert is titled with.

    `runner` is a process that may have the addresses for a moment longer.
    """

    words: str
    run: Path | None
    title: str
    runner: int = 0


def guardian_of(run: Path, runner: int) -> Follower:
    """The guardian of a run, whose process is `runner`."""
    return Follower(f"{A_RESCUE}{run.name}", run, run.name, runner)


class Following:
    """The chambers of a bench that was made safe, each until its course is over.

    Lifetime: from entering, by which time it can be found and ended, to the return of `follow`; or not entered, for a
    `glance`, and closed.
    """

    def __init__(self, follower: Follower, bench: BenchFile, safe: Collection[str], held: Collection[str] = ()) -> None:
        self._follower, self._bench = follower, bench
        self._addresses = energising_addresses(bench)
        self._notes = Notes(follower.run, FOLLOWED, by=follower.words)
        self._now_s = Stopwatch().elapsed_s
        self._courses: dict[str, Course] = {}
        self._ends, self._locks = threading.Event(), ExitStack()
        for role in (*safe, *held):
            entry = bench.devices[role]
            is_chamber = isinstance(entry.options, ChamberOptions) and isinstance(entry.safe, ChamberSafe)
            if role not in held:
                self._notes.entry("commanded", role=role, what=entry.safe_state.words, is_complete=not is_chamber)
            if is_chamber:
                self._courses[role] = Course(entry, self._now_s(), held=role in held)

    def __enter__(self) -> Self:
        """Take the locks by which others find who follows a chamber."""
        addresses = [self._addresses[role] for role in self._courses]
        with suppress(InUseError, StoreError):  # another one follows a chamber, and does not end
            self._locks.enter_context(holding(addresses, f"{A_VISIT}{self._follower.words}", LOOKS))
        return self

    def __exit__(self, *exc: object) -> None:
        """Let go."""
        self.close()

    def close(self) -> None:
        """Return when the record is written, and nobody finds who follows any more."""
        self._notes.close()
        self._locks.close()

    @property
    def courses(self) -> Mapping[str, Course]:
        """Those of the chambers, by role."""
        return self._courses

    def end(self) -> None:
        """End the following soon; may be called from a handler of a signal, and from another thread."""
        self._ends.set()

    def glance(self, why: str) -> bool:
        """Look once at each chamber, and leave those on their way for the reason `why`; whether none is late."""
        good = True
        for role, course in self._courses.items():
            self._look(role, course)
            if not course.is_over:
                course.leave(why)
            good &= self._write(role, course)
        return good

    def follow(self, looked: Callable[[], object] = lambda: None) -> bool:
        """Look at the chambers until all courses are over; whether every one has arrived, or has been handed over.

        `looked` is called after each look at all of them.
        """
        good, pause_s = True, FIRST_S
        while left := {role: course for role, course in self._courses.items() if not course.is_over}:
            for role, course in left.items():
                self._look(role, course)
                good &= self._write(role, course)
            looked()
            if self._ends.is_set():
                return self._end() and good
            now_s = self._now_s()
            due_s = [course.hold_ends_s - now_s for course in left.values() if course.is_held and not course.is_over]
            self._ends.wait(max(0.0, min([pause_s, *(each for each in due_s if each > 0)])))
            pause_s = min(2 * pause_s, EVERY_S)
        return good

    def _look(self, role: str, course: Course) -> None:
        """One look, after the run has let go; a failure is for the course to judge."""
        address, now_s = self._addresses[role], self._now_s
        while others := {each for each in owners([address]) if each.process != os.getpid()}:
            other = others.pop()
            if other.process != self._follower.runner:
                if other.words.startswith(A_RUN):
                    course.hand_over(f"{other} has taken the bench")
                else:
                    course.unseen(now_s(), f"the bench is in use by {other}", in_use=True)
                return
            _pause(BETWEEN_TRIES_S)
        if is_locked_out(self._bench):
            course.lock_out(why_locked_out(self._bench))
            return
        try:
            with holding([address], f"{A_VISIT}{self._follower.words}"):
                asyncio.run(self._visit(role, course))
        except InUseError as problem:
            course.unseen(now_s(), str(problem), in_use=True)
        except Exception as problem:  # noqa: BLE001  whatever it is, the next look is tried
            course.unseen(now_s(), in_words(problem) or type(problem).__name__)

    async def _visit(self, role: str, course: Course) -> None:
        device = device_of(role, self._bench.devices[role], RealWires())
        if not isinstance(device, ThermalChamber):
            raise TypeError(f"{role} is no chamber")
        try:
            async with patience(VISIT_S):
                await device.__aenter__()
                await device.identify()
                course.seen(self._now_s(), await device.state())
            if course.is_held and (course.hold_is_over or self._ends.is_set()):
                course.hold_is_over = course.hold_is_over or "its guardian was ended"
                async with patience(limits_to_make_safe(self._bench)[role]):
                    await device.make_safe()
                course.commanded(self._now_s())
                self._notes.do(partial(note_safe, {str(self._addresses[role])}))
                async with patience(VISIT_S):
                    course.seen(self._now_s(), await device.state())
        finally:
            with suppress(Exception):
                async with patience(CLOSE_S):
                    await device.__aexit__(None, None, None)

    def _end(self) -> bool:
        """End on request: nothing is held without a guardian."""
        good = True
        for role, course in self._courses.items():
            for _ in range(LAST_TRIES):
                if course.is_over or not course.is_held:
                    break
                self._look(role, course)
                _pause(BETWEEN_TRIES_S)
            if not course.is_over:
                course.leave("still held" if course.is_held else "")
            good &= self._write(role, course)
        return good

    def _write(self, role: str, course: Course) -> bool:
        """Record what is new of a chamber, and alert a person where it has not arrived; whether that is not so."""
        noted, course.noted = course.noted, []
        for each in noted:
            facts = {key: value for key, value in each._asdict().items() if key != "event" and value not in ("", None)}
            self._notes.entry(each.event, role=role, **facts)
        failed = [each for each in noted if each.event == "not_arrived"]
        for each in failed:
            self._alert(role, each)
        return not failed

    def _alert(self, role: str, noted: Noted) -> None:
        if self._bench.alert is None:
            return
        title = f"{self._follower.title}: {role} HAS NOT ARRIVED at its safe set point"
        if problem := alert(self._bench.alert.exec, title, f"{title}\n{noted.why}\n"):
            self._notes.entry("alert", role=role, problem=problem)


def end_on_sigterm(following: Following) -> None:
    """From now on SIGTERM, by which a run that begins asks for the chambers, ends the following."""
    signal.signal(signal.SIGTERM, lambda _number, _frame: following.end())


def in_a_process_of_its_own(following: Callable[[], Following]) -> None:
    """Go on following in a child, which no parent waits for; returns when it can be found by others.

    The child keeps neither the terminal nor the link to the run.
    """
    ready, done = os.pipe()
    if os.fork():
        os.close(done)
        os.read(ready, 1)
        return
    try:
        os.setsid()
        os.close(ready)
        to_nothing()
        found = following()
        end_on_sigterm(found)  # before others can find it
        with found:
            os.close(done)
            found.follow()
    finally:
        os._exit(0)


def to_nothing() -> None:
    """From now on nothing that is written reaches a terminal, or keeps a pipe open that somebody reads."""
    nothing = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1, 2):
        os.dup2(nothing, number)
    os.close(nothing)
