"""Request for a run, and its checked plan and bench; everything is checked before anything opens."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterable, Iterator, Mapping
from datetime import date, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

from pydantic import TypeAdapter, ValidationError

from bench.app.released import Released, in_place, of_units, read_released
from bench.app.released import remarks as of_calibrations
from bench.config.bench import LoadedBench, load_bench
from bench.config.checks_certificates import beyond_certificates
from bench.config.document import Document
from bench.config.load import find
from bench.config.models import BenchFile
from bench.errors import InputError
from bench.figures.times_and_sizes import duration
from bench.sequence.checks.judged import not_judged
from bench.sequence.checks.remarks import Remark
from bench.sequence.estimate.estimate import Estimate, estimate
from bench.sequence.load import load_judged_plan
from bench.sequence.plan.plan import Plan
from bench.sequence.plan.unit_places import occupied
from drivers.schema.fields import Instant
from drivers.schema.wording import error_text

if TYPE_CHECKING:  # checking a sequence needs no simulators
    from bench.app.technician import Script

DEFAULT_BENCH = "simulated"
PAST_DUE = "past-due"  # rule name in a check
PastDue = Literal["refuse", "mark"]


class RunRequest(NamedTuple):
    """Request for a run from a command line; None leaves the choice to the files."""

    sequence: str
    bench: str | None = None
    simulate: bool = False
    speed: str | None = None
    preset: str | None = None
    parameters: Path | None = None
    settings: tuple[str, ...] = ()
    uut_model: Path | None = None
    seed: int | None = None
    units: tuple[str, ...] = ()
    operator: str = ""
    order: str = ""
    procedure: str = ""
    runs: Path = Path("runs")
    unattended: bool = False
    answers: Path | None = None
    not_after: str | None = None
    past_due: PastDue = "refuse"
    calibrations: tuple[str, ...] = ()
    trace: Path | None = None
    scenario: Path | None = None
    fault_seed: int | None = None
    no_report: bool = False
    ticket: str = ""
    inputs: str = ""
    alert_routes: tuple[str, ...] = ()


class CheckedRun(NamedTuple):
    """Checked plan with its bench, its expected duration there, and warnings.

    `bench` has only the places with a unit in the run. `serials` are those of the named units, and `released` the
    calibrations, both by place.
    """

    plan: Plan
    loaded: LoadedBench
    bench: BenchFile
    serials: Mapping[str, str]
    expected: Estimate
    warnings: tuple[Remark, ...]
    released: Mapping[str, Released] = {}


class PreparedRun(NamedTuple):
    """Prepared run: consistent files, expected duration, speed, and units by place.

    The faults of a scenario are among those of the bench. `preflight` are the lines of the preflight of an unattended
    run.
    """

    request: RunRequest
    plan: Plan
    loaded: LoadedBench
    expected: Estimate
    speed: float
    serials: Mapping[str, str]
    seed: int
    warnings: tuple[Remark, ...] = ()
    script: Script | None = None
    released: Mapping[str, Released] = {}
    scenario: Document | None = None
    preflight: tuple[Mapping[str, str], ...] = ()


def load_bench_named(name: str | None, *, simulate: bool = False) -> LoadedBench:
    """Load the bench file of a name or path, on request with every wire simulated."""
    loaded = load_bench(find(name or DEFAULT_BENCH, "config"))
    return loaded._replace(bench=loaded.bench.all_simulated()) if simulate else loaded


def load_checked(request: RunRequest, loaded: LoadedBench | None = None) -> CheckedRun:
    """Load and check plan and bench of a request. Raises InputError with the problems of both files.

    `loaded` is its bench if that has been loaded before.
    """
    found: list[str] = []
    judged: tuple[Plan, tuple[Remark, ...]] | None = None
    serials: dict[str, str] = {}
    try:
        loaded = loaded or load_bench_named(request.bench, simulate=request.simulate)
        serials = _named_units(request.units, loaded.bench)
    except InputError as error:
        found += error.problems
    try:
        judged = load_judged_plan(
            find(request.sequence, "sequences"), loaded.bench if loaded else None, preset=request.preset,
            parameters=request.parameters, settings=request.settings, places=serials,
        )  # fmt: skip
    except InputError as error:
        found += error.problems
    if judged is None or loaded is None or found:
        raise InputError(*found)
    plan, warnings = judged
    bench = occupied(loaded.bench, plan.sequence, serials)
    released = read_released(request.calibrations, plan, bench)
    expected = estimate(plan, bench)
    circumstances = (
        *_past_due(plan, bench, loaded),
        *_beyond_certificates(bench, loaded),
        *_little_disk_space(expected, request.runs),
        *_ends_too_late(expected, loaded, request.not_after),
        *of_calibrations(released, plan, bench),
        *not_judged(plan),
    )
    return CheckedRun(plan, loaded, bench, serials, expected, (*circumstances, *warnings), released)


def _past_due(plan: Plan, bench: BenchFile, loaded: LoadedBench) -> Iterator[Remark]:
    """Yield a warning, at its line, for each expired certificate of an instrument that the run uses."""
    for name, due in past_due_on(_begins(loaded).date(), plan, bench).items():
        part = "devices" if name in bench.devices else "readings"
        yield Remark(
            "warning",
            PAST_DUE,
            (part, name, "calibration", "due"),
            f"the calibration of '{name}' was due on {due}; the run is refused",
            "Enter its new certificate in the bench file, or run with --past-due mark: the report then marks "
            "every result",
            loaded.document,
        )


def _beyond_certificates(bench: BenchFile, loaded: LoadedBench) -> Iterator[Remark]:
    """Yield a warning for each instrument that may be used beyond the range of its certificate."""
    advice = "Narrow the limits, or let it be calibrated there"
    for place, problem in beyond_certificates(bench):
        yield Remark("warning", "beyond-certificate", place, problem, advice, loaded.document)


def past_due_on(day: date, plan: Plan, bench: BenchFile) -> dict[str, date]:
    """Return the instruments used by the run whose certificates have expired on a day, with their due dates."""
    used = {*plan.sequence.needs, *(place.temperature for place in bench.places.values())}
    for place in bench.places.values():
        used |= {meter for meter in (place.voltmeter, place.ammeter) if meter is not None}
    if any(place.is_counted for place in bench.places.values()):
        used |= set(bench.with_capability("pulse_counter"))
    return {name: due for name, due in bench.past_due(day).items() if name in used}


def _begins(loaded: LoadedBench) -> datetime:
    """Return the start of a run requested now, in bench time."""
    if loaded.bench.is_simulated:
        return loaded.bench.simulation.start
    from bench.clock import wall_utc  # imports asyncio, which other checks do not need

    return wall_utc()


def folder_of_runs(runs: Path) -> Path:
    """Return the folder of run directories, or its nearest existing parent."""
    return next(folder for folder in (runs.absolute(), *runs.absolute().parents) if folder.is_dir())


def _little_disk_space(expected: Estimate, runs: Path) -> Iterator[Remark]:
    """Yield a warning if the run will not fit on the disk of the run directories."""
    folder = folder_of_runs(runs)
    free_bytes, size_bytes = shutil.disk_usage(folder).free, expected.size_bytes
    if size_bytes > free_bytes:
        yield Remark(
            "warning",
            "little-disk-space",
            (),
            f"the run writes about {size_bytes / 1e6:.0f} MB, and {folder} has {free_bytes / 1e6:.0f} MB left",
            "Free some space, or choose another disk with --runs",
        )


def _ends_too_late(expected: Estimate, loaded: LoadedBench, not_after: str | None) -> Iterator[Remark]:
    """Yield a warning if a run that starts now ends after `not_after`. Raises InputError."""
    if not_after is None:
        return
    try:
        latest = TypeAdapter(Instant).validate_python(not_after)
    except ValidationError as error:
        raise InputError(f"--not-after {not_after}: {error_text(error.errors()[0])}") from None
    begins = _begins(loaded)
    ends = begins + timedelta(seconds=expected.total_s)
    if ends > latest:
        yield Remark(
            "warning",
            "ends-too-late",
            (),
            f"a run that begins at {begins:%Y-%m-%d %H:%M} UTC ends at about {ends:%Y-%m-%d %H:%M} UTC, "
            f"{duration((ends - latest).total_seconds())} after {latest:%Y-%m-%d %H:%M} UTC",
            "Start earlier, or choose a shorter preset or shorter parameters",
        )


def prepare(request: RunRequest) -> PreparedRun:
    """Read and check everything. Raises InputError."""
    from bench.app.scenario import with_scenario  # imports the simulators

    checked = load_checked(request)
    plan, loaded = checked.plan, checked.loaded
    speed = _speed(request, loaded)
    if request.past_due == "refuse" and (found := [each for each in checked.warnings if each.rule == PAST_DUE]):
        raise InputError(*(f"{loaded.document.where(remark.place)}: {remark.text}" for remark in found))
    for option, text in (
        ("--order", request.order), ("--procedure", request.procedure), ("--ticket", request.ticket),
    ):  # fmt: skip
        if not text.isprintable() or len(text) > 200:
            raise InputError(f"{option}: expected up to 200 printable characters")
    loaded, scenario = with_scenario(loaded, request.scenario, plan)
    seed = loaded.bench.simulation.seed if request.seed is None else request.seed
    serials, script = _serials(checked), _script(request, plan, loaded, speed)
    of_units(checked.released, plan, serials)
    return PreparedRun(
        request, plan, loaded, checked.expected, speed, serials, seed, checked.warnings, script, checked.released,
        scenario,
    )  # fmt: skip


def _script(request: RunRequest, plan: Plan, loaded: LoadedBench, speed: float) -> Script | None:
    """Return the scripted answers, or None for people. Raises InputError if nobody could answer."""
    from bench.app.technician import read_script, unanswered

    if request.answers is not None and not loaded.bench.is_simulated:
        raise InputError(
            f"--answers {request.answers}: scripted answers are for simulated benches; this bench has real connections"
        )
    script = read_script(request.answers, plan, loaded.bench)
    if speed == math.inf and (missing := unanswered(plan, script)):
        raise InputError(
            f"{plan.document.path}: at full speed nobody can answer {', '.join(missing)}. "
            "Give the answers with --answers FILE, or run with --speed 60 and answer with 'bench answer'."
        )
    return script if request.answers is not None else None


def _speed(request: RunRequest, loaded: LoadedBench) -> float:
    """Return bench seconds per second: as fast as possible on a simulated bench, else real time."""
    from bench.loop import AS_FAST_AS_POSSIBLE, REAL_TIME  # imports asyncio, which checking a sequence does not need

    simulated = loaded.bench.is_simulated
    if request.speed is None:
        return AS_FAST_AS_POSSIBLE if simulated else REAL_TIME
    try:
        speed = AS_FAST_AS_POSSIBLE if request.speed == "max" else float(request.speed)
    except ValueError:
        speed = math.nan
    if not speed > 0:
        raise InputError(f"--speed {request.speed}: expected max, or a number above 0 such as 60")
    if speed != REAL_TIME and not simulated:
        raise InputError(f"--speed {request.speed}: this bench has real connections, which run at speed 1 only")
    return speed


def _named_units(units: Iterable[str], bench: BenchFile) -> dict[str, str]:
    """Return the named units by place: `--uut PLACE=SERIAL`, or `--uut SERIAL` with a single place."""
    serials: dict[str, str] = {}
    for given in units:
        place, serial = in_place("--uut", given, "SERIAL", bench)
        if not serial.strip() or not serial.isprintable() or len(serial) > 64:
            raise InputError(f"--uut {given}: expected a serial number of up to 64 printable characters")
        if place in serials:
            raise InputError(f"--uut {given}: place '{place}' has '{serials[place]}' already; a place has one unit")
        serials[place] = serial.strip()
    return {place: serials[place] for place in bench.places if place in serials}


def _serials(checked: CheckedRun) -> Mapping[str, str]:
    """Return the serial number of each unit in the run; on a simulated bench with defaults."""
    if not checked.serials and not checked.bench.is_simulated:
        raise InputError("a run with real connections needs the serial numbers of its units: --uut PLACE=SERIAL")
    return checked.serials or {place: f"SIM-{place.upper()}" for place in checked.bench.places}
