"""What a guardian does when its run has died: it makes the bench safe with drivers of its own, and records how."""

from __future__ import annotations

import asyncio
import hashlib
import json
import sys
import threading
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from bench.clock import wall_utc
from bench.config.bench import load_bench
from bench.errors import InputError, InUseError, StoreError
from bench.files import append_line
from bench.lanes import Lane, make_safe_in_lanes
from bench.rig import device_of
from bench.runner.held import energising_addresses, holding
from bench.store.energised import note_safe
from bench.store.unsafe import keep_unsafe
from bench.store.user_state import state_folder
from drivers.capabilities import Device
from drivers.transport.address import Address
from drivers.transport.wires import RealWires

INCIDENT = "incident.jsonl"
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
        self._devices()  # imports them while there is memory

    def make_safe(self, why: str) -> bool:
        """Make every instrument safe, and record how; whether all of them are."""
        self._tell(f"{self._run.name}: {why}. Its guardian makes the bench safe: {', '.join(self._addresses)}.")
        self._record({"event": "begins", "why": why})
        try:
            with _held(self._addresses.values()):
                lanes = asyncio.run(self._lanes())
        except (InUseError, StoreError) as problem:
            lanes = [Lane(role, "not reached", str(problem), 0.0) for role in self._addresses]
        unsafe = {lane.role: lane.why for lane in lanes if lane.state != "safe"}
        for lane in lanes:
            self._record({"event": "lane", **lane._asdict()})
        self._record({"event": "ends", "unsafe": unsafe})
        self._tell(
            f"{self._run.name}: NOT MADE SAFE: {'; '.join(unsafe.values())}. Try 'bench make-safe'."
            if unsafe
            else f"{self._run.name}: the bench is safe."
        )
        with suppress(StoreError):
            note_safe({str(self._addresses[lane.role]) for lane in lanes if lane.state == "safe"})
            if unsafe:
                keep_unsafe(self._run, wall_utc(), unsafe, {role: str(at) for role, at in self._addresses.items()})
        return not unsafe

    async def _lanes(self) -> list[Lane]:
        return await make_safe_in_lanes(
            self._devices(), lambda lane: self._tell(f"{lane.role}: {lane.state} {lane.why}".rstrip())
        )

    def _devices(self) -> dict[str, Device]:
        return {role: device_of(role, self._bench.devices[role], RealWires()) for role in self._addresses}

    def _record(self, entry: Mapping[str, Any]) -> None:
        """Durable in the directory of the run, and beside the records of this user, as far as there is a disk."""
        line = {"at": wall_utc().isoformat(timespec="milliseconds"), "run": str(self._run.absolute()), **entry}
        text = json.dumps(line, ensure_ascii=False)
        for path in self._places():
            with suppress(OSError):
                append_line(path, text)

    def _places(self) -> Iterator[Path]:
        if self._run.is_dir():
            yield self._run / INCIDENT
        with suppress(OSError):
            yield state_folder() / INCIDENT

    def _tell(self, text: str) -> None:
        with suppress(OSError, ValueError):  # the terminal may be gone
            sys.stderr.write(text + "\n")
            sys.stderr.flush()


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
