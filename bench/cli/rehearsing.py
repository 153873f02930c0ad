"""rehearse: run sequences on simulators of a bench, and compare them with their plans."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from bench.cli.checking import BENCHES, FILES
from bench.cli.collection import uncollected
from bench.cli.commands import Command, flag, option, whole_number
from bench.cli.exits import ABORTED, BENCH_ERROR, INPUT_ERROR, NOT_SAFE, of_run
from bench.cli.running import ANSWERS, NEW_RUNS, SCENARIO, SEED, UUT_MODEL, WISHES, warn
from bench.cli.streams import say
from bench.errors import BenchError, InputError
from drivers.errors import DriverError

if TYPE_CHECKING:  # keeps imports out of `bench --help`
    from bench.app.files_to_check import FileToCheck
    from bench.app.rehearse import Compared, Rehearsal
    from bench.app.request import RunRequest
    from bench.cli.rehearsals import Outcome

ENDED = {
    "completed": "completed",
    "failed": "was stopped by a value outside its limits",
    "error": "ended with an error",
    "aborted": "was aborted",
}
STEPS_SHOWN = 8


def rehearse(
    *,
    files: Sequence[str],
    benches: Sequence[str],
    faults: int | None,
    jobs: int,
    form: str,
    as_json: bool,
    **wishes: Any,
) -> int:
    """Run sequences on simulators of a bench's instruments, with all limits in force, and compare each with its plan.

    In folders, all sequences are rehearsed that no other one there calls. The exit code is that of the run; of several
    rehearsals that of the worst, in the order 6, 3, 4, 2, 1, 7, 5, 0.
    """
    from bench.app.files_to_check import SEQUENCE, find_files
    from bench.app.request import RunRequest

    form = "json" if as_json else form
    given, _ = find_files(files, (SEQUENCE,))
    names: Sequence[str | None] = benches or (None,)
    if len(given) > 1 or len(names) > 1 or form == "junit":
        return _several(given, names, jobs, form, {"faults": faults, **wishes})
    request = RunRequest(str(given[0].path), names[0], operator="rehearsal", past_due="mark", **wishes)
    return _in_text(request, faults) if form == "text" else _in_json(request, faults)


def _several(
    files: Sequence[FileToCheck], benches: Sequence[str | None], jobs: int, form: str, wishes: dict[str, Any]
) -> int:
    from bench.app.check_files import check_files
    from bench.app.request import RunRequest
    from bench.cli.rehearsals import Children, as_words, show
    from bench.runner.signals import Dropped, Signals

    request = RunRequest("", **{name: value for name, value in wishes.items() if name in RunRequest._fields})
    checks = check_files([file for file in files if not file.is_called], request, benches, {})
    children = Children(tuple(as_words(OF_A_REHEARSAL, wishes)))
    try:
        with Signals() as signals, signals.dropping(0):
            return show(children.outcomes(checks, jobs), form)
    except Dropped:
        return ABORTED


def _in_json(request: RunRequest, faults: int | None) -> int:
    from bench.cli.rehearsals import Outcome, show

    bench = request.bench or ""
    try:
        rehearsal, bench = _rehearsed(request, faults)
    except InputError as problem:
        return show([Outcome(request.sequence, bench, INPUT_ERROR, problems=problem.problems)], "json")
    except (BenchError, DriverError) as problem:
        return show([Outcome(request.sequence, bench, BENCH_ERROR, problems=[str(problem)])], "json")
    return show([_outcome(rehearsal, request.sequence, bench)], "json")


def _outcome(rehearsal: Rehearsal, file: str, bench: str) -> Outcome:
    from bench.cli.rehearsals import Outcome

    result = rehearsal.result
    return Outcome(
        file=file,
        bench=bench,
        exit_code=_exit_code(rehearsal),
        verdict=result.results.verdict if result.results else None,
        ended=result.outcome.how,
        planned_s=round(rehearsal.expected.total_s, 3),
        bench_s=round(result.bench_s, 3),
        wall_s=round(result.wall_s, 3),
        problems=result.problems,
        unsafe=sorted(rehearsal.unsafe),
        lost=rehearsal.lost,
        run=str(result.path),
        report=str(result.report) if result.report else None,
    )


def _in_text(request: RunRequest, faults: int | None) -> int:
    rehearsal, _ = _rehearsed(request, faults, shown=True)
    return _exit_code(rehearsal)


def _rehearsed(request: RunRequest, faults: int | None, *, shown: bool = False) -> tuple[Rehearsal, str]:
    """Rehearse, on request with the result as text on stdout; return the rehearsal and the bench file."""
    from bench.app.preflight import rehearsal_key
    from bench.app.rehearse import rehearse as rehearsed
    from bench.app.request import load_checked, prepare
    from bench.runner.output import tolerant_output
    from bench.runner.progress import TerminalProgress
    from bench.runner.signals import Signals
    from bench.store.tried import note_tried

    with tolerant_output():
        with uncollected():
            checked = load_checked(request)
            warn(checked.plan, checked.warnings)
            units = tuple(f"{place}={released.content.uut}" for place, released in checked.released.items())
            prepared = prepare(request._replace(simulate=True, not_after=None, units=units))
        with Signals() as signals:
            with TerminalProgress(prepared.plan, prepared.loaded.bench, prepared.speed) as progress:
                rehearsal = rehearsed(prepared, progress, faults, signals)
            with signals.not_waiting():
                say(*(_summary(rehearsal) if shown else ()))
        if rehearsal.result.outcome.how == "completed" and not rehearsal.unsafe and not rehearsal.lost:
            note_tried("rehearsal", rehearsal_key(prepared))
    return rehearsal, str(prepared.loaded.document.path)


def _exit_code(rehearsal: Rehearsal) -> int:
    """Return the exit code of the run; an error if acknowledged data are lost, or no device was made safe."""
    if rehearsal.unsafe:
        return NOT_SAFE
    return BENCH_ERROR if rehearsal.lost else of_run(rehearsal.result)


def _summary(rehearsal: Rehearsal) -> Iterator[str]:
    from bench.figures.times_and_sizes import megabytes

    result, expected = rehearsal.result, rehearsal.expected
    yield f"{'planned':>12} {'took':>12} {'ratio':>6}"
    for phase in rehearsal.phases:
        yield _row(phase)
    yield _compared(_time(expected.total_s), _time(result.bench_s), result.bench_s / max(expected.total_s, 1.0), "all")
    stored = megabytes(rehearsal.stored_bytes)
    yield _compared(
        megabytes(expected.size_bytes), stored, rehearsal.stored_bytes / expected.size_bytes, "size of run.db"
    )
    yield ""
    yield "Steps whose duration differs most from the plan:"
    for step in rehearsal.largest_deviations(STEPS_SHOWN):
        yield _row(step)
    yield ""
    yield from _faults(rehearsal)
    yield f"The run {ENDED[result.outcome.how]} after {_time(result.bench_s)}"
    yield f"Made safe: {_made_safe(rehearsal)}"
    yield f"On the disk: {'; '.join(rehearsal.lost) or 'all that was acknowledged'}"
    yield f"Verdict on the simulated units: {result.results.verdict if result.results else 'none'}"
    yield from (f"Problem: {problem}" for problem in result.problems)
    yield f"run    {result.path}"
    if result.report is not None:
        yield f"report {result.report}"


def _faults(rehearsal: Rehearsal) -> Iterator[str]:
    from bench.report.plan_view.timeline import clock

    for fault, began_s in zip(rehearsal.faults, rehearsal.began_s, strict=True):
        what = f"{fault.victim} {fault.kind}"
        if began_s is not None:
            yield f"Injected {clock(began_s)}: {what}"
        elif fault.after is None:
            yield f"Not injected: planned at {clock(fault.at)}: {what}"
        else:
            yield f"Not injected: planned after {fault.after}: {what}"


def _made_safe(rehearsal: Rehearsal) -> str:
    if not rehearsal.unsafe:
        return "every device"
    broken = ", ".join(sorted(set(rehearsal.unsafe) - set(rehearsal.unsafe_without_fault)))
    wrong = ", ".join(sorted(rehearsal.unsafe_without_fault))
    broken_text = [f"every device but {broken}, in which a fault was injected"] if broken else []
    return "; ".join([*broken_text, *([f"NOT {wrong}, in which no fault was injected"] if wrong else [])])


def _row(compared: Compared) -> str:
    return _compared(_time(compared.planned_s), _time(compared.took_s), compared.ratio, compared.name)


def _compared(planned: str, took: str, ratio: float | None, name: str) -> str:
    shown = f"{ratio:.2f}" if ratio is not None else "-"
    return f"{planned:>12} {took:>12} {shown:>6}  {name}"


def _time(seconds: float) -> str:
    from bench.figures.times_and_sizes import duration

    return f"{seconds:.1f} s" if seconds < 600 else duration(seconds)


OF_A_REHEARSAL = (
    *WISHES,
    ANSWERS,
    UUT_MODEL,
    SEED,
    option("--faults SEED", "Break one to three instruments, drawn by this seed.", read=int),
    SCENARIO,
    NEW_RUNS,
)
COMMANDS = (
    Command("rehearse", rehearse, (
        FILES,
        BENCHES,
        *OF_A_REHEARSAL,
        option("--jobs N", "Rehearsals at a time, if there are several.", read=whole_number(1), default=1),
        option(
            "--format text|json|junit", "json, junit: only that format on stdout.",
            to="form", choices=("text", "json", "junit"), default="text",
        ),
        flag("--json", "The same as --format json.", to="as_json"),
    )),
)  # fmt: skip
