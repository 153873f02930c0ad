"""check: sequences, bench files and other files, for people, editors and CI servers."""

from __future__ import annotations

import gc
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.cli.collection import uncollected
from bench.cli.commands import Command, arguments, flag, option, options
from bench.cli.exits import INPUT_ERROR, PASS
from bench.cli.running import WISHES
from bench.cli.streams import remark, say

if TYPE_CHECKING:  # keeps imports out of `bench --help`
    from bench.app.check_files import FileCheck

FILES = arguments("FILE", "Files, folders, and names of shipped sequences such as smoke.", to="files", least=1)
BENCHES = options(
    "--bench FILE",
    "The bench file; default: $BENCH_FILE, or the shipped simulated bench. Repeatable: each sequence is then for the "
    "benches that meet its needs.",
    to="benches", variable="BENCH_FILE",
)  # fmt: skip
FORMATS = ("text", "json", "sarif", "github", "junit")
WITHOUT_COLLECTION = 50  # files, after which garbage is collected as usual


@uncollected()
def check(*, files: Sequence[str], benches: Sequence[str], strict: bool, form: str, **wishes: Any) -> int:
    """Check sequences against a bench, and other files; nothing is opened.

    In folders, all files are checked whose `schema:` names a sequence, a bench, a station, a scenario, answers, a
    profile, a simulated unit, a calibration or a laboratory.
    """
    from bench.app.check_files import CHECKS, check_files
    from bench.app.files_to_check import SEQUENCE, find_files
    from bench.app.request import RunRequest

    others = {**CHECKS, "station": _check_station}
    given, ignored = find_files(files, (SEQUENCE, *others))
    if len(given) > WITHOUT_COLLECTION:
        gc.enable()
    checks = check_files(given, RunRequest("", **wishes), benches or (None,), others)
    if form == "junit":
        checks = _timed(checks)
    if strict:
        checks = map(_strictly, checks)
    if form == "text":
        return _as_text(checks, ignored)
    done = list(checks)
    if text := _formatted(done, ignored, form):
        say(text)
    return INPUT_ERROR if any(each.errors for each in done) else PASS


def _check_station(path: Path) -> None:
    from bench.station.settings import read_station

    read_station(path, path.parent)


def _strictly(check: FileCheck) -> FileCheck:
    return check._replace(found=tuple(shown._replace(severity="error") for shown in check.found))


def _timed(checks: Iterator[FileCheck]) -> Iterator[FileCheck]:
    from bench.clock import Stopwatch  # imports asyncio, which other checks do not need

    watch = Stopwatch()
    for check in checks:
        yield check._replace(wall_s=watch.elapsed_s())
        watch = Stopwatch()


def _as_text(checks: Iterator[FileCheck], ignored: int) -> int:
    """Write problems on stderr and the files without errors on stdout, as they are checked; return the exit code."""
    shown: set[str] = set()
    count = wrong = 0
    for each in checks:
        count, wrong = count + 1, wrong + bool(each.errors)
        for line in (found.in_words for found in each.found):
            if line not in shown:
                remark(line)
                shown.add(line)
        if not each.errors:
            say(_outcome(each))
    if count > 1 or ignored:
        others = f"; {_counted(ignored, 'other file')} ignored" if ignored else ""
        say(f"{_counted(count, 'check')}, {wrong or 'none'} with errors{others}")
    return INPUT_ERROR if wrong else PASS


def _outcome(check: FileCheck) -> str:
    outcome = _counted(len(check.found), "warning") if check.found else "no problem"
    if not check.bench:
        return f"{check.path}: {check.kind}, {outcome}"
    return f"{check.path}: {_counted(check.steps, 'step')}, {outcome} on {check.bench}"


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _formatted(checks: Sequence[FileCheck], ignored: int, form: str) -> str:
    from bench.app.check_files import unique
    from bench.sequence.checks.output import RENDERERS

    if form == "junit":
        from bench.cli.junit import junit

        return junit("bench check", _cases(checks))
    found = unique(checks)
    if form == "json":
        content = {"found": [shown._asdict() for shown in found], "checks": list(map(_as_json, checks))}
        return json.dumps({**content, "ignored": ignored}, ensure_ascii=False)
    return RENDERERS[form](found)


def _as_json(check: FileCheck) -> dict[str, Any]:
    errors = len(check.errors)
    return {
        "file": str(check.path), "kind": check.kind, "bench": check.bench or None, "errors": errors,
        "warnings": len(check.found) - errors,
    }  # fmt: skip


def _cases(checks: Sequence[FileCheck]) -> list[Any]:
    """Return a test case for each file, and for each bench of a sequence if there are several."""
    from bench.cli.junit import Case, Problem

    several = len({check.bench for check in checks if check.bench}) > 1
    cases = []
    for check in checks:
        name = f"{check.path} on {check.bench}" if several and check.bench else str(check.path)
        errors = [shown.in_words for shown in check.errors]
        warnings = [shown.in_words for shown in check.found if shown.severity == "warning"]
        problem = Problem("failure", check.errors[0].rule, errors) if errors else None
        cases.append(Case(f"bench check {check.kind}", name, check.wall_s, problem, warnings))
    return cases


COMMANDS = (
    Command("check", check, (
        FILES,
        BENCHES,
        *WISHES,
        flag("--strict", "Treat warnings as errors."),
        option(
            "--format text|json|sarif|github|junit",
            "text: problems on stderr; other formats: only that format on stdout.",
            to="form", choices=FORMATS, default="text",
        ),
    )),
)  # fmt: skip
