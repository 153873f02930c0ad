"""The scorecard, for a terminal and for a page."""

from __future__ import annotations

import io
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from campaigns.reliability.campaign import Results
from campaigns.reliability.scorecard import LINES, Line
from tests.support.runs import ROOT

PAGE = ROOT / "docs" / "explanation" / "reliability.md"
_HEAD = "| line | claim | trials | wrong | tried | at |\n|---|---|---|---|---|---|\n"


def table(lines: Sequence[Line], results: Results) -> str:
    """A row for each line: how many of how many trials, what failed, and when and at which commits it was tried."""
    shown = Table("line", "claim", "trials", "wrong", "tried", "at", title="Reliability")
    for line in lines:
        found, failed = results.of(line), results.failed(line)
        days = sorted({result.at[:10] for result in found})
        commits = list(dict.fromkeys(result.commit for result in found))
        shown.add_row(
            line.key,
            line.claim,
            f"{len(found) * line.of} of {line.bar * line.of}",
            f"{len(failed)}" + "".join(f"\n{result.trial}: {result.wrong[:160]}" for result in failed[:3]),
            "–".join(dict.fromkeys((days[0], days[-1]))) if days else "never",
            ", ".join(commits[-2:]),
        )
    text = io.StringIO()
    Console(file=text, width=150).print(shown)
    return text.getvalue()


def with_counts(page: str, results: Results) -> str:
    """A page with its table of counts as the results have it."""
    before, _, after = page.partition(_HEAD)
    _, _, after = after.partition("\n\n")
    rows = (_row(line, results) for line in LINES.values())
    return f"{before}{_HEAD}{''.join(rows)}\n{after}"


def _row(line: Line, results: Results) -> str:
    found, failed = results.of(line), results.failed(line)
    when = max((result.at[:10] for result in found), default="never")
    at = max(found, key=lambda result: result.trial).commit if found else ""
    counts = f"{len(found) * line.of:,} of {line.bar * line.of:,}"
    return f"| {line.key} | {line.claim} | {counts} | {len(failed)} | {when} | {at} |\n"
