"""rehearse: run a sequence on simulators of a bench, and compare it with its plan."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from bench.cli.commands import Command, option
from bench.cli.exits import BENCH_ERROR, NOT_SAFE, of_run
from bench.cli.running import ANSWERS, NEW_RUNS, OF_A_PLAN, SCENARIO, SEED, UUT_MODEL, warn

if TYPE_CHECKING:  # keeps imports out of `bench --help`
    from bench.app.rehearse import Compared, Rehearsal

ENDED = {
    "completed": "completed",
    "failed": "was stopped by a value outside its limits",
    "error": "ended with an error",
    "aborted": "was aborted",
}
STEPS_SHOWN = 8


def rehearse(*, faults: int | None, **wishes: Any) -> int:
    """Run a sequence on simulators of a bench's instruments, with all limits in force, and compare it with its plan.

    The exit code is that of the run.
    """
    from bench.app.preflight import rehearsal_key
    from bench.app.rehearse import rehearse as rehearsed
    from bench.app.request import RunRequest, load_checked, prepare
    from bench.runner.output import tolerant_output
    from bench.runner.progress import TerminalProgress
    from bench.runner.signals import Signals
    from bench.store.tried import note_tried

    as_it_is = RunRequest(operator="rehearsal", past_due="mark", **wishes)
    with tolerant_output():
        checked = load_checked(as_it_is)
        warn(checked.plan, checked.warnings)
        units = tuple(f"{place}={released.content.uut}" for place, released in checked.released.items())
        prepared = prepare(as_it_is._replace(simulate=True, not_after=None, units=units))
        with Signals() as signals:
            with TerminalProgress(prepared.plan, prepared.loaded.bench, prepared.speed) as progress:
                rehearsal = rehearsed(prepared, progress, faults, signals)
            with signals.not_waiting():
                for line in _summary(rehearsal):
                    sys.stdout.write(line + "\n")
        if rehearsal.result.outcome.how == "completed" and not rehearsal.unsafe and not rehearsal.lost:
            note_tried("rehearsal", rehearsal_key(prepared))
    return _exit_code(rehearsal)


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


COMMANDS = (
    Command("rehearse", rehearse, (
        *OF_A_PLAN,
        ANSWERS,
        UUT_MODEL,
        SEED,
        option("--faults SEED", "Break one to three instruments, drawn by this seed.", read=int),
        SCENARIO,
        NEW_RUNS,
    )),
)  # fmt: skip
