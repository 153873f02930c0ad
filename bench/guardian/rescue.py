"""What a guardian does when its run has died: it makes the bench safe with drivers of its own, and records how."""

from __future__ import annotations

import asyncio
import hashlib
import threading
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

from bench.clock import wall_utc
from bench.config.bench import load_bench
from bench.errors import InputError, InUseError, in_words
from bench.guardian.notes import Notes
from bench.lanes import Lane, make_safe_in_lanes
from bench.rig import device_of, limits_to_make_safe
from bench.runner.alert import alert
from bench.runner.held import energising_addresses, holding, is_locked_out
from bench.store.energised import note_safe
from bench.store.unsafe import keep_unsafe
from drivers.capabilities import Device
from drivers.transport.address import Address
from drivers.transport.wires import RealWires

ATTEMPTS, BETWEEN_ATTEMPTS_S = 20, 0.25  # the locks of a run are free when the kernel has ended its process
_pause = threading.Event().wait


class Rescue:
    """A bench that is loaded and ready to be made safe. Raises InputError when the file is not the one of the run."""

    def __init__(self, run: Path, bench: Path, digest: str) -> None:
        loaded = load_bench(bench)
        if hashlib.sha256(loaded.document.text.encode()).hexdigest() != digest:
            raise InputError(f"{bench}: has changed since the run has read it")
        self._run, self._bench = run, loaded.bench
        self._addresses = energising_addresses(loaded.bench)
        self._notes = Notes(run)
        self._devices()  # imports them while there is memory

    def make_safe(self, why: str) -> bool:
        """Make every instrument safe, and record how; whether all of them are."""
        notes = self._notes
        notes.line(f"{why}. Its guardian makes the bench safe: {', '.join(self._addresses)}.")
        notes.entry("begins", why=why)
        try:
            with _held(self._addresses.values()):
                limits_s, only_off = limits_to_make_safe(self._bench), is_locked_out(self._bench)
                telling = partial(_tell, notes)
                lanes = asyncio.run(make_safe_in_lanes(self._devices(), limits_s, telling, only_off=only_off))
        except Exception as problem:  # noqa: BLE001  whatever it is, it is on record that the bench is not safe
            lanes = [Lane(role, "not reached", in_words(problem), 0.0) for role in self._addresses]
        unsafe = {lane.role: lane.why for lane in lanes if lane.state != "safe"}
        for lane in lanes:
            notes.entry("lane", **lane._asdict())
        notes.entry("ends", unsafe=unsafe)
        notes.line(f"NOT MADE SAFE: {', '.join(unsafe)}. Try 'bench make-safe'." if unsafe else "the bench is safe.")
        notes.do(partial(note_safe, {str(self._addresses[lane.role]) for lane in lanes if lane.state == "safe"}))
        if unsafe:
            connections = {role: str(address) for role, address in self._addresses.items()}
            notes.do(partial(keep_unsafe, self._run, wall_utc(), unsafe, connections))
        notes.close()
        self._alert(f"NOT MADE SAFE: {', '.join(unsafe)}" if unsafe else "ended by its guardian", why)
        return not unsafe

    def _alert(self, what: str, why: str) -> None:
        """Alert a person, where the bench file names a program; last, because that may take its time."""
        if self._bench.alert is None:
            return
        title = f"{self._run.name}: {what}"
        if problem := alert(self._bench.alert.exec, title, f"{title}\n{why}\n"):
            notes = Notes(self._run)
            notes.line(problem)
            notes.entry("alert", problem=problem)
            notes.close()

    def _devices(self) -> dict[str, Device]:
        return {role: device_of(role, self._bench.devices[role], RealWires()) for role in self._addresses}


def _tell(notes: Notes, lane: Lane) -> None:
    notes.line(f"{lane.role} {lane.state} {lane.why}".rstrip())


@contextmanager
def _held(addresses: Collection[Address]) -> Iterator[None]:
    """Hold the addresses; InUseError when another program has one of them for longer than the dead run can."""
    with ExitStack() as held:
        for left in reversed(range(ATTEMPTS)):
            try:
                held.enter_context(holding(addresses, "the guardian of a run"))
                break
            except InUseError:
                if not left:
                    raise
                _pause(BETWEEN_ATTEMPTS_S)
        yield
