"""Directory, manifest, register entry and first journal entry of a run, before anything is opened."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from bench.app.inputs import inputs_of
from bench.app.request import PreparedRun
from bench.app.resume import REQUEST, RESUMED, Resumption, request_json
from bench.clock import Clock, boot_id, since_boot_s
from bench.config.bench import LoadedBench
from bench.config.models import BenchFile
from bench.engine.ending import Outcome
from bench.engine.journal import Journal
from bench.errors import StoreError
from bench.runner import manifest
from bench.runner.found_on import LeftOn
from bench.runner.held import energising_addresses, is_followed
from bench.store.energised import energised, note_energised, note_safe
from bench.store.machine_state import problem_to_write
from bench.store.runs import MANIFEST, RunDirectory
from bench.store.seal import file_hash


def write_manifest(prepared: PreparedRun, directory: RunDirectory, started: datetime) -> dict[str, Any]:
    """Write the manifest of a starting run and its input files, durably; return the manifest."""
    record = manifest.opening(
        directory.path.name,
        prepared.plan,
        prepared.loaded.bench,
        prepared.serials,
        prepared.seed,
        prepared.request.operator,
        started,
    )
    record |= {"order": prepared.request.order, "procedure": prepared.request.procedure}
    record["released"] = {place: released.to_json() for place, released in prepared.released.items()}
    record[REQUEST] = request_json(prepared.request, prepared)
    record["hashes"] = keep_inputs(prepared, directory)
    directory.write_json(MANIFEST, record)
    return record


def instant(bench: BenchFile, resumption: Resumption | None) -> datetime | None:
    """Return the present instant in UTC by bench time; None for that of the computer."""
    if not bench.is_simulated:
        return None
    if resumption is None:
        return bench.simulation.start
    return resumption.began + timedelta(seconds=asyncio.get_running_loop().time() - resumption.began_s)


def write_beginning(journal: Journal, clock: Clock, prepared: PreparedRun, resumption: Resumption | None) -> None:
    """Journal the start of a run, or its resumption with the outage; on a real bench with the boot of the computer."""
    utc = clock.utc().isoformat()
    boot: dict[str, Any] = {}
    if not prepared.loaded.bench.is_simulated:
        boot = {"boot": boot_id(), "up_s": round(since_boot_s(), 3)}
    if resumption is None:
        journal.write("run_begins", utc=utc, title=prepared.plan.sequence.title, seed=prepared.seed, **boot)
        if prepared.preflight:
            journal.write("preflight", lines=list(prepared.preflight))
        return
    after_s = clock.monotonic() - resumption.last_s
    found: dict[str, Any] = {"number": resumption.number, "interrupted_s": resumption.last_s, **boot}
    if resumption.past.restarted:
        found["restarted"] = list(resumption.past.restarted)
    journal.write(RESUMED, utc=utc, outage_s=round(after_s, 3), interrupted=list(resumption.past.under_way), **found)


def keep_inputs(prepared: PreparedRun, directory: RunDirectory) -> dict[str, str]:
    """Copy the input files of the run into its directory, durably; return the hashes of the copies."""
    copies = inputs_of(prepared)
    for name, text in copies.items():
        directory.write_text(name, text)
    return {name: file_hash(directory.path / name) for name in copies}


class Register:
    """Register entry of one run; none for a bench without real connections. Errors are shown as notices."""

    def __init__(self, loaded: LoadedBench, run: Path, notice: Callable[[str], object]) -> None:
        self._bench, self._run, self._notice = loaded.document.path, run, notice
        self._connections = {role: str(address) for role, address in energising_addresses(loaded.bench).items()}

    def begin(self, at: datetime) -> LeftOn:
        """Register this run before anything is opened; return what other runs may have left on."""
        found: dict[str, str] = {}
        held: set[str] = set()
        if not self._connections:
            return LeftOn()
        if problem := problem_to_write():
            self._notice(f"{problem}. Until then 'bench make-safe' of other users does not know of this run.")
        roles = {address: role for role, address in self._connections.items()}
        try:
            for each in energised(lambda problem: self._notice(str(problem))):
                mine = {role: address for address, role in roles.items() if address in each.connections.values()}
                followed = [role for role, address in mine.items() if is_followed(address)]
                left = [role for role in mine if role not in followed]
                if followed:
                    held.update(followed)
                    self._notice(f"{', '.join(followed)}: held at its set point after {each.name}, and stays there.")
                if left:
                    found |= dict.fromkeys(left, each.name)
                    self._notice(
                        f"{each.name} ended without making {', '.join(left)} safe. This run makes them safe before its "
                        "first step."
                    )
            note_energised(self._run, self._bench, at, self._connections)
        except StoreError as problem:
            self._notice(f"{problem}: 'bench make-safe' will need --bench {self._bench}")
        return LeftOn(found, held)

    def end(self, outcome: Outcome) -> None:
        """Remove the instruments that this run has made safe; a held chamber is not safe yet."""
        left = {*outcome.unsafe, *outcome.not_reached, *outcome.held}
        try:
            note_safe({address for role, address in self._connections.items() if role not in left})
        except StoreError as problem:
            self._notice(str(problem))
