"""Supervision of chambers after a run, by a guardian or `bench make-safe`, until their air is at the safe set point.

A reading is short: lock the address, connect, identify, read, close, unlock. Other programs that want the address wait
for it (`address_lock`), and a run that starts ends the supervision (`relieve`).
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
from bench.errors import InUseError, StoreError, error_message
from bench.guardian.course import Course, Noted
from bench.guardian.notes import Notes
from bench.rig import CLOSE_S, device_of, limits_to_make_safe
from bench.runner.alert import alert
from bench.runner.held import (
    LOOKS,
    Kind,
    address_lock,
    energising_addresses,
    is_locked_out,
    owners,
    why_locked_out,
)
from bench.store.energised import note_safe
from bench.store.followed import FOLLOWED
from drivers.capabilities import ThermalChamber
from drivers.kinds.chamber.description import ChamberOptions, ChamberSafe
from drivers.timing.awake import fair_timeout
from drivers.transport.wires import RealWires

FIRST_S, EVERY_S = 1.0, 30.0  # intervals between readings, doubled each time
VISIT_S = 8.0  # shorter than the time for which other programs wait
BETWEEN_TRIES_S = 0.1  # the run releases the address at once
LAST_TRIES = 50
_pause = threading.Event().wait


class Follower(NamedTuple):
    """Identity of the supervising program: description, run whose record it keeps, if any, and title of alerts.

    `runner` is a process that may hold the addresses for a moment longer.
    """

    words: str
    run: Path | None
    title: str
    runner: int = 0


def guardian_of(run: Path, runner: int) -> Follower:
    """Return the identity of the guardian of a run, whose process is `runner`."""
    return Follower(f"the guardian of {run.name}", run, run.name, runner)


class Following:
    """Supervision of the chambers of a bench that was made safe.

    Lifetime: a context manager, registered for other programs from entry on, until `follow` returns; or not entered,
    for a `glance`, and closed.
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
        """Register as supervisor of the chambers."""
        addresses = [self._addresses[role] for role in self._courses]
        with suppress(InUseError, StoreError):  # another program supervises a chamber, and does not end
            self._locks.enter_context(address_lock(addresses, self._follower.words, Kind.VISIT, LOOKS))
        return self

    def __exit__(self, *exc: object) -> None:
        """Remove the registration."""
        self.close()

    def close(self) -> None:
        """Write the outstanding records and remove the registration."""
        self._notes.close()
        self._locks.close()

    @property
    def courses(self) -> Mapping[str, Course]:
        """State of each chamber, by role."""
        return self._courses

    def end(self) -> None:
        """End the supervision soon; safe to call from a signal handler and from another thread."""
        self._ends.set()

    def glance(self, why: str) -> bool:
        """Read each chamber once, then stop for the reason `why`; return True if none has failed to arrive."""
        good = True
        for role, course in self._courses.items():
            self._look(role, course)
            if not course.is_over:
                course.leave(why)
            good &= self._write(role, course)
        return good

    def follow(self, looked: Callable[[], object] = lambda: None) -> bool:
        """Supervise until all courses have ended; return True if every chamber has arrived or was handed over.

        `looked` is called after each round of readings.
        """
        good, pause_s = True, FIRST_S
        while left := {role: course for role, course in self._courses.items() if not course.is_over}:
            for role, course in left.items():
                self._look(role, course)
                good &= self._write(role, course)
            looked()
            if self._ends.is_set():
                return self._end() and good
            going_on = [course for course in left.values() if not course.is_over]
            if not going_on:
                break
            now_s = self._now_s()
            due_s = [course.hold_ends_s - now_s for course in going_on if course.is_held]
            self._ends.wait(min([pause_s, *(each for each in due_s if each > 0)]))
            pause_s = min(2 * pause_s, EVERY_S)
        return good

    def _look(self, role: str, course: Course) -> None:
        """Read one chamber, after the run has released it; the course judges failures."""
        address, now_s = self._addresses[role], self._now_s
        while others := {each for each in owners([address]) if each.process != os.getpid()}:
            other = others.pop()
            if other.process != self._follower.runner:
                if other.kind is Kind.RUN:
                    course.hand_over(f"{other} has taken the bench")
                else:
                    course.unseen(now_s(), f"the bench is in use by {other}", in_use=True)
                return
            _pause(BETWEEN_TRIES_S)
        if is_locked_out(self._bench):
            course.lock_out(why_locked_out(self._bench))
            return
        try:
            with address_lock([address], f"a short look of {self._follower.words}", Kind.VISIT):
                asyncio.run(self._visit(role, course))
        except InUseError as problem:
            course.unseen(now_s(), str(problem), in_use=True)
        except Exception as problem:  # noqa: BLE001  after any error the next reading is tried
            is_late = type(problem) is TimeoutError  # that of a driver says more
            course.unseen(now_s(), f"{role}: does not answer in time" if is_late else error_message(problem))

    async def _visit(self, role: str, course: Course) -> None:
        device = device_of(role, self._bench.devices[role], RealWires())
        if not isinstance(device, ThermalChamber):
            raise TypeError(f"{role} is not a chamber")
        try:
            async with fair_timeout(VISIT_S):
                await device.__aenter__()
                await device.identify()
                course.seen(self._now_s(), await device.state())
            if course.is_held and (course.hold_is_over or self._ends.is_set()):
                course.hold_is_over = course.hold_is_over or "its guardian was ended"
                async with fair_timeout(limits_to_make_safe(self._bench)[role]):
                    await device.make_safe()
                course.commanded(self._now_s())
                self._notes.do(partial(note_safe, {str(self._addresses[role])}))
                async with fair_timeout(VISIT_S):
                    course.seen(self._now_s(), await device.state())
        finally:
            with suppress(Exception):
                async with fair_timeout(CLOSE_S):
                    await device.__aexit__(None, None, None)

    def _end(self) -> bool:
        """End on request; no chamber may be held without a guardian, so held ones are commanded to safety."""
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
        """Record new entries of a chamber, and alert a person on failure; return True if there is none."""
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
    """Install a handler of SIGTERM, which a starting run sends, that ends the supervision."""
    signal.signal(signal.SIGTERM, lambda _number, _frame: following.end())


def in_own_process(following: Callable[[], Following]) -> None:
    """Continue the supervision in a detached child process; return once other programs can find it.

    The child keeps neither the terminal nor the link to the run.
    """
    ready, done = os.pipe()
    if os.fork():
        os.close(done)
        os.read(ready, 1)
        os.close(ready)
        return
    try:
        os.setsid()
        os.close(ready)
        redirect_to_null()
        found = following()
        end_on_sigterm(found)  # before other programs can find it
        with found:
            os.close(done)
            found.follow()
    finally:
        os._exit(0)


def redirect_to_null() -> None:
    """Redirect the standard streams to the null device, so that no terminal or pipe is kept open."""
    nothing = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1, 2):
        os.dup2(nothing, number)
    os.close(nothing)
