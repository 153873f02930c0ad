"""plan, run: commands for a sequence."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.cli.collection import uncollected
from bench.cli.commands import Command, argument, flag, option, options
from bench.cli.exits import BENCH_ERROR, INPUT_ERROR, NOT_SAFE, PASS, of_run
from bench.cli.interrupts import raise_again
from bench.cli.streams import remark, say, say_json
from bench.errors import InputError

if TYPE_CHECKING:  # keeps imports out of `bench --help`
    from bench.app.execute import RunResult
    from bench.app.request import PreparedRun
    from bench.app.resume import Resumption
    from bench.sequence.checks.remarks import Remark
    from bench.sequence.plan.plan import Plan

BENCH = option(
    "--bench FILE", "The bench file; default: $BENCH_FILE, or the shipped simulated bench.", variable="BENCH_FILE"
)
WISHES = (
    option("--preset PRESET", "A preset of the sequence."),
    option("--params FILE", "A YAML file of parameters, one NAME: VALUE on each line.", read=Path, to="parameters"),
    options("--set NAME=VALUE", "A parameter of the sequence; repeatable.", to="settings"),
    option("--not-after INSTANT", "Warn if the run would end later than this, such as 2026-01-31T07:00Z."),
    options(
        "--calibration [PLACE=]FILE",
        "The released calibration to check the unit in a place against; one for each place.",
        to="calibrations",
    ),
)
OF_A_PLAN = (argument("SEQUENCE", "A sequence file, or the name of a shipped one such as smoke."), BENCH, *WISHES)
SCENARIO = option("--scenario FILE", "Faults of the simulated instruments, and when they happen.", read=Path)
SIMULATE = flag("--simulate", "Replace every instrument by its simulator.")
UUT_MODEL = option("--uut-model FILE", "Truth of the simulated unit.", read=Path)
SEED = option("--seed SEED", "Seed of the simulation.", read=int)
ANSWERS = option("--answers FILE", "Scripted answers to prompts, on a simulated bench.", read=Path)
UUTS = options("--uut [PLACE=]SERIAL", "Serial number of the unit under test; one for each place.", to="units")
NEW_RUNS = option("--runs DIR", "Directory in which run directories are created.", read=Path, default=Path("runs"))
ONLY_RESULTS = flag("--json", "Print only the results, as JSON, on stdout.", to="as_json")


def warn(plan: Plan, warnings: Iterable[Remark]) -> None:
    """Write warnings before a run to stderr, one per line."""
    from bench.sequence.checks.output import warning_line

    remark(*(warning_line(warning, plan.document) for warning in warnings))


def plan(*, picture: Path | None, as_json: bool, **wishes: Any) -> None:
    """List the steps of a sequence with start times, durations and the state of the bench; nothing is opened."""
    from bench.app.request import RunRequest, load_checked
    from bench.figures.times_and_sizes import duration, megabytes
    from bench.report.plan_view.timeline import plan_table, safe_states, timeline_json, turned_by_hand

    with uncollected():
        checked = load_checked(RunRequest(**wishes))
    warn(checked.plan, checked.warnings)
    expected = checked.expected
    if picture is not None:
        from bench.report.plan_view.picture import write_picture  # imports matplotlib

        write_picture(picture, checked.plan, expected, checked.bench)
    if as_json:
        say_json(timeline_json(expected, checked.bench))
        return
    say(*plan_table(checked.plan, expected, checked.bench))
    turned = turned_by_hand(expected, checked.bench)
    say(*(f"{role}: turned by hand {times} times" for role, times in turned.items()))
    if states := list(safe_states(checked.bench)):
        say("\nMade safe at the end, or if the run fails:", *(f"  {state}" for state in states))
    say(f"\n{len(checked.plan)} steps, about {duration(expected.total_s)}, about {megabytes(expected.size_bytes)}")


def run(*, as_json: bool, **wishes: Any) -> int:
    """Run a sequence on a bench."""
    from bench.runner.output import tolerant_output

    with tolerant_output():
        if wishes["bench"] is None:
            remark("No --bench given: running on the shipped simulated bench.")
        with uncollected():
            prepared = _prepared(wishes)
        warn(prepared.plan, prepared.warnings)
        if prepared.request.unattended:
            from bench.app.preflight import lines_of, preflight

            raise_again()

            found = preflight(prepared)
            remark(*lines_of(found))
            if not found.is_green:
                return INPUT_ERROR
            prepared = prepared._replace(preflight=tuple(line._asdict() for line in found.lines))
        return _executed(prepared, None, as_json=as_json)


def _prepared(wishes: Mapping[str, Any]) -> PreparedRun:
    from bench.app.inputs import expect_inputs
    from bench.app.request import RunRequest, prepare

    prepared = prepare(RunRequest(**wishes))
    expect_inputs(prepared)
    return prepared


def preflight(*, as_json: bool, **wishes: Any) -> int:
    """Check all conditions for an unattended run; nothing is energised or moved."""
    from bench.app.preflight import lines_of
    from bench.app.preflight import preflight as looked_at
    from bench.app.request import RunRequest, prepare

    found = looked_at(prepare(RunRequest(past_due="mark", **wishes)))
    if as_json:
        say_json({"is_green": found.is_green, "lines": [line._asdict() for line in found.lines]})
    else:
        say(*lines_of(found))
    return PASS if found.is_green else INPUT_ERROR


def alert(bench: str | None) -> int:
    """Test the alert of a bench: run its program as at the end of a run."""
    from bench.app.request import load_bench_named
    from bench.runner.alert import alert as alerted
    from bench.runner.alert import program_id
    from bench.store.tried import note_tried

    loaded = load_bench_named(bench)
    entry = loaded.bench.alert
    if entry is None:
        raise InputError(f"{loaded.document.path}: names no program that reaches a person: alert: {{exec: [PROGRAM]}}")
    title = f"{loaded.bench.title}: test of the alert"
    if problem := alerted(entry.exec, title, f"{title}\n"):
        remark(problem)
        return BENCH_ERROR
    note_tried("alert", program_id(entry.exec))
    say(f"{entry.exec[0]} has taken the alert; check that it has arrived")
    return PASS


def resume_interrupted(path: Path, *, confirmed: bool) -> int:
    """Continue an interrupted run, after confirmation by a person or an option."""
    from bench.app.resume import prepare_again, read_interrupted, summary_lines
    from bench.runner.output import tolerant_output

    resumption = read_interrupted(path)
    prepared = prepare_again(resumption)
    with tolerant_output():
        remark(*summary_lines(resumption, prepared))
        if not confirmed and not _is_confirmed():
            raise InputError(f"{path.name}: not resumed; confirm it with --interrupted, or answer yes on a terminal")
        return _executed(prepared, resumption, as_json=False)


def resume_pending(runs: Path) -> int:
    """Continue the runs that a failure of this computer interrupted; return the highest exit code."""
    from bench.app.make_safe import make_safe
    from bench.app.pending import pending
    from bench.runner.output import tolerant_output

    code = PASS
    with tolerant_output():
        for each in list(pending(runs)):
            if each.found is None:
                remark(f"{each.path.name}: not resumed: {each.why_not}")
                continue
            resumption, prepared = each.found
            bench = str(prepared.loaded.document.path)
            lanes = list(make_safe(bench, remark, lambda _lane: None, if_left_on=True))
            if left := [lane.role for lane in lanes if lane.state != "safe"]:
                remark(f"{each.path.name}: not resumed: {', '.join(left)} could not be made safe")
                code = max(code, NOT_SAFE)
                continue
            remark(f"{each.path.name}: resumed after the start of this computer")
            code = max(code, _executed(prepared, resumption, as_json=False))
    return code


def _is_confirmed() -> bool:
    if not sys.stdin.isatty():
        return False
    sys.stderr.write("Resume it? yes/no: ")
    sys.stderr.flush()
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def _executed(prepared: PreparedRun, resumption: Resumption | None, *, as_json: bool) -> int:
    with uncollected():
        from bench.app.execute import execute
        from bench.app.service import Service
        from bench.runner.notify import notify
        from bench.runner.progress import TerminalProgress
        from bench.runner.signals import Signals

    with Signals() as signals:
        with TerminalProgress(prepared.plan, prepared.loaded.bench, prepared.speed) as progress:
            result = execute(prepared, Service(progress), signals, resumption)
        notify("STOPPING=1", f"STATUS={result.outcome.how}")
        with signals.not_waiting():
            _show(result, progress.notices, as_json=as_json)
    return of_run(result)


def _show(result: RunResult, shown: Collection[str], *, as_json: bool) -> None:
    """Write the results, and the problems that are not in `shown`."""
    from bench.report.terminal import results_text

    if as_json:
        say_json({"run": str(result.path), "results": result.results.to_json() if result.results else None})
    else:
        sys.stdout.write(results_text(result.results))
    remark(
        *(f"\n{problem}" for problem in result.problems if problem not in shown),
        f"\n{result.bench_s:.0f} s of bench time in {result.wall_s:.1f} s, {result.bench_s / result.wall_s:.0f} times "
        f"real time\nrun    {result.path}",
        *([] if result.report is None else [f"report {result.report}"]),
    )


COMMANDS = (
    Command("plan", plan, (
        *OF_A_PLAN,
        option("--picture FILE", "Draw the plan against time, as FILE.svg or FILE.html.", read=Path),
        flag("--json", "Print only JSON on stdout.", to="as_json"),
    )),
    Command("run", run, (
        *OF_A_PLAN,
        SIMULATE,
        option("--speed max|N", "Bench seconds per real second; default: max on a simulated bench, else 1."),
        UUT_MODEL,
        SEED,
        UUTS,
        option("--operator NAME", "Who runs it; default: $USER.", variable="USER", default=""),
        option("--order TEXT", "The order that the run is for; shown in the report.", default=""),
        option("--procedure TEXT", "The test procedure and its revision; shown in the report.", default=""),
        option("--ticket TEXT", "Identification of the request for this run; kept in its manifest.", default=""),
        option("--inputs DIGEST", "Refuse to run if the digest of the input files is another one.", default=""),
        options("--alert-route NAME=KEY", "A route of alerts of the station that starts the run.", to="alert_routes"),
        NEW_RUNS,
        flag("--unattended", "Nobody stays with the bench: run only if every line of the preflight is good."),
        ANSWERS,
        option(
            "--past-due refuse|mark", "If a calibration is past due: refuse to run, or run and mark the results.",
            choices=("refuse", "mark"), default="refuse",
        ),
        option("--trace FILE", "Record every byte on the connections of the bench in a new file.", read=Path),
        SCENARIO,
        flag("--no-report", "Write no report; `bench report` writes it later."),
        ONLY_RESULTS,
    )),
    Command("preflight", preflight, (
        *OF_A_PLAN,
        UUTS,
        NEW_RUNS,
        flag("--json", "Print only JSON on stdout.", to="as_json"),
    )),
    Command("alert", alert, (BENCH,)),
)  # fmt: skip
