"""Results as a table for spreadsheets and databases: a line for each finding."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping
from typing import Any

from bench.metrology.results.coverage import COVERAGE
from bench.reduce.evaluate import Results
from bench.report.export.csv_cells import harmless

COLUMNS = (
    "id", "uut", "quantity", "name", "at", "value", "unit", "u", "k", "dof", "min", "max", "guard", "verdict",
    "marginal", "flags",
)  # fmt: skip


def spreadsheet(results: Results) -> str:
    """A line for each finding, each single measurement and each acquisition with gaps; unknown values are empty.

    `u` is the standard uncertainty, `k` the coverage factor of U = k · u, `dof` its degrees of freedom, `inf` for
    unlimited. Text that a spreadsheet would take for a formula is made harmless.
    """
    content = results.to_json()
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    for row in (*_findings(content), *_measurements(content), *_missed(content)):
        writer.writerow({name: harmless(cell) for name, cell in row.items()})
    return text.getvalue()


def _findings(content: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for finding in content["findings"]:
        yield {
            **finding,
            **(finding["limits"] or {}),
            "at": "; ".join(f"{name} {value}" for name, value in finding["at"].items() if value is not None),
            "dof": "inf" if finding["dof"] is None else finding["dof"],
            "flags": " ".join(finding["flags"]),
        }


def _measurements(content: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for found in content["measurements"]:
        limits = found["limits"] or {}
        yield {**found, **limits, "id": found["step"], "quantity": found["reading"], "k": COVERAGE}


def _missed(content: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Losses of a channel in an acquisition; its first gaps are in the column `at`."""
    for found in content.get("missed", ()):
        gaps = [f"{gap['first']}-{gap['last']}" for gap in found["listed"]]
        more = [f"{found['gaps']} in all"] if found["gaps"] > len(gaps) else []
        yield {
            "id": found["step"],
            "quantity": f"missed_{found['what']}",
            "name": f"{found['device']}.{found['channel']}",
            "at": "; ".join((*gaps, *more)),
            "value": found["lost"],
            "flags": " ".join(found["unusable"]),
        }
