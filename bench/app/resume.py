"""Resumption of an interrupted run: reading it, deciding, and preparing it from its original files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

from bench.app.inputs import inputs_of
from bench.app.request import PreparedRun, RunRequest, prepare
from bench.engine.past import Past, done_of, interrupted_in, past_of, steps_to_restore
from bench.errors import InputError
from bench.files import content_hash
from bench.runner.held import energising_addresses, is_followed
from bench.sequence.language.values import as_written
from bench.store.energised import energised
from bench.store.kept_json import LIMIT_BYTES, read_kept
from bench.store.latch import latch
from bench.store.manifest_form import WHOLE_FORM
from bench.store.reader import Event, RunReader
from bench.store.runs import MANIFEST, summary
from bench.store.verify import examine
from drivers.schema.bounded import expect_bounded

REQUEST, RESUMED = "request", "run_resumed"  # key of the manifest, and kind of journal entry
_FILES = ("sequence", "bench", "parameters", "uut_model", "answers", "scenario")
_NOT_KEPT = frozenset({"runs", "not_after", "trace", "alert_routes"})
PROGRAM = "inertial-test-bench"


class Resumption(NamedTuple):
    """Interrupted run: directory, manifest, journal, and completed part of its plan.

    `last_s` is the bench time of the last record on the disk.
    """

    path: Path
    manifest: Mapping[str, Any]
    entries: tuple[Event, ...]
    last_s: float
    past: Past

    @property
    def began_s(self) -> float:
        """Bench time of the start of the run in s."""
        return self.entries[0].at_s

    @property
    def began(self) -> datetime:
        """UTC instant of `began_s`."""
        return datetime.fromisoformat(self.entries[0].data["utc"])

    @property
    def number(self) -> int:
        """Number of this resumption, from 1."""
        return 1 + sum(entry.kind == RESUMED for entry in self.entries)

    def outage_s(self, now: datetime) -> float:
        """Return the time since the last entry in s; 0 if the computer's clock was set back meanwhile."""
        return max(0.0, (now - self.began - timedelta(seconds=self.last_s - self.began_s)).total_seconds())

    def passed_s(self, now: datetime) -> float:
        """Return the real time since the start of the run in s, independent of clock settings; never negative.

        For a simulated bench it comes from the clock, since bench time does not contain it.
        """
        if "boot" in self.entries[0].data:
            return self.last_s - self.began_s + self.outage_s(now)
        return max(0.0, (now - datetime.fromisoformat(self.manifest["started"])).total_seconds())


def request_json(request: RunRequest, prepared: PreparedRun) -> dict[str, Any]:
    """Return the request of a run for its manifest, with absolute paths: enough to prepare it again."""
    kept: dict[str, Any] = {key: value for key, value in request._asdict().items() if key not in _NOT_KEPT}
    kept |= {"sequence": prepared.plan.document.path, "bench": prepared.loaded.document.path}
    kept |= {key: str(Path(kept[key]).absolute()) for key in _FILES if kept[key] is not None}
    kept["calibrations"] = [f"{place}={found.path.absolute()}" for place, found in prepared.released.items()]
    kept["units"] = [f"{place}={serial}" for place, serial in prepared.serials.items()]
    return {**kept, "settings": list(request.settings), "seed": prepared.seed}


def read_interrupted(path: Path) -> Resumption:
    """Read an interrupted run that may be resumed.

    Raises InputError with the reason, StoreError for a damaged record.
    """
    found = summary(path)
    if found.state != "interrupted":
        raise InputError(f"{found.id}: only an interrupted run is resumed; this one is {found.state}")
    if (latched := latch(found)) is not None:
        raise InputError(
            f"{found.id}: is latched: {latched.why}. Inspect the bench, then acknowledge the run: bench acknowledge "
            f"{found.id} --reason TEXT"
        )
    record = examine(path, thoroughly=False)
    if record.damage:
        raise InputError(f"{found.id}: {record.in_words}. {'; '.join(record.damage[:3])}. It is not resumed")
    expect_bounded(path / MANIFEST, LIMIT_BYTES)
    manifest = read_kept(path / MANIFEST, WHOLE_FORM)
    if REQUEST not in manifest:
        raise InputError(f"{found.id}: was started by a version of this program that did not record its request")
    with RunReader(path) as reader:
        entries, (_, last_s) = tuple(reader.events()), reader.span_s()
    if not entries:
        raise InputError(f"{found.id}: was interrupted before its first entry; start a new run")
    if any(entry.kind == "run_ended" for entry in entries):
        raise InputError(
            f"{found.id}: had ended when it was interrupted; 'bench reduce {found.id}' and 'bench report {found.id}' "
            "complete it"
        )
    return Resumption(path, manifest, entries, last_s, past_of(entries))


def prepare_again(resumption: Resumption, *, left_on: bool = False) -> PreparedRun:
    """Prepare the run as at its start; groups with a restart point are marked in the past of the resumption.

    Raises InputError with all differences, and if instruments may still be energised, unless `left_on`.
    """
    manifest = resumption.manifest
    asked: dict[str, Any] = dict(manifest[REQUEST])
    for key in ("parameters", "uut_model", "answers", "scenario"):
        asked[key] = None if asked.get(key) is None else Path(asked[key])
    for key in ("settings", "units", "calibrations"):
        asked[key] = tuple(asked[key])
    prepared = prepare(RunRequest(**asked, runs=resumption.path.parent))
    if (fault_seed := prepared.request.fault_seed) is not None:
        from bench.app.drawn_faults import with_drawn_faults  # imports the simulators

        prepared = with_drawn_faults(prepared, fault_seed)
    if problems := [*_changed(prepared, manifest), *_obstacles(prepared, resumption, left_on=left_on)]:
        raise InputError(*(f"{resumption.path.name}: {problem}" for problem in problems))
    plan, past = prepared.plan, resumption.past
    past.restart([group.id for group in interrupted_in((*plan.setup, *plan.steps), past)])
    return prepared


def summary_lines(resumption: Resumption, prepared: PreparedRun) -> Iterator[str]:
    """Yield lines about a resumption: time of the interruption, repeated and restored steps."""
    past, total = resumption.past, len(prepared.plan)
    done = len(past.over & {planned.id for planned in prepared.plan})
    last = resumption.began + timedelta(seconds=resumption.last_s - resumption.began_s)
    yield f"{resumption.path.name}: interrupted after {last:%Y-%m-%d %H:%M:%S} UTC; {done} of {total} steps are done."
    if past.under_way:
        yield f"Under way, and to be done again: {', '.join(past.under_way)}"
    if past.restarted:
        yield f"Done again from the begin of the group: {', '.join(past.restarted)}"
    restored = [planned.id for planned in steps_to_restore(done_of((*prepared.plan.setup, *prepared.plan.steps), past))]
    if restored:
        in_full = "in full, but for a soak whose chamber was held" if _holds(prepared) else "in full"
        yield f"Restored before, with all waiting {in_full}: {', '.join(restored)}"


def _holds(prepared: PreparedRun) -> bool:
    """Return True if a guardian may have held a chamber for this run."""
    bench = prepared.loaded.bench
    return not bench.is_simulated and any(entry.safe_state.hold_s for entry in bench.devices.values())


def _changed(prepared: PreparedRun, manifest: Mapping[str, Any]) -> list[str]:
    """Return the differences from the start of the run: files, parameters, program."""
    now = {name: content_hash(text.encode()) for name, text in inputs_of(prepared).items()}
    changed = [name for name in {**now, **manifest["hashes"]} if now.get(name) != manifest["hashes"].get(name)]
    problems = [f"{name} has changed since the run began; its copy is in the run directory" for name in changed]
    parameters = {name: as_written(value) for name, value in prepared.plan.parameters.items()}
    if parameters != manifest["parameters"]:
        problems.append("its parameters have changed since the run began")
    began_with, now_is = manifest["software"].get(PROGRAM), _version()
    if began_with != now_is:
        problems.append(f"was started by version {began_with} of this program; this is {now_is}")
    return problems


def _version() -> str:
    from importlib.metadata import version

    return version(PROGRAM)


def _obstacles(prepared: PreparedRun, resumption: Resumption, *, left_on: bool) -> list[str]:
    """Return the reasons why the run cannot be resumed, each with what to do."""
    problems: list[str] = []
    plan, past = prepared.plan, resumption.past
    groups = list(interrupted_in((*plan.setup, *plan.steps), past))
    again = tuple(f"{group.id}/" for group in groups if group.restart_at == "begin")
    never = [group.id for group in groups if group.restart_at == "never"]
    never += [
        each.id
        for each in plan
        if each.step.resumed == "never" and each.id in past.under_way and not each.id.startswith(again)
    ]
    if never:
        problems.append(f"{', '.join(never)} was under way, and must not be repeated; start a new run")
    if not left_on and (left := _left_on(prepared)):
        problems.append(
            f"{', '.join(left)} may still be energised. Make the bench safe first: bench make-safe --bench "
            f"{prepared.loaded.document.path}"
        )
    return problems


def _left_on(prepared: PreparedRun) -> Sequence[str]:
    """Return the instruments that a run may have left on and that nothing has made safe since."""
    connections = {str(address): role for role, address in energising_addresses(prepared.loaded.bench).items()}
    if not connections:
        return []
    left = {address for each in energised(lambda _: None) for address in each.connections.values()}
    return sorted(connections[address] for address in left & connections.keys() if not is_followed(address))
