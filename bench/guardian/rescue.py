"""Rescue of a bench whose run has died: make it safe with drivers of the guardian, and record the outcome."""

from __future__ import annotations

import asyncio
import hashlib
import threading
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path

from bench.clock import wall_utc
from bench.config.bench import load_bench
from bench.config.channels import period_s
from bench.errors import InputError, InUseError, error_message
from bench.guardian.follow import Following, end_on_sigterm, guardian_of, in_own_process, redirect_to_null
from bench.guardian.notes import Notes
from bench.guardian.watch import Lost, Over
from bench.lanes import Lane, make_safe_in_lanes
from bench.rig import device_of, limits_to_make_safe
from bench.runner.alert import alert
from bench.runner.held import Kind, address_lock, energising_addresses, is_locked_out
from bench.store.energised import note_safe
from bench.store.latch import INCIDENT
from bench.store.unsafe import write_unsafe
from drivers.capabilities import Device
from drivers.transport.address import Address
from drivers.transport.wires import RealWires

ATTEMPTS, BETWEEN_ATTEMPTS_S = 20, 0.25  # the kernel releases the locks of a run when its process has ended
_pause = threading.Event().wait


class Rescue:
    """Bench that is loaded and ready to be made safe. Raises InputError if the bench file has changed."""

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
        self._devices()  # import the drivers while memory is available

    def alarm(self, why: str) -> None:
        """Record that a counter of the run is late, and alert a person; returns at once."""
        self._notes.entry("alarm", why=why)
        self._alerts.append(threading.Thread(target=self._alert, args=("look at it", why), name="alert", daemon=True))
        self._alerts[-1].start()

    def leave(self, end: Over) -> None:
        """Supervise the chambers of a run that has ended, in a separate process."""
        self._notes.close()
        for thread in self._alerts:  # a fork would copy locks that other threads hold, without those threads
            thread.join()
        if end.safe or end.held:
            by = guardian_of(self._run, self._runner)
            in_own_process(partial(Following, by, self._bench, end.safe, end.held))

    def make_safe(self, lost: Lost) -> bool:
        """Make every instrument safe, record the outcome and supervise the chambers; return True if all are safe."""
        notes = self._notes
        notes.line(f"{lost.why}. Its guardian makes the bench safe: {', '.join(self._addresses)}.")
        notes.entry("begins", why=lost.why)
        with ExitStack() as stack:
            following: Following | None = None
            try:
                with _held(self._addresses.values(), f"the guardian of {self._run.name}"):
                    lanes = self._lanes(may_hold=lost.may_hold)
                    unsafe = self._record(lanes)
                    following = self._following(lanes, stack)
            except Exception as problem:  # noqa: BLE001  record any failure as "not safe"
                unsafe = self._record(
                    [Lane(role, "not reached", error_message(problem), 0.0) for role in self._addresses]
                )
            notes.close()
            self._alert(f"NOT MADE SAFE: {', '.join(unsafe)}" if unsafe else "ended by its guardian", lost.why)
            if following is not None:
                redirect_to_null()
                following.follow()
        return not unsafe

    def _following(self, lanes: Sequence[Lane], stack: ExitStack) -> Following | None:
        """Return the registered supervision of the chambers; None, with an entry in the record, if it fails."""
        safe, held = ([lane.role for lane in lanes if lane.state == state] for state in ("safe", "held"))
        try:
            following = Following(guardian_of(self._run, self._runner), self._bench, safe, held)
            end_on_sigterm(following)  # before other programs can find it
            return stack.enter_context(following)
        except Exception as problem:  # noqa: BLE001  the bench is safe all the same
            self._notes.entry("alert", problem=f"the chambers cannot be followed: {error_message(problem)}")
            return None

    def _lanes(self, *, may_hold: bool) -> list[Lane]:
        limits_s, only_off = limits_to_make_safe(self._bench), is_locked_out(self._bench)
        hold = [role for role in self._addresses if may_hold and self._bench.devices[role].safe_state.hold_s]
        show = partial(_show_lane, self._notes)
        return asyncio.run(make_safe_in_lanes(self._devices(), limits_s, show, only_off=only_off, hold=hold))

    def _record(self, lanes: Sequence[Lane]) -> dict[str, str]:
        """Record the outcome of the lanes, durably; return the reasons of those that are not safe."""
        notes, unsafe = self._notes, {lane.role: lane.why for lane in lanes if lane.state not in ("safe", "held")}
        for lane in lanes:
            notes.entry("lane", **lane._asdict())
        notes.entry("ends", unsafe=unsafe)
        notes.line(f"NOT MADE SAFE: {', '.join(unsafe)}. Try 'bench make-safe'." if unsafe else "the bench is safe.")
        notes.do(partial(note_safe, {str(self._addresses[lane.role]) for lane in lanes if lane.state == "safe"}))
        if unsafe:
            connections = {role: str(address) for role, address in self._addresses.items()}
            notes.do(partial(write_unsafe, self._run, wall_utc(), unsafe, connections))
        notes.close()
        return unsafe

    def _alert(self, what: str, why: str) -> None:
        """Run the alert program of the bench file, if any; called last, because it may take long."""
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


def _show_lane(notes: Notes, lane: Lane) -> None:
    notes.line(f"{lane.role} {lane.state} {lane.why}".rstrip())


@contextmanager
def _held(addresses: Collection[Address], who: str) -> Iterator[None]:
    """Hold the locks of the addresses; InUseError if another program has one for longer than the dead run can."""
    with ExitStack() as held:
        for _ in range(ATTEMPTS - 1):
            with suppress(InUseError):
                held.enter_context(address_lock(addresses, who, Kind.RESCUE))
                break
            _pause(BETWEEN_ATTEMPTS_S)
        else:
            held.enter_context(address_lock(addresses, who, Kind.RESCUE))
        yield
