"""Facts of a run besides its results: events, site, instruments, files."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bench.config.devices import Calibration
from bench.config.fixture import FixtureEntry
from bench.figures.languages import tr
from bench.figures.numbers import decimals
from bench.figures.times_and_sizes import duration, instant
from bench.figures.words import ENDINGS
from bench.metrology.acquisition import Codes
from bench.metrology.run_data import RunData
from bench.reduce.stored_run import StoredRun
from bench.sequence.method import known_methods
from bench.sequence.plan.dwells import first_visit
from bench.store.reader import Event
from bench.store.verify import Record

POWER = {
    "line": "The computer was on line power.",
    "battery": "The computer was on battery.",
    "low": "The battery of the computer was low.",
    "unknown": "The state of the computer's power was not known.",
}
Facts = list[tuple[str, str]]
"""Pairs of a name and a text."""


@dataclass(frozen=True)
class Instrument:
    """A device of the bench, or a named reading of one that is calibrated on its own.

    `is_past_due` is true if its calibration was due before the day of the run.
    """

    role: str
    driver: str
    calibration: Calibration | None
    is_past_due: bool
    name: str = ""
    serial: str = ""
    is_stated: bool = False
    firmware: str = ""
    fingerprint: str = ""
    connection: str = ""


def problems(run: StoredRun, not_evaluated: str, verdict: str) -> Iterator[str]:
    """Problems in the order of their importance; empty if there were none."""
    manifest = run.manifest
    for damage in run.damage:
        yield tr("THE RECORD OF THIS RUN IS DAMAGED: {what}", what=damage)
    for device, why in manifest.get("unsafe", {}).items():
        yield tr("{device} COULD NOT BE MADE SAFE: {why}", device=device, why=why)
    dropped = [
        tr("After {time}: {what}", time=_since_start(run, event), what=event.data["text"])
        for event in run.reader.events("unit_dropped")
    ]
    yield from dropped
    yield from (reported for reported in manifest["problems"] if not any(reported in text for text in dropped))
    ended = next(run.reader.events("run_ended"), None)
    if ended is None or ended.data["how"] != "completed":
        yield tr("The run did not complete.") + " " + tr(ENDINGS[manifest["state"]])
        yield from (tr("Not completed: step {step}.", step=step) for step in _unfinished(run))
    yield from (each.in_words for each in run.journal_records.interruptions)
    for event in run.reader.events("left_out"):
        yield tr("Left out: step {step}.", step=event.step) + f" {event.data['text']}"
    if not_evaluated and not_evaluated not in manifest["problems"]:
        yield tr("The data could not be evaluated: {why}", why=not_evaluated)
    before = manifest["verdict"]
    if before not in (None, verdict):
        yield tr(
            "The run ended with the verdict {before}; re-evaluated now, it is {now}.",
            before=tr(before),
            now=tr(verdict),
        )


def _since_start(run: StoredRun, event: Event) -> str:
    """Time since the first entry of the record; in runs of earlier versions bench time does not begin at 0."""
    return duration(event.at_s - run.reader.span_s()[0])


def _unfinished(run: StoredRun) -> list[str]:
    """Steps that began and did not end, in their last execution."""
    began: dict[str, None] = {}
    for event in run.reader.events("step_begins", "step_ended", "left_out"):
        step = first_visit(event.step)
        if event.kind == "step_begins":
            began[step] = None
        else:
            began.pop(step, None)
    return list(began)


def notes_of_steps(run: StoredRun) -> Iterator[str]:
    """Notes that the sequence wrote to the record, with their times."""
    for event in run.reader.events("step_ended"):
        when = _since_start(run, event)
        if "note" in event.data:
            yield tr("{text} ({time} after the start)", text=event.data["note"], time=when)
        if "alarm" in event.data:
            yield tr("Alarm: {text} ({time} after the start)", text=event.data["alarm"], time=when)


def left_on(run: StoredRun) -> Iterator[str]:
    """Instruments that were found energised, and those that earlier runs had left on."""
    for event in run.reader.events("found_energised"):
        names = "; ".join(f"{role}: {found['text']}" for role, found in sorted(event.data["devices"].items()))
        yield tr("Found energised, and made safe before the first step: {names}.", names=names)
    for event in run.reader.events("found_left_on"):
        found = event.data["devices"]
        names = f"{', '.join(sorted(found))} ({', '.join(sorted(set(found.values())))})"
        yield tr("Left on by an earlier run, and made safe before the first step: {names}.", names=names)


def power(run: StoredRun) -> Iterator[str]:
    """States of the computer's power, if they changed during the run."""
    found = list(run.reader.events("power"))
    for event in found if len(found) > 1 else ():
        yield f"{tr(POWER[event.data['state']])} ({event.data['text']}, {_since_start(run, event)})"


def repetitions(run: StoredRun) -> Iterator[str]:
    """Repeated questions, readings and steps, after a failure or by the operator."""
    yield from (each.in_words for each in run.journal_records.superseded)
    kinds = ("retried", "operator", "device_note", "doubted", "clock_step", "stalled", "device_left_out", "not_reached")
    for event in run.reader.events(*kinds):
        when = _since_start(run, event)
        if event.kind == "clock_step":
            yield from _steps_of_clock(event, when)
        elif event.kind == "stalled":
            yield tr(
                "This program was suspended for {seconds} s, {time} after the start; the bench was not monitored.",
                seconds=f"{event.data['for_s']:g}", time=when,
            )  # fmt: skip
        elif event.kind in ("device_left_out", "not_reached"):
            if event.data.get("used"):  # the problem that ended the run
                continue
            role = event.data["device"]
            yield tr("{role}, which the run does not use, {time} after the start:", role=role, time=when) + (
                f" {event.data['text']}"
            )
        elif event.kind == "device_note":
            text = tr("{role}, {time} after the start:", role=event.data["device"], time=when)
            yield f"{text} {event.data['text']}"
        elif event.kind == "doubted":
            yield tr("Reading rejected, {time} after the start:", time=when) + f" {event.data['text']}"
        elif event.kind == "retried":
            yield tr("Repeated: step {step}.", step=event.step) + f" {event.data['text']}"
        elif event.data["action"] == "repeat":
            yield tr("Repeated by the operator: step {step}.", step=event.step)


def _steps_of_clock(event: Event, when: str) -> Iterator[str]:
    step, slept = f"{event.data['set_by_s']:+g}", event.data["slept_s"]
    if event.data["set_by_s"]:
        yield tr(
            "The computer's clock was set by {step} s, {time} after the start; the times of this run are unaffected.",
            step=step, time=when,
        )  # fmt: skip
    if slept:
        yield tr(
            "The computer slept for {slept} s, {time} after the start; the bench was not monitored.",
            slept=slept, time=when,
        )  # fmt: skip


def faults_on_purpose(run: StoredRun) -> Iterator[str]:
    """Injected faults of a rehearsal, with their times; none for a run without scenario."""
    for event in run.reader.events("fault_begins", "fault_ends"):
        when, what = duration(event.at_s), f"{event.data['victim']} {event.data['fault']}"
        if event.kind == "fault_begins":
            yield tr("Fault injected, {time} after the start: {what}.", time=when, what=what)
        else:
            yield tr("Injected fault removed, {time} after the start: {what}.", time=when, what=what)


def past_due(instruments: Sequence[Instrument]) -> Iterator[str]:
    """A sentence for each expired calibration."""
    for instrument in instruments:
        if instrument.calibration is not None and instrument.is_past_due:
            due = instrument.calibration.due
            yield tr("{role}: its calibration was due on {due}, before this run.", role=instrument.role, due=due)


def simulated(manifest: Mapping[str, Any], roles: Sequence[str]) -> str:
    """Simulated instruments; empty if all were real."""
    found = [role for role in roles if role in manifest["simulated"]]
    if not found:
        return ""
    return tr("every instrument") if len(found) == len(roles) else tr(", ").join(found)


def times(run: StoredRun) -> Facts:
    """Date and duration of the run."""
    manifest, zone = run.manifest, run.bench.site.time_zone
    bench_s = manifest["bench_s"]
    if bench_s is None:
        began_s, ended_s = run.reader.span_s()
        bench_s = ended_s - began_s
    wall_s = manifest["wall_s"]
    wall = f"{wall_s:.1f} s" if wall_s is not None and wall_s < 10 else duration(wall_s or 0.0)
    took = tr("{time} of bench time", time=duration(bench_s))
    facts = [
        (tr("Operator"), manifest["operator"] or tr("not stated")),
        (tr("Started"), instant(manifest["started"], zone)),
        (tr("Ended"), instant(manifest["ended"], zone)),
        (tr("Duration"), took + (tr(", {time} of wall time", time=wall) if wall_s else "")),
    ]
    if manifest["simulated"]:
        facts.append((tr("Bench time begins"), instant(run.began.isoformat(), zone)))
    return facts


def site(run: StoredRun) -> Facts:
    """Bench, its site, and the fixture."""
    bench = run.bench
    g, level = bench.site.gravity, bench.fixture.level
    digits = decimals(g.U)
    return [
        (tr("Bench"), bench.title),
        (tr("Latitude, height"), f"{bench.site.latitude:g}°, {bench.site.height:g} m"),
        (tr("Local gravity g"), f"{g.value:.{digits}f} m/s² ± {g.U:.{digits}f} m/s² (k = {g.k:g}), {tr(g.origin)}"),
        (tr("Fixture"), bench.fixture.serial),
        *_geometry(bench.fixture),
        (
            tr("Level of the fixture"),
            f"{level.value:g} ± {level.U:g} arcsec (k = {level.k:g}), " + tr("of {date}", date=level.date),
        ),
    ]


def _geometry(fixture: FixtureEntry) -> Facts:
    """Orientation of the units."""
    if (axis := fixture.input_axis) is not None:
        reported = tr("{at_0} at head angle 0°, {at_90} at 90°", at_0=tr(axis.at_0), at_90=tr(axis.at_90))
        return [(tr("Input axis"), reported)]
    if (body := fixture.body) is None:
        return []
    axes = [f"{each.device}, {tr(each.points)}" for each in fixture.axes]
    turning = [(tr("Axes of the table at 0°, outer first"), tr("; ").join(axes))] if axes else []
    return [*turning, (tr("Fixture at 0°"), f"x {tr(body.x)}, z {tr(body.z)}")]


def instruments(run: StoredRun) -> list[Instrument]:
    """Every device with its identification, then the readings with a certificate of their own."""
    identities = dict(run.manifest["instruments"])
    for event in run.reader.events("identified"):
        identities.setdefault(event.data["device"], event.data)
    day = run.began.date()
    found = []
    for role, entry in run.bench.devices.items():
        identity = identities.get(role, {})
        connection = entry.connection.as_simulated() if role in run.manifest["simulated"] else entry.connection
        found.append(
            Instrument(
                role=role,
                driver=entry.driver,
                calibration=entry.calibration,
                is_past_due=_is_past_due(entry.calibration, day),
                name=f"{identity.get('maker', '')} {identity.get('model', '')}".strip(),
                serial=identity.get("serial", ""),
                is_stated=not identity.get("serial_verified", False),
                firmware=identity.get("firmware", ""),
                fingerprint=identity.get("fingerprint", ""),
                connection=str(connection),
            )
        )
    for name, reading in run.bench.readings.items():
        if reading.calibration is not None:
            source = tr("reading {name}", name=reading.from_)
            found.append(Instrument(name, source, reading.calibration, _is_past_due(reading.calibration, day)))
    return found


def _is_past_due(calibration: Calibration | None, day: dt.date) -> bool:
    return calibration is not None and calibration.due < day


def provenance(run: StoredRun, data: Sequence[RunData]) -> Facts:
    """Origin of the results: files, versions and digests, to find and recompute them."""
    manifest, host = run.manifest, run.manifest["host"]
    methods = [tr(known_methods()[entry.method].title) for entry in run.sequence.results]
    return [
        (tr("Method"), tr(", ").join(dict.fromkeys(methods)) or tr("none")),
        (tr("Sequence"), f"{manifest['sequence']}: {manifest['title']}"),
        (tr("Preset"), manifest["preset"] or tr("none")),
        *((tr("Parameter {name}", name=name), value) for name, value in manifest["parameters"].items()),
        *(
            (tr("Calibration of unit {uut}", uut=run.serials[place]), _released(found))
            for place, found in manifest.get("released", {}).items()
        ),
        *([(tr("Seed of the simulation"), str(manifest["seed"]))] if manifest["simulated"] else []),
        *recorded(run, data),
        (tr("Digest of the data"), manifest.get("digest", tr("not computed"))),
        *([(tr("Record"), _record(run.record))] if run.record is not None else []),
        *((name, value) for name, value in manifest["hashes"].items()),
        (tr("Programs"), ", ".join(f"{name} {version}" for name, version in manifest["software"].items())),
        (tr("Computer"), f"{host['name']}, {host['system']}, Python {host['python']}"),
    ]


def _record(record: Record) -> str:
    """Identification of the record of the run."""
    if record.damage:
        return tr("damaged")
    if record.kind == "sealed":
        return tr("sealed, {rows} rows, head {head}", rows=record.rows, head=record.head)
    if record.kind == "unchained":
        return tr("unsealed, written by an earlier version")
    return tr("not sealed; intact up to row {rows}", rows=record.rows)


def _released(found: Mapping[str, Any]) -> str:
    low_c, high_c = found["valid_c"]
    return tr(
        "{file}, of run {run}, known from {low} °C to {high} °C",
        file=found["file"], run=found["run"] or "–", low=f"{low_c:.4g}", high=f"{high_c:.4g}",
    )  # fmt: skip


def recorded(run: StoredRun, data: Sequence[RunData]) -> Iterator[tuple[str, str]]:
    """Received and lost data."""
    yield tr("Frames recorded"), f"{run.reader.frame_count()}"
    counts = [
        (channel, found)
        for part in data
        for acquisition in part.acquisitions
        for channel, found in acquisition.counts.items()
        if channel in {unit.channel for unit in part.units}
    ]
    for meter in dict.fromkeys(unit.voltmeter for part in data for unit in part.units if unit.voltmeter):
        read = [each.voltages[meter] for part in data for each in part.acquisitions if meter in each.voltages]
        yield tr("Voltmeter {name}", name=meter), _readings([len(each.at_s) for each in read])
    for meter in dict.fromkeys(unit.ammeter for part in data for unit in part.units if unit.ammeter):
        through = [each.currents[meter] for part in data for each in part.acquisitions if meter in each.currents]
        yield tr("Ammeter {name}", name=meter), _readings([len(each.at_s) for each in through])
    for sent in dict.fromkeys(unit.telemetry for part in data for unit in part.units if unit.telemetry):
        yield (
            tr("Telemetry {channel}", channel=sent),
            _samples([each.codes[sent] for part in data for each in part.acquisitions if sent in each.codes]),
        )
    for channel in dict.fromkeys(channel for channel, _ in counts):
        of_channel = [found for name, found in counts if name == channel]
        lost, restarts = (sum(getattr(found, name) for found in of_channel) for name in ("lost", "restarts"))
        whole = sum(len(found.tick) for found in of_channel)
        yield (
            tr("Channel {channel}", channel=channel),
            tr(
                "{whole} latches in {parts} acquisitions, {lost} lost, {restarts} restarts",
                whole=whole,
                parts=len(of_channel),
                lost=lost,
                restarts=restarts,
            ),
        )


def _readings(counts: Sequence[int]) -> str:
    """Number of readings of a meter, and of acquisitions."""
    return tr("{whole} readings in {parts} acquisitions", whole=sum(counts), parts=len(counts))


def _samples(sent: Sequence[Codes]) -> str:
    """Number of received samples, and of lost or invalid ones."""
    lost, dropped, invalid = (sum(getattr(each, name) for each in sent) for name in ("lost", "dropped", "invalid"))
    return tr(
        "{whole} samples in {parts} acquisitions, {lost} lost, {dropped} twice or late, {invalid} marked invalid",
        whole=sum(len(each.values) for each in sent), parts=len(sent), lost=lost, dropped=dropped, invalid=invalid,
    )  # fmt: skip
