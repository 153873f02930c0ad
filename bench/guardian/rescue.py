"""What a guardian does when its run has died: it makes the bench safe with drivers of its own, and records how."""

from __future__ import annotations

import asyncio
import hashlib
import threading
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

from bench.clock import wall_utc
from bench.config.bench import load_bench
from bench.config.channels import period_s
from bench.errors import InputError, InUseError, in_words
from bench.guardian.follow import Following, end_on_sigterm, guardian_of, in_a_process_of_its_own, to_nothing
from bench.guardian.notes import Notes
from bench.guardian.watch import Lost, Over
from bench.lanes import Lane, make_safe_in_lanes
from bench.rig import device_of, limits_to_make_safe
from bench.runner.alert import alert
from bench.runner.held import A_RESCUE, energising_addresses, holding, is_locked_out
from bench.store.energised import note_safe
from bench.store.latch import INCIDENT
from bench.store.unsafe import keep_unsafe
from drivers.capabilities import Device
from drivers.transport.address import Address
from drivers.transport.wires import RealWires

ATTEMPTS, BETWEEN_ATTEMPTS_S = 20, 0.25  # the locks of a run are free when the kernel has ended its process
_pause = threading.Event().wait


class Rescue:
    """A bench that is loaded and ready to be made safe. Raises InputError when the file is not the one of the run."""

    def __init__(self, run: Path, bench: Path, digest: str, runner: int) -> None:
        loaded = load_bench(bench)
        if hashlib.sha256(loaded.document.text.encode()).hexdigest() != digest:
            raise InputError(f"{bench}: has changed since the run has read it")
        self._run, self._bench, self._runner = run, loaded.bench, runner
        self._addresses = energising_addresses(loaded.bench)
        self.polls_within_s = {
            role: loaded.bench.devices[role].busy_s + period_s(role, loaded.bench) for role in self._addresses
        }
        self._notes = Notes(run, INCIDENT)
        self._alerts: list[threading.Thread] = []
        self._devices()  # imports them while there is memory

    def alarm(self, why: str) -> None:
        """Record that something of the run is late, and alert a person; returns at once."""
        self._notes.entry("alarm", why=why)
        self._alerts.append(threading.Thread(target=self._alert, args=("look at it", why), name="alert", daemon=True))
        self._alerts[-1].start()

    def leave(self, end: Over) -> None:
        """Follow the chambers of a run that is over, in a process of its own."""
        self._notes.close()
        for thread in self._alerts:  # a fork takes over the locks that another thread holds, and not the thread
            thread.join()
        if end.safe or end.held:
            by = guardian_of(self._run, self._runner)
            in_a_process_of_its_own(partial(Following, by, self._bench, end.safe, end.held))

    def make_safe(self, lost: Lost) -> bool:
        """Make every instrument safe, record how, and follow the chambers; whether all of them are safe."""
        notes = self._notes
        notes.line(f"{lost.why}. Its guardian makes the bench safe: {', '.join(self._addresses)}.")
        notes.entry("begins", why=lost.why)
        with ExitStack() as stack:
            following: Following | None = None
            try:
                with _held(self._addresses.values(), f"{A_RESCUE}{self._run.name}"):
                    lanes = self._lanes(may_hold=lost.may_hold)
                    unsafe = self._record(lanes)
                    following = self._following(lanes, stack)
            except Exception as problem:  # noqa: BLE001  whatever it is, it is on record that the bench is not safe
                unsafe = self._record([Lane(role, "not reached", in_words(problem), 0.0) for role in self._addresses])
            notes.close()
            self._alert(f"NOT MADE SAFE: {', '.join(unsafe)}" if unsafe else "ended by its guardian", lost.why)
            if following is not None:
                to_nothing()
                following.follow()
        return not unsafe

    def _following(self, lanes: Sequence[Lane], stack: ExitStack) -> Following | None:
        """The following of the chambers, which can be found from now on; None where it fails, with that on record."""
        safe, held = ([lane.role for lane in lanes if lane.state == state] for state in ("safe", "held"))
        try:
            following = Following(guardian_of(self._run, self._runner), self._bench, safe, held)
            end_on_sigterm(following)  # before others can find it
            return stack.enter_context(following)
        except Exception as problem:  # noqa: BLE001  the bench is safe all the same
            self._notes.entry("alert", problem=f"the chambers cannot be followed: {in_words(problem)}")
            return None

    def _lanes(self, *, may_hold: bool) -> list[Lane]:
        limits_s, only_off = limits_to_make_safe(self._bench), is_locked_out(self._bench)
        hold = [role for role in self._addresses if may_hold and self._bench.devices[role].safe_state.hold_s]
        telling = partial(_tell, self._notes)
        return asyncio.run(make_safe_in_lanes(self._devices(), limits_s, telling, only_off=only_off, hold=hold))

    def _record(self, lanes: Sequence[Lane]) -> dict[str, str]:
        """Write how the lanes have ended; why those are not safe that are not. Returns when it is on the disk."""
        notes, unsafe = self._notes, {lane.role: lane.why for lane in lanes if lane.state not in ("safe", "held")}
        for lane in lanes:
            notes.entry("lane", **lane._asdict())
        notes.entry("ends", unsafe=unsafe)
        notes.line(f"NOT MADE SAFE: {', '.join(unsafe)}. Try 'bench make-safe'." if unsafe else "the bench is safe.")
        notes.do(partial(note_safe, {str(self._addresses[lane.role]) for lane in lanes if lane.state == "safe"}))
        if unsafe:
            connections = {role: str(address) for role, address in self._addresses.items()}
            notes.do(partial(keep_unsafe, self._run, wall_utc(), unsafe, connections))
        notes.close()
        return unsafe

    def _alert(self, what: str, why: str) -> None:
        """Alert a person, where the bench file names a program; last, because that may take its time."""
        if self._bench.alert is None:
            return
        title = f"{self._run.name}: {what}"
        if problem := alert(self._bench.alert.exec, title, f"{title}\n{why}\n"):
            notes = Notes(self._run, INCIDENT)
            notes.line(problem)
            notes.entry("alert", problem=problem)
            notes.close()

    def _devices(self) -> dict[str, Device]:
        return {role: device_of(role, self._bench.devices[role], RealWires()) for role in self._addresses}


def _tell(notes: Notes, lane: Lane) -> None:
    notes.line(f"{lane.role} {lane.state} {lane.why}".rstrip())


@contextmanager
def _held(addresses: Collection[Address], who: str) -> Iterator[None]:
    """Hold the addresses; InUseError when another program has one of them for longer than the dead run can."""
    with ExitStack() as held:
        for left in reversed(range(ATTEMPTS)):
            try:
                held.enter_context(holding(addresses, who))
                break
            except InUseError:
                if not left:
                    raise
                _pause(BETWEEN_ATTEMPTS_S)
        yield
