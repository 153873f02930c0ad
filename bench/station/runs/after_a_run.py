"""What is made of a run after its end: its report in other forms, and its reduction again. For worker processes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

FORMS, LANGUAGES = ("html", "pdf", "csv", "json"), ("en", "zh")


def report(run: Path, form: str, lang: str) -> dict[str, Any]:
    """Write the report of a run in a form and a language; return the name of the file. Raises BenchError."""
    from bench.reduce.stored_run import open_run
    from bench.report.write import write_report

    with open_run(run) as stored:
        return {"file": write_report(stored, form, lang).name}


def reduction(run: Path) -> dict[str, Any]:
    """Reduce a run again from its raw counts; return what differs from its results. Raises StoreError, InputError."""
    from bench.reduce.reduced_again import reduced_again
    from bench.reduce.stored_run import open_run

    with open_run(run) as stored:
        found = reduced_again(stored)
        return {"lines": list(found.in_words()), **found.to_json()}
