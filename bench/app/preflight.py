"""Preflight: checks that decide whether a run may be unattended. Nothing is energised or moved."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Mapping
from datetime import datetime, timedelta
from hashlib import sha256
from pathlib import Path
from typing import Literal, NamedTuple

from bench.app.devices import open_devices
from bench.app.faults import laboratory_of
from bench.app.inputs import inputs_of
from bench.app.request import PreparedRun, folder_of_runs, past_due_on
from bench.clock import wall_utc
from bench.config.power import PowerEntry
from bench.errors import BenchError, StoreError
from bench.figures.times_and_sizes import duration, instant, megabytes
from bench.loop import run as run_loop
from bench.rig import OpenError, Rig
from bench.runner.alert import program_id
from bench.runner.found_on import Found, found_energised
from bench.runner.guard import try_guardian
from bench.runner.held import address_lock, energising_addresses, real_addresses, why_locked_out
from bench.runner.nut import Client, PowerState
from bench.runner.power import IN_WORDS
from bench.sequence.language.values import as_written
from bench.sequence.plan.plan import Nodes, Section, within
from bench.sequence.steps.talk import Prompt
from bench.store.energised import energised
from bench.store.machine_state import machine_folder, problem_to_write
from bench.store.tried import last_tried

State = Literal["ok", "look", "NO", "-"]
ALERT_TRIED_WITHIN = timedelta(hours=24)
DISK_MARGIN = 2
CLOCK_ANSWERS_S = 5.0
ALERT_AGAIN = "try it with 'bench alert --bench FILE'"


class Line(NamedTuple):
    """Result of one check: *ok*, *look* (a person should look), or *NO* (the run must not be unattended).

    "-" does not apply to this bench.
    """

    what: str
    state: State
    text: str


class Preflight(NamedTuple):
    """Results of all checks."""

    lines: tuple[Line, ...]

    @property
    def is_green(self) -> bool:
        """True if the run may be unattended."""
        return all(line.state != "NO" for line in self.lines)

    @property
    def verdict(self) -> str:
        """Verdict as text."""
        if self.is_green:
            return "READY TO BE LEFT ALONE"
        return f"NOT READY: {', '.join(line.what for line in self.lines if line.state == 'NO')}"


def rehearsal_key(prepared: PreparedRun) -> str:
    """Return the key of a rehearsal: files and parameters of a run, and the version of this program."""
    from importlib.metadata import version

    digest = sha256(version("inertial-test-bench").encode())
    for name, text in sorted(inputs_of(prepared).items()):
        digest.update(f"{name}\0{text}\0".encode())
    for name, value in sorted(prepared.plan.parameters.items()):
        digest.update(f"{name}={as_written(value)}\0".encode())
    return digest.hexdigest()


def preflight(prepared: PreparedRun) -> Preflight:
    """Perform all checks. Raises InUseError while another program uses the bench."""
    bench = prepared.loaded.bench
    if bench.is_simulated:
        simulated = Line(
            "instruments", "-", "every instrument is simulated: only the conditions of a simulated run were checked"
        )
        return Preflight((simulated, _disk(prepared), _times(prepared)))
    with address_lock(real_addresses(bench).values(), "bench preflight"):
        (instruments, found), guardian = _instruments(prepared), _guardian(prepared)
    return Preflight((
        instruments, guardian, _register(), _lockout(prepared), _left_on(prepared, found), _certificates(prepared),
        _rehearsal(prepared), _questions(prepared), alert_line(prepared), _disk(prepared), _clock(), _power(prepared),
        _protection(prepared), _times(prepared), _safe_end(prepared),
    ))  # fmt: skip


def _instruments(prepared: PreparedRun) -> tuple[Line, dict[str, Found]]:
    """Check presence and identity of each instrument; return those that are energised as well."""
    bench = prepared.loaded.bench

    async def look() -> tuple[Rig, str, dict[str, Found]]:
        rig, problem = Rig(open_devices(bench, laboratory_of(bench))), ""
        try:
            try:
                await rig.open()
            except OpenError as wrong:
                problem = str(wrong)
            return rig, problem, await found_energised(rig, energising_addresses(bench))
        finally:
            await rig.close()

    rig, problem, found = run_loop(look())
    if problem:
        return Line("instruments", "NO", "; ".join(problem.splitlines())), found
    there = ", ".join(f"{role} {who.serial}".strip() for role, who in rig.identities.items())
    return Line("instruments", "ok", there), found


def _guardian(prepared: PreparedRun) -> Line:
    with tempfile.TemporaryDirectory() as folder:
        try:
            took_s = try_guardian(prepared.loaded, Path(folder))
        except BenchError as problem:
            return Line("guardian", "NO", str(problem))
    return Line("guardian", "ok", f"ready after {took_s:.1f} s")


def _register() -> Line:
    """Check that the register of energised benches is shared with other users."""
    folder = machine_folder()
    if folder is None:
        return Line("register", "look", "of this user alone: others see neither what this run leaves on nor a lockout")
    if problem := problem_to_write():
        return Line("register", "NO", problem)
    return Line("register", "ok", f"of all users, in {folder}")


def _lockout(prepared: PreparedRun) -> Line:
    why = why_locked_out(prepared.loaded.bench)
    return Line("lockout", "NO" if why else "ok", why or "the bench is not locked out")


def _left_on(prepared: PreparedRun, found: Mapping[str, Found]) -> Line:
    """Check that no earlier run has left an instrument on, by the register and the instruments themselves."""
    loaded = prepared.loaded
    ours = {str(address): role for role, address in energising_addresses(loaded.bench).items()}
    problems: list[StoreError] = []
    left = {
        f"{ours[address]} ({each.name})"
        for each in energised(problems.append)
        for address in each.connections.values()
        if address in ours
    }
    now = [f"{role}: {what.text}" for role, what in sorted(found.items())]
    if left or problems or any(what.is_output for what in found.values()):
        text = ", ".join([*sorted(left), *map(str, problems), *now])
        return Line("left on", "NO", f"{text}: bench make-safe --bench {loaded.document.path}")
    if now:
        return Line("left on", "look", f"{', '.join(now)}: the run goes to the safe set point first")
    return Line("left on", "ok", "no run has left an instrument of this bench on, and none is")


def _certificates(prepared: PreparedRun) -> Line:
    day = _ends(prepared).date()
    due = past_due_on(day, prepared.plan, prepared.loaded.bench)
    if due:
        found = ", ".join(f"{name} ({on})" for name, on in due.items())
        return Line("certificates", "NO", f"not valid until the end of the run, {day}: {found}")
    return Line("certificates", "ok", f"valid until the end of the run, {day}")


def _rehearsal(prepared: PreparedRun) -> Line:
    at = last_tried("rehearsal", rehearsal_key(prepared))
    if at is None:
        return Line(
            "rehearsal", "NO",
            "these files with these parameters have not been rehearsed to their end: 'bench rehearse' with the same "
            "sequence, --bench, --preset, --params and --set",
        )  # fmt: skip
    return Line("rehearsal", "ok", f"completed at {_clock_of(at, prepared)}")


def _questions(prepared: PreparedRun) -> Line:
    """Check for steps that wait for a person; in the setup one is still present."""
    plan = prepared.plan
    asking = {
        plan.where(each.place): each.phase
        for each in plan
        if isinstance(each.step, Prompt) or each.step.on_failure == "ask"
    }
    groups = [plan.where(each.place) for each in _sections((*plan.setup, *plan.steps)) if each.on_failure == "ask"]
    if later := [*(where for where, phase in asking.items() if phase != "setup"), *groups]:
        return Line("questions", "NO", f"the run waits for a person at {', '.join(later)}")
    by_hand = [role for role, entry in prepared.loaded.bench.devices.items() if entry.connection.is_person]
    if used := [role for role in by_hand if role in plan.sequence.needs]:
        return Line("questions", "NO", f"a person turns {', '.join(used)}")
    if asking:
        return Line("questions", "look", f"stay until these are answered: {', '.join(asking)}")
    return Line("questions", "ok", "the run has no prompts")


def _sections(nodes: Nodes) -> Iterator[Section]:
    for node in nodes:
        if isinstance(node, Section):
            yield node
        for inner in within(node):
            yield from _sections(inner)


def alert_line(prepared: PreparedRun) -> Line:
    """Check that a person is reached: by the program of the bench file, else by a route of the station."""
    entry = prepared.loaded.bench.alert
    if entry is None:
        return _station_line(prepared)
    at = last_tried("alert", program_id(entry.exec))
    if at is None or wall_utc() - at > ALERT_TRIED_WITHIN:
        return Line("alert", "NO", f"{entry.exec[0]} was tried {_when(at, prepared)}, not within 24 h: {ALERT_AGAIN}")
    return Line("alert", "ok", f"{entry.exec[0]}, tried at {_clock_of(at, prepared)}")


def _station_line(prepared: PreparedRun) -> Line:
    """Check that one of the routes that learn of the end of the run was tried; the guardian has none of them."""
    routes = prepared.request.alert_routes
    if not routes:
        return Line("alert", "NO", "the bench file names no program that reaches a person: alert: {exec: [PROGRAM]}")
    tried = {name: last_tried("alert", key) for name, _, key in (route.partition("=") for route in routes)}
    works = [name for name, at in tried.items() if at is not None and wall_utc() - at <= ALERT_TRIED_WITHIN]
    text = ", ".join(f"route {name}, tried {_when(at, prepared)}" for name, at in tried.items())
    if not works:
        return Line("alert", "NO", f"no route of the station has worked within 24 h: {text}: test it on its page")
    return Line("alert", "ok", f"by the station, as long as it runs: {text}")


def _when(at: datetime | None, prepared: PreparedRun) -> str:
    return "never" if at is None else f"last at {_clock_of(at, prepared)}"


def _disk(prepared: PreparedRun) -> Line:
    folder = folder_of_runs(prepared.request.runs)
    free, wanted = shutil.disk_usage(folder).free, DISK_MARGIN * prepared.expected.size_bytes
    text = f"{megabytes(free)} free at {folder}, the run takes about {megabytes(prepared.expected.size_bytes)}"
    return Line("disk", "ok" if free > wanted else "NO", text)


def _clock() -> Line:
    """Check that the computer's clock is synchronised."""
    command = ["timedatectl", "show", "--property=NTPSynchronized", "--value"]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, timeout=CLOCK_ANSWERS_S, check=True).stdout  # noqa: S603  fixed words
    except (OSError, subprocess.SubprocessError):
        return Line("clock", "look", "whether this computer's clock is synchronised is not known (no timedatectl)")
    if answer.strip() == "yes":
        return Line("clock", "ok", "synchronised")
    return Line("clock", "look", "this computer's clock is not synchronised; times in the report follow it")


def _power(prepared: PreparedRun) -> Line:
    entry = prepared.loaded.bench.power
    if entry is not None:
        return _state_of_power(entry)
    return Line(
        "power", "look", "no uninterruptible supply is monitored: if the computer loses its power, the bench stays on"
    )


def _state_of_power(entry: PowerEntry) -> Line:
    async def ask() -> PowerState:
        client = Client(entry.ups)
        try:
            return await client.ask()
        finally:
            await client.close()

    state = run_loop(ask())
    if state.kind == "line":
        return Line("power", "ok", f"on line power ({state.text}), monitored at {entry.ups.name}@{entry.ups.host}")
    return Line("power", "NO", f"{IN_WORDS[state.kind]} ({state.text})")


def _protection(prepared: PreparedRun) -> Line:
    bench = prepared.loaded.bench
    alone_s = {role: bench.devices[role].safe_state.alone_after_s for role in energising_addresses(bench)}
    words = [f"{role} goes off after {after_s:g} s" for role, after_s in alone_s.items() if after_s is not None]
    if left := [role for role, after_s in alone_s.items() if after_s is None]:
        words.append(f"{', '.join(left)} stay as they are")
    return Line("protection", "look" if left else "ok", f"if this computer fails: {'; '.join(words)}")


def _times(prepared: PreparedRun) -> Line:
    begins, ends = (_clock_of(at, prepared) for at in (wall_utc(), _ends(prepared)))
    if prepared.loaded.bench.is_simulated:
        return Line("times", "ok", f"about {duration(prepared.expected.total_s)} of bench time")
    late = [remark.text for remark in prepared.warnings if remark.rule == "ends-too-late"]
    if late:
        return Line("times", "NO", late[0])
    return Line("times", "ok", f"about {duration(prepared.expected.total_s)}, from {begins} to {ends}")


def _safe_end(prepared: PreparedRun) -> Line:
    bench = prepared.loaded.bench
    states = ((role, bench.devices[role].safe_state) for role in energising_addresses(bench))
    text = ", ".join(
        f"{role} {state.words} within {state.within_s:.3g} s"
        + (f" (after a failure held for {duration(state.hold_s)} before)" if state.hold_s else "")
        for role, state in states
    )
    return Line("safe end", "ok", text)


def _ends(prepared: PreparedRun) -> datetime:
    return wall_utc() + timedelta(seconds=prepared.expected.total_s)


def _clock_of(at: datetime, prepared: PreparedRun) -> str:
    return instant(at.isoformat(timespec="seconds"), prepared.loaded.bench.site.time_zone)


def lines_of(found: Preflight) -> Iterator[str]:
    """Yield the lines of the display."""
    width = max(len(line.what) for line in found.lines)
    for line in found.lines:
        yield f"{line.what:<{width}}  {line.state:<4}  {line.text}"
    yield found.verdict
