"""Identities and errors of the instruments of a bench, from the records of its last runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from datetime import datetime
from itertools import islice
from typing import Any, NamedTuple

from bench.config.devices import DeviceEntry
from bench.errors import StoreError
from bench.station.runs.catalogue import Catalogue
from bench.store.reader import Event
from bench.store.runs import RunSummary
from bench.store.tail import Tail, instant_at

RUNS, RUNS_WITH_ERRORS, ENTRIES = 50, 5, 200
FAULTS = ("fault", "device_left_out", "not_reached", "step_failed", "order_made_safe", "made_safe")


class Identified(NamedTuple):
    """Identity of an instrument, and the run that has read it."""

    identity: Mapping[str, Any]
    run: str
    at: str

    def text(self, name: str) -> str:
        """Return a part of the identity; "" if it is not known."""
        return str(self.identity.get(name) or "")


class Fault(NamedTuple):
    """Error of an instrument in the journal of a run."""

    device: str
    run: str
    at: datetime | None
    kind: str
    text: str


class Records:
    """Records of the last runs of each bench; `bench_in` returns the bench of a manifest."""

    def __init__(self, catalogue: Catalogue, bench_in: Callable[[Mapping[str, Any]], str | None]) -> None:
        self._catalogue, self._bench_in = catalogue, bench_in
        self._faults: dict[str, list[Fault]] = {}

    def runs(self, bench: str) -> list[RunSummary]:
        """Return the last runs of a bench, newest first."""
        return list(islice((run for run in self._catalogue.all() if self._bench_in(run.manifest) == bench), RUNS))

    def faults(self, runs: list[RunSummary], roles: list[str]) -> list[Fault]:
        """Return the errors of instruments in the newest of some runs, newest first."""
        return [fault for run in runs[:RUNS_WITH_ERRORS] for fault in self._of_run(run) if fault.device in roles]

    def _of_run(self, run: RunSummary) -> list[Fault]:
        if run.id in self._faults:
            return self._faults[run.id]
        found: list[Fault] = []
        try:
            with Tail(run.path) as tail:
                begins, entries = tail.begins(), tail.of_kinds(FAULTS, ENTRIES)
        except StoreError:
            return found  # it has just begun, or its record is damaged, which the page of the run shows
        for event in entries:
            at = instant_at(begins, event.at_s)
            found += [Fault(device, run.id, at, event.kind, text) for device, text in _errors(event)]
        if run.has_outcome:
            self._faults[run.id] = found
        return found


def under_way(run: RunSummary) -> dict[str, Identified]:
    """Return the identities that a run in progress has read, by device; its manifest has none yet."""
    try:
        with Tail(run.path) as tail:
            entries = tail.of_kinds(("identified",), ENTRIES)
    except StoreError:
        return {}
    started = str(run.manifest.get("started", ""))
    return {str(each.data.get("device", "")): Identified(each.data, run.id, started) for each in entries}


def identified(role: str, entry: DeviceEntry, runs: list[RunSummary]) -> Identified | None:
    """Return the identity of an instrument as the newest run has read it from the same driver and address; or None."""
    for run in runs:
        found = run.manifest.get("instruments", {}).get(role)
        is_same = isinstance(found, Mapping) and (found.get("driver"), found.get("connection")) == (
            entry.driver, str(entry.connection)
        )  # fmt: skip
        if is_same and any(found.get(name) for name in ("maker", "model", "serial", "fingerprint")):
            return Identified(found, run.id, str(run.manifest.get("started", "")))
    return None


def _errors(event: Event) -> Iterator[tuple[str, str]]:
    """Yield device and text of each error in an entry."""
    data = event.data
    text = str(data.get("text") or data.get("problem") or "")
    match event.kind:
        case "made_safe":
            unsafe = data.get("unsafe")
            yield from ((str(role), str(why)) for role, why in unsafe.items()) if isinstance(unsafe, Mapping) else ()
        case "step_failed":
            yield text.partition(":")[0], text  # errors of drivers begin with the device
        case "order_made_safe":
            yield str(data.get("device", "")), "made safe after its order had failed"
        case _:
            yield str(data.get("device", "")), text
