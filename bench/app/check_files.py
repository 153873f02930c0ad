"""Checks of many files in one process: each as what it is, and each sequence on the benches that meet its needs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from bench.app import request as requests
from bench.app.files_to_check import SEQUENCE, FileToCheck
from bench.app.request import RunRequest
from bench.config.bench import LoadedBench, load_bench
from bench.config.load import find, load_file
from bench.errors import InputError
from bench.sequence.checks.check import unmet_needs
from bench.sequence.checks.output import INPUT_RULE, Shown
from bench.sequence.load import load_judged_plan
from drivers.installed import loaded

Check = Callable[[Path], object]
Benches = Mapping[str | None, LoadedBench | None]  # by name; None for one that cannot be loaded


class FileCheck(NamedTuple):
    """Findings of one file; of a sequence on one bench, with the number of its steps."""

    path: Path
    kind: str
    found: tuple[Shown, ...] = ()
    bench: str = ""
    steps: int = 0
    wall_s: float = 0.0

    @property
    def errors(self) -> tuple[Shown, ...]:
        """Findings that forbid the use of the file."""
        return tuple(shown for shown in self.found if shown.severity == "error")


def check_files(
    files: Iterable[FileToCheck], request: RunRequest, benches: Iterable[str | None], others: Mapping[str, Check]
) -> Iterator[FileCheck]:
    """Check files; each sequence on each of `benches` that meets its needs, or on the only one.

    `others` are the checks of files that are no sequences, by kind.
    """
    on = {name: _loaded(name) for name in benches}
    for file in files:
        if file.kind == SEQUENCE:
            yield from (_lines_alone(each) if file.is_called else each for each in _on_benches(file, request, on))
        else:
            yield _checked_alone(file, others[file.kind])


def unique(checks: Iterable[FileCheck]) -> list[Shown]:
    """Return the findings of all files; what is found in a bench file with several sequences is there once.

    A problem of a file as a whole is at its beginning, because programs show no finding without a place.
    """
    return list(dict.fromkeys(_placed(shown, check.path) for check in checks for shown in check.found))


def _loaded(name: str | None) -> LoadedBench | None:
    try:
        return requests.load_bench_named(name)
    except InputError:
        return None  # every check on it reports why


def _on_benches(file: FileToCheck, request: RunRequest, benches: Benches) -> Iterator[FileCheck]:
    wish = request._replace(sequence=str(file.path))
    try:
        names = _suitable(wish, benches) if len(benches) > 1 else list(benches)
    except InputError as error:
        yield FileCheck(file.path, file.kind, _errors(error))
        return
    for name in names:
        check = _on_bench(file, wish._replace(bench=name), benches[name])
        yield check if len(benches) == 1 else check._replace(found=tuple(_on(name, shown) for shown in check.found))


def _on(bench: str | None, shown: Shown) -> Shown:
    return shown._replace(text=f"{shown.text} (on the bench {bench})")


def _suitable(wish: RunRequest, benches: Benches) -> list[str | None]:
    """Return the benches that meet the needs of a sequence. Raises InputError if none does."""
    plan, _ = load_judged_plan(
        find(wish.sequence, "sequences"), None, preset=wish.preset, parameters=wish.parameters, settings=wish.settings
    )
    unmet = {name: list(unmet_needs(plan, loaded.bench)) if loaded else [] for name, loaded in benches.items()}
    if names := [name for name, problems in unmet.items() if not problems]:
        return names
    lacks = "; ".join(f"{name}: {problems[0][1]}" for name, problems in unmet.items())
    raise InputError(f"{plan.document.where(('needs',))}: no given bench meets the needs of this sequence: {lacks}")


def _on_bench(file: FileToCheck, wish: RunRequest, loaded: LoadedBench | None) -> FileCheck:
    bench = str(loaded.document.path) if loaded is not None else wish.bench or ""
    try:
        checked = requests.load_checked(wish, loaded)
    except InputError as error:
        return FileCheck(file.path, file.kind, _errors(error), bench)
    document = checked.plan.document
    found = tuple(Shown.of_remark(warning, document) for warning in checked.warnings)
    return FileCheck(document.path, file.kind, found, bench, len(checked.plan))


def _lines_alone(check: FileCheck) -> FileCheck:
    """Return a check without the findings of rules on a whole sequence, which this one is only with its caller."""
    return check._replace(found=tuple(shown for shown in check.found if shown.rule == INPUT_RULE))


def _checked_alone(file: FileToCheck, check: Check) -> FileCheck:
    try:
        check(file.path)
    except InputError as error:
        return FileCheck(file.path, file.kind, _errors(error))
    return FileCheck(file.path, file.kind)


def _errors(error: InputError) -> tuple[Shown, ...]:
    return tuple(map(Shown.of_error, error.problems))


def _placed(shown: Shown, path: Path) -> Shown:
    begins = f"{path}: "
    if shown.file is not None or not shown.text.startswith(begins):
        return shown
    return shown._replace(file=str(path), text=shown.text.removeprefix(begins))


def _beside(driver: str) -> Check:
    """Return a check of the file that the options of a driver refer to."""
    return lambda path: load_file(path, loaded("bench.config.schema:model_beside")(driver))


CHECKS: Mapping[str, Check] = {  # what they need is imported by them, because it takes long
    "bench": load_bench,
    "scenario": lambda path: load_file(path, loaded("bench.config.scenario:ScenarioFile")),
    "answers": lambda path: load_file(path, loaded("bench.config.answers:AnswersFile")),
    "chamber": _beside("modbus_chamber"),
    "table": _beside("framed_table"),
    "uut": lambda path: loaded("bench.app.laboratory:check_unit_file")(path),
    "calibration": lambda path: loaded("bench.offline.calibration_file:read_calibration")(path),
    "laboratory": lambda path: loaded("bench.config.laboratory:load_laboratory")(path),
}
