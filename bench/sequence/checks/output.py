"""Findings of a check as text, SARIF and GitHub annotations.

The line for people, `file:line:column: problem [rule]`, is the standard form of problems; the other formats are derived
from it.
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

INPUT_RULE = "input"  # rule of problems of a file itself
SARIF_SCHEMA = "https://json.schemastore.org/sarif-2.1.0.json"
# compiled for the first error
_LINE = r"(?:(?P<file>.+?):(?P<line>\d+):(?P<column>\d+): )?(?P<text>.*?)(?: \[(?P<rule>[a-z]+(-[a-z]+)+)\])?"


class Shown(NamedTuple):
    """One finding; `file` is None for the command line and for files that cannot be read."""

    severity: Severity
    rule: str
    file: str | None
    line: int
    column: int
    text: str

    @classmethod
    def of_error(cls, problem: str) -> Self:
        """Return the finding of one problem of an InputError."""
        found = re.fullmatch(_LINE, problem)
        if found is None or found["file"] is None:
            return cls("error", INPUT_RULE, None, 1, 1, problem)
        rule = found["rule"] or INPUT_RULE
        return cls("error", rule, found["file"], int(found["line"]), int(found["column"]), found["text"])

    @classmethod
    def of_remark(cls, remark: Remark, document: Document) -> Self:
        """Return the finding of a remark on a sequence, or on another document that it names."""
        document = remark.document(document)
        mark = document.mark(remark.place)
        text = f"{remark.problem}. {remark.advice}"
        return cls(remark.severity, remark.rule, str(document.path), mark.line, mark.column, text)

    @property
    def in_words(self) -> str:
        """Line for people: `file:line:column: problem [rule]`."""
        place = "" if self.file is None else f"{self.file}:{self.line}:{self.column}: "
        severity = "warning: " if self.severity == "warning" else ""
        return f"{place}{severity}{self.text}{'' if self.rule == INPUT_RULE else f' [{self.rule}]'}"


def warning_line(remark: Remark, document: Document) -> str:
    """Return a warning as a line for people."""
    return f"{remark.document(document).where(remark.place)}: warning: {remark.text}"


def as_sarif(found: Sequence[Shown]) -> str:
    """Return the findings as SARIF 2.1.0: one run of one tool."""
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
    """Return the findings as GitHub workflow commands, which annotate the lines of a change."""
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
    "sarif": as_sarif, "github": as_github,
}  # fmt: skip
