"""This program beside its peers, in one table: `make benchmark`, or overnight `make benchmark-full`.

    python -m benchmarks --only steps --only start
    python -m benchmarks --whole            # nights instead of slices; stopped, it goes on where it was
    python -m benchmarks --readme           # puts the table of results.json into the README

Every row has both sides measured in turn in this run (`compared.py`); the peers have environments of their own in
build/peers. Results are added to benchmarks/results.json as they come, with date and machine.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from benchmarks.compared import Row, Side, table

ROOT = Path(__file__).parents[1]
RESULTS = Path(__file__).parent / "results.json"
BEGIN, END = "<!-- benchmark: begin -->", "<!-- benchmark: end -->"
WORKS = sorted(each.stem for each in (Path(__file__).parent / "rows").glob("[a-z]*.py"))


def main() -> int:
    """Measure what is asked for; 1 when a goal is not met."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", choices=WORKS, default=[])
    parser.add_argument("--whole", action="store_true")
    parser.add_argument("--readme", action="store_true")
    options = parser.parse_args()
    if options.readme:
        into_readme()
        return 0
    known = _known(options.whole)
    for work in options.only or [each for each in WORKS if not (options.whole and each in known["works"])]:
        rows = list(importlib.import_module(f"benchmarks.rows.{work}").measure(options.whole))
        print(table(rows), flush=True)
        known["works"][work] = {"date": f"{datetime.now(UTC):%Y-%m-%d}", "rows": [each.as_data() for each in rows]}
        known |= {"machine": machine(), "version": version("inertial-test-bench")}
        RESULTS.write_text(json.dumps(known, indent=1, sort_keys=True, ensure_ascii=False) + "\n", "utf-8")
    return 0 if all(each["is_met"] for work in known["works"].values() for each in work["rows"]) else 1


def machine() -> str:
    """Processor, kernel and Python of this computer, in one line."""
    cpus = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    models = [line.partition(":")[2].strip() for line in cpus if line.startswith("model name")]
    model = models[0] if models else platform.machine()
    return f"{os.cpu_count()} × {model}, Linux {platform.release()}, Python {platform.python_version()}"


def into_readme() -> None:
    """Put the table of `results.json` into the README. Raises SystemExit if nothing was measured."""
    if not (known := _known(None))["works"]:
        raise SystemExit(f"{RESULTS} has no results: run `python -m benchmarks` first")
    readme = ROOT / "README.md"
    readme.write_text(with_table(readme.read_text("utf-8"), known), "utf-8")


def with_table(text: str, known: dict[str, Any]) -> str:
    """The text with the table of results between its marks. Raises SystemExit if a mark is missing."""
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise SystemExit(f"the README needs a line {BEGIN} and, below it, a line {END}")
    rows = sorted((each for work in known["works"].values() for each in work["rows"]), key=_place)
    dates = sorted(work["date"] for work in known["works"].values())
    span = dates[0] if dates[0] == dates[-1] else f"{dates[0]} to {dates[-1]}"
    part = "whole nights" if known["whole"] else "parts of nights"
    head = f"Measured on {span}, {part}, version {known['version']}: {known['machine']}."
    return f"{before}{BEGIN}\n{head}\n\n{table([_row(each) for each in rows])}\n{END}{after}"


def _known(whole: bool | None) -> dict[str, Any]:
    """What was measured before; of slices it is measured again, of whole nights it is kept."""
    empty: dict[str, Any] = {"works": {}, "whole": bool(whole)}
    if not RESULTS.exists():
        return empty
    known: dict[str, Any] = json.loads(RESULTS.read_text("utf-8"))
    return known if whole is None or known["whole"] == whole else empty


def _row(data: dict[str, Any]) -> Row:
    given = {key: value for key, value in data.items() if key not in ("ratios", "ours", "peers")}
    return Row(ours=_side(data["ours"]), peers=tuple(_side(each) for each in data["peers"]), **given)


def _side(data: dict[str, Any]) -> Side:
    return Side(data["name"], data["durability"], tuple(data["values"]))


def _place(row: dict[str, Any]) -> tuple[int, Sequence[str]]:
    return int(row["key"].lstrip("P")), row["work"]


if __name__ == "__main__":
    sys.exit(main())
