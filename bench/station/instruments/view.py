"""Instruments of a bench as the API and the pages show them."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from enum import StrEnum
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from bench.config.devices import DeviceEntry
from bench.config.models import BenchFile
from bench.errors import InputError, error_message
from bench.runner.held import LOOKS, Kind, energising_addresses, owners, real_addresses, why_locked_out
from bench.sequence.plan.scope import unit_of
from bench.station.daemon import Daemon
from bench.station.instruments.calibrations import CalibrationView, calibrations_of, days_ahead, today_at
from bench.station.instruments.records import Fault, Identified, identified, under_way
from bench.station.runs.live import LiveRun
from bench.station.view import LeaseView, ReadingView, run_view
from bench.store.latch import latch
from bench.store.runs import RunSummary

FAULTS_SHOWN = 5


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True)


class Guarding(StrEnum):
    """What the guardian of a bench does."""

    NOT_NEEDED = "not needed"  # no real instrument moves or energises anything
    NONE = "none"  # no run is in progress
    GUARDS = "guards"
    RESCUES = "rescues"
    FOLLOWS = "follows"  # the chambers after a run


class LimitView(_Model):
    """Permitted range of the bench file."""

    name: str
    low: float | None
    high: float | None
    unit: str


class FaultView(_Model):
    """Error of an instrument in the journal of a run."""

    run: str
    at: datetime | None
    kind: str
    text: str


class InstrumentView(_Model):
    """Instrument of a bench; its identity is that which a run has read last."""

    role: str
    driver: str
    title: str
    capabilities: list[str]
    connection: str
    simulated: bool
    maker: str = ""
    model: str = ""
    serial: str = ""
    firmware: str = ""
    serial_verified: bool = Field(False, description="it has reported its serial number itself")
    identified_by: str = Field("", description="run that has read the identity; empty if none has")
    identified_at: str = ""
    calibrations: list[CalibrationView]
    limits: list[LimitView]
    safe_state: str
    channels: list[str] = Field(description="names of its readings, as orders and sequences use them")
    readings: list[ReadingView] = Field([], description="newest readings of the run in progress")
    faults: list[FaultView]
    held_by: str = Field("", description="program that talks to it; of simulated ones it is not known")


class LatchView(_Model):
    """Run that waits for somebody to acknowledge what has happened."""

    run: str
    why: str


class BenchInstruments(_Model):
    """Instruments of a bench, and who holds it."""

    name: str
    title: str
    problem: str = Field("", description="why its file cannot be read; the rest is empty then")
    simulated: bool = False
    instruments: list[InstrumentView] = []
    run: str = Field("", description="run in progress")
    run_title: str = ""
    operator: str = ""
    is_manual: bool = Field(False, description="the run in progress is a session of manual control that takes orders")
    lease: LeaseView | None = None
    guardian: Guarding = Guarding.NONE
    locked_out: str = Field("", description="who works at the bench, and why; empty if it is not locked out")
    latches: list[LatchView] = []
    stopped: str = Field("", description="why no item begins; empty if items begin")


def bench_instruments(daemon: Daemon, name: str, now: datetime) -> BenchInstruments:
    """Return the instruments of a bench. Raises InputError if the station does not have it. Blocks for the disk."""
    title = daemon.settings.titles.get(name, name)
    daemon.settings.bench_file(name)
    try:
        bench = daemon.scheduler.bench(name)
    except InputError as problem:
        return BenchInstruments(name=name, title=title, problem=error_message(problem))
    runs, live = daemon.records.runs(name), daemon.live_at(name)
    faults = daemon.records.faults(runs, list(bench.devices))
    certificates = calibrations_of(name, bench, today_at(daemon, name, now), days_ahead(daemon))
    readings = _readings(bench, live)
    new = under_way(live.run) if live is not None else {}
    instruments = [
        _instrument(
            bench, role, new.get(role) or identified(role, entry, runs), certificates, readings.get(role, []), faults
        )
        for role, entry in bench.devices.items()
    ]
    lease = daemon.leases.of(name)
    return BenchInstruments(
        name=name, title=title, simulated=bench.is_simulated, instruments=instruments, guardian=_guarding(bench, live),
        lease=LeaseView.of(lease) if lease is not None else None, locked_out=why_locked_out(bench),
        latches=_latches(runs), stopped=daemon.queue.stopped(name), **_holder(live),
    )  # fmt: skip


def _holder(live: LiveRun | None) -> dict[str, Any]:
    if live is None:
        return {}
    manifest = live.run.manifest
    return {
        "run": live.run.id, "run_title": str(manifest.get("title", "")), "operator": str(manifest.get("operator", "")),
        "is_manual": bool(live.status.get("manual")),
    }  # fmt: skip


def _instrument(
    bench: BenchFile, role: str, known: Identified | None, certificates: list[CalibrationView],
    readings: list[ReadingView], faults: list[Fault],
) -> InstrumentView:  # fmt: skip
    entry, identity = bench.devices[role], dict[str, Any]()
    if known is not None:
        identity = {part: known.text(part) for part in ("maker", "model", "serial", "firmware")}
        identity |= {"identified_by": known.run, "identified_at": known.at}
        identity["serial_verified"] = bool(known.identity.get("serial_verified"))
    shown = [
        FaultView(run=each.run, at=each.at, kind=each.kind, text=each.text) for each in faults if each.device == role
    ]
    return InstrumentView(
        role=role, driver=entry.driver, title=entry.description.title,
        capabilities=sorted(entry.description.capabilities), connection=str(entry.connection),
        simulated=entry.connection.simulated, limits=limits_of(entry), safe_state=entry.safe_state.words,
        calibrations=[each for each in certificates if each.device == role], readings=readings,
        channels=_channels(bench, role), faults=shown[:FAULTS_SHOWN], held_by=_held_by(entry), **identity,
    )  # fmt: skip


def limits_of(entry: DeviceEntry) -> list[LimitView]:
    """Return the permitted ranges of an instrument, as the bench file states them; also the highest compliance."""
    found = []
    for name, allowed in entry.limits or ():
        low, high = getattr(allowed, "min", None), getattr(allowed, "max", None)
        if low is None and high is None:
            continue
        fields = type(allowed).model_fields
        units = (unit_of((fields[key].annotation, *fields[key].metadata)) for key in ("max", "min") if key in fields)
        found.append(LimitView(name=name, low=low, high=high, unit=next(filter(None, units), "")))
    if (most_v := getattr(entry.options, "compliance", None)) is not None:
        found.append(LimitView(name="compliance", low=None, high=float(most_v), unit="V"))
    return found


def _channels(bench: BenchFile, role: str) -> list[str]:
    named = {reading.from_: name for name, reading in bench.readings.items()}
    return [named.get(f"{role}.{channel}", f"{role}.{channel}") for channel in bench.devices[role].channels]


def _held_by(entry: DeviceEntry) -> str:
    if entry.connection.simulated:
        return ""
    return ", ".join(sorted(map(str, owners([entry.connection]))))


def _guarding(bench: BenchFile, live: LiveRun | None) -> Guarding:
    if not energising_addresses(bench):
        return Guarding.NOT_NEEDED
    addresses = list(real_addresses(bench).values())
    if any(owner.kind is Kind.RESCUE for owner in owners(addresses)):
        return Guarding.RESCUES
    if live is not None:
        return Guarding.GUARDS
    return Guarding.FOLLOWS if owners(addresses, LOOKS) else Guarding.NONE


def _readings(bench: BenchFile, live: LiveRun | None) -> Mapping[str, list[ReadingView]]:
    """Return the newest readings of a run in progress by device."""
    found: dict[str, list[ReadingView]] = {}
    for each in run_view(live).readings if live is not None else ():
        source = bench.readings[each.name].from_ if each.name in bench.readings else each.name
        found.setdefault(source.partition(".")[0], []).append(each)
    return found


def _latches(runs: list[RunSummary]) -> list[LatchView]:
    latched = [(run.id, latch(run)) for run in runs if run.state != "running"]
    return [LatchView(run=name, why=found.why) for name, found in latched if found is not None]
