"""This program beside its peers, in one table: `make benchmark`, or overnight `make benchmark-full`.

    python -m benchmarks --only steps --only start
    python -m benchmarks --whole            # nights instead of slices; stopped, it goes on where it was
    python -m benchmarks --readme           # puts the table of results.json into the README

Every row has both sides measured in turn in this run (`compared.py`); the peers have environments of their own in
build/peers. Results replace those of the same work in benchmarks/results.json as they come, with date and machine.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
import sys
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from benchmarks.compared import Row, Side, table

ROOT = Path(__file__).parents[1]
RESULTS = Path(__file__).parent / "results.json"
BEGIN, END = "<!-- benchmark: begin -->", "<!-- benchmark: end -->"
Works = dict[str, dict[str, Any]]  # by name: date, machine, version, whether nights are whole, and rows
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
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # both sides would compile their modules at each start
    works = _known()
    for work in options.only or works_to_measure(works, whole=options.whole):
        rows = list(importlib.import_module(f"benchmarks.rows.{work}").measure(options.whole))
        print(table(rows), flush=True)
        works[work] = {
            "date": f"{datetime.now(UTC):%Y-%m-%d}", "machine": machine(), "version": version("inertial-test-bench"),
            "whole": options.whole, "rows": [each.as_data() for each in rows],
        }  # fmt: skip
        RESULTS.write_text(json.dumps(works, indent=1, sort_keys=True, ensure_ascii=False) + "\n", "utf-8")
    return 0 if all(each["is_met"] for work in works.values() for each in work["rows"]) else 1


def works_to_measure(works: Works, *, whole: bool) -> list[str]:
    """All works; of whole ones those that are left of a measurement that was stopped."""
    left = [each for each in WORKS if not (whole and each in works and works[each]["whole"])]
    return left or WORKS


def machine() -> str:
    """Processor, kernel and Python of this computer, in one line."""
    cpus = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    models = [line.partition(":")[2].strip() for line in cpus if line.startswith("model name")]
    model = models[0] if models else platform.machine()
    return f"{os.cpu_count()} × {model}, Linux {platform.release()}, Python {platform.python_version()}{_maker()}"


def _maker() -> str:
    """Return " of " and the distribution that ships this interpreter; "" for another one, which may be slower."""
    if Path(sys.executable).resolve().parent != Path("/usr/bin"):
        return ""
    return f" of {platform.freedesktop_os_release()['PRETTY_NAME']}"


def into_readme() -> None:
    """Put the table of `results.json` into the README. Raises SystemExit if nothing was measured."""
    if not (works := _known()):
        raise SystemExit(f"{RESULTS} has no results: run `python -m benchmarks` first")
    readme = ROOT / "README.md"
    readme.write_text(with_table(readme.read_text("utf-8"), works), "utf-8")


def with_table(text: str, works: Works) -> str:
    """The text with the table of results between its marks. Raises SystemExit if a mark is missing."""
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise SystemExit(f"the README needs a line {BEGIN} and, below it, a line {END}")
    rows = sorted((each for work in works.values() for each in work["rows"]), key=_place)
    return f"{before}{BEGIN}\n{_head(works)}\n\n{table([_row(each) for each in rows])}\n{END}{after}"


def _head(works: Works) -> str:
    """When, on what, and how much was measured."""
    dates, versions, machines = (
        sorted({work[key] for work in works.values()}) for key in ("date", "version", "machine")
    )
    span = dates[0] if len(dates) == 1 else f"{dates[0]} to {dates[-1]}"
    whole = {key for work in works.values() if work["whole"] for key in (row["key"] for row in work["rows"])}
    if len(whole) == len({row["key"] for work in works.values() for row in work["rows"]}):
        part = "whole nights"
    elif whole:
        part = f"whole nights in {', '.join(sorted(whole, key=_number))}, parts of nights in the others"
    else:
        part = "parts of nights"
    return f"Measured on {span}, {part}, version {', '.join(versions)}: {'; '.join(machines)}."


def _known() -> Works:
    """Works that were measured before."""
    works: Works = json.loads(RESULTS.read_text("utf-8")) if RESULTS.exists() else {}
    return works


def _row(data: dict[str, Any]) -> Row:
    given = {key: value for key, value in data.items() if key not in ("ratios", "ours", "peers")}
    return Row(ours=_side(data["ours"]), peers=tuple(_side(each) for each in data["peers"]), **given)


def _side(data: dict[str, Any]) -> Side:
    return Side(data["name"], data["durability"], tuple(data["values"]))


def _place(row: dict[str, Any]) -> tuple[int, str]:
    return _number(row["key"]), row["work"]


def _number(key: str) -> int:
    return int(key.lstrip("P"))


if __name__ == "__main__":
    sys.exit(main())
