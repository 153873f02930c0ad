"""Checks of sequences and bench files, of a text that somebody edits well as of a file, as `bench check` makes them.

For worker processes.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from pydantic import BaseModel, ConfigDict, Field

from bench.app.request import RunRequest
from bench.errors import InputError

if TYPE_CHECKING:
    from bench.sequence.checks.output import Shown

BESIDE_MOST = 1000


class FindingView(BaseModel):
    """Finding of a check, at its place; `file` is empty for the text itself and names another file otherwise."""

    model_config = ConfigDict(frozen=True)

    severity: str = Field(description="error or warning")
    rule: str
    file: str
    line: int
    column: int
    text: str


class DraftCheck(BaseModel):
    """Check of a text on a bench; without errors also its duration and the picture of its plan."""

    model_config = ConfigDict(frozen=True)

    found: list[FindingView]
    steps: int = 0
    expected_s: float = Field(0.0, description="estimated duration in s of bench time")
    picture: str = Field("", description="SVG; empty if it was not asked for")

    @property
    def errors(self) -> list[FindingView]:
        """Findings that forbid a run."""
        return [each for each in self.found if each.severity == "error"]


def check_draft(name: str, text: str, beside: Path, bench: Path, lang: str) -> DraftCheck:
    """Check a text as the sequence of a name in the folder `beside`, with the default of each parameter.

    `lang` is the language of the picture, "" for none.
    """
    with _as_file(name, text, beside) as path:
        return check_file(path, bench, lang).check


class Examined(NamedTuple):
    """Check of a file of a sequence, and the texts that a release of it would have; none if it has errors."""

    check: DraftCheck
    texts: dict[str, str]


def check_file(path: Path, bench: Path, lang: str = "") -> Examined:
    """Check a file of a sequence on a bench; `lang` is the language of the picture, "" for none."""
    from bench.app.check_files import check_files
    from bench.app.files_to_check import SEQUENCE, FileToCheck
    from bench.app.inputs import sequence_inputs
    from bench.app.request import load_checked
    from bench.station.prepare.before_a_run import picture_of

    (found,) = check_files([FileToCheck(path, SEQUENCE)], RunRequest(""), [str(bench)], {})
    findings = [_view(each, path) for each in found.found]
    if found.errors:
        return Examined(DraftCheck(found=findings), {})
    checked = load_checked(RunRequest(str(path), str(bench)))
    check = DraftCheck(
        found=findings, steps=found.steps, expected_s=checked.expected.total_s,
        picture=picture_of(checked, lang) if lang else "",
    )  # fmt: skip
    return Examined(check, sequence_inputs(checked.plan.document))


def expect_readable(name: str, text: str) -> None:
    """Raise InputError with all that keeps a text from being read as a sequence, each problem with its line."""
    from bench.config.document import parse_document
    from bench.config.load import load
    from bench.sequence.document.model import CONTEXT, SequenceFile

    load(parse_document(text, Path(f"{name}.yaml")), SequenceFile, **CONTEXT, files_needed=False)


def bench_texts(bench: Path) -> dict[str, str]:
    """Check a bench file, and return its text and those of the files that it names. Raises InputError."""
    from bench.app.inputs import bench_inputs
    from bench.config.bench import load_bench

    return bench_inputs(load_bench(bench))


def _view(found: Shown, path: Path) -> FindingView:
    """Return a finding; files of the folder are shown by their names."""
    folder = f"{path.parent}/"
    return FindingView(
        severity=found.severity, rule=found.rule, line=found.line, column=found.column,
        file="" if found.file == str(path) else (found.file or "").removeprefix(folder),
        text=found.text.replace(folder, ""),
    )  # fmt: skip


@contextmanager
def _as_file(name: str, text: str, beside: Path) -> Iterator[Path]:
    """Yield a file with the text in a folder of its own, where links lead to the other sequences."""
    with tempfile.TemporaryDirectory(prefix="draft-") as folder:
        path = Path(folder, f"{name}.yaml")
        others = sorted(beside.glob("*.yaml"))[:BESIDE_MOST] if beside.is_dir() else []
        for other in others:
            if other.name != path.name:
                (path.parent / other.name).symlink_to(other.absolute())
        try:
            path.write_text(text, "utf-8")
        except (OSError, UnicodeEncodeError) as problem:
            raise InputError(f"{path.name}: cannot be written ({problem})") from None
        yield path
