"""What a check found, for people, for scripts, and for the places where other people's changes are looked at.

The line that people read, `file:line:column: what [rule]`, is the form that problems have everywhere; the others are
made from it.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Self
from urllib.parse import quote

from bench.config.document import Document
from bench.sequence.checks.remarks import Remark, Severity
from bench.sequence.checks.rules import every_rule

INPUT_RULE = "input"  # of what is wrong with a file by itself
SARIF_SCHEMA = "https://json.schemastore.org/sarif-2.1.0.json"
_LINE = re.compile(
    r"(?:(?P<file>.+?):(?P<line>\d+):(?P<column>\d+): )?(?P<text>.*?)(?: \[(?P<rule>[a-z]+(-[a-z]+)+)\])?"
)


class Shown(NamedTuple):
    """One thing found; `file` is None for what is wrong on the command line, and for files that cannot be read."""

    severity: Severity
    rule: str
    file: str | None
    line: int
    column: int
    text: str

    @classmethod
    def of_error(cls, problem: str) -> Self:
        """One of the problems of an InputError."""
        found = _LINE.fullmatch(problem)
        if found is None or found["file"] is None:
            return cls("error", INPUT_RULE, None, 1, 1, problem)
        rule = found["rule"] or INPUT_RULE
        return cls("error", rule, found["file"], int(found["line"]), int(found["column"]), found["text"])

    @classmethod
    def of_remark(cls, remark: Remark, document: Document) -> Self:
        """A remark on a sequence, or on another document that it names."""
        document = remark.document(document)
        mark = document.mark(remark.place)
        text = f"{remark.problem}. {remark.advice}"
        return cls(remark.severity, remark.rule, str(document.path), mark.line, mark.column, text)


def warning_line(remark: Remark, document: Document) -> str:
    """A warning as people read it."""
    return f"{remark.document(document).where(remark.place)}: warning: {remark.text}"


def as_json(found: Sequence[Shown]) -> str:
    """An object with a list of what was found, one line."""
    return json.dumps({"found": [shown._asdict() for shown in found]}, ensure_ascii=False)


def as_sarif(found: Sequence[Shown]) -> str:
    """SARIF 2.1.0: one run of one tool."""
    results = [
        {
            "ruleId": shown.rule,
            "level": shown.severity,
            "message": {"text": shown.text},
            **({"locations": [_location(shown, shown.file)]} if shown.file is not None else {}),
        }
        for shown in found
    ]
    rules = [_described(name) for name in dict.fromkeys(shown.rule for shown in found)]
    tool = {"driver": {"name": "bench check", "rules": rules}}
    run = {"tool": tool, "columnKind": "unicodeCodePoints", "results": results}
    return json.dumps({"$schema": SARIF_SCHEMA, "version": "2.1.0", "runs": [run]}, ensure_ascii=False)


def _described(name: str) -> dict[str, Any]:
    titles = {rule.name: rule.title for rule in every_rule()}
    return {"id": name} | ({"shortDescription": {"text": titles[name]}} if name in titles else {})


def _location(shown: Shown, file: str) -> dict[str, Any]:
    path = Path(file)
    uri = path.as_uri() if path.is_absolute() else quote(path.as_posix())
    region = {"startLine": shown.line, "startColumn": shown.column}
    return {"physicalLocation": {"artifactLocation": {"uri": uri}, "region": region}}


def as_github(found: Iterable[Shown]) -> str:
    """Workflow commands, which a job on GitHub shows beside the lines of a change."""
    return "\n".join(map(_command, found))


def _command(shown: Shown) -> str:
    message = f"{_escaped(shown.text)} [{shown.rule}]"
    if shown.file is None:
        return f"::{shown.severity}::{message}"
    file = _escaped(shown.file).replace(":", "%3A").replace(",", "%2C")
    return f"::{shown.severity} file={file},line={shown.line},col={shown.column}::{message}"


def _escaped(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


RENDERERS: Mapping[str, Callable[[Sequence[Shown]], str]] = {
    "json": as_json, "sarif": as_sarif, "github": as_github,
}  # fmt: skip
