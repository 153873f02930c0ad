"""Hostile trials, printed as one table: `python -m campaigns.trials [--only NAME …] [--scale 0.05]`.

Every other module of this package is one family of trials, with a function `trials(scale)` that yields its rows.
"""

from __future__ import annotations

import argparse
import importlib
import pkgutil
import sys
from collections.abc import Iterator

from rich.console import Console
from rich.table import Table

import campaigns.trials
from campaigns.trials.rows import Row


def families() -> list[str]:
    """Names of the modules that hold trials."""
    names = (module.name for module in pkgutil.iter_modules(campaigns.trials.__path__))
    return sorted(name for name in names if name not in ("__main__", "rows") and not name.startswith("test_"))


def rows_of(names: list[str], scale: float) -> Iterator[tuple[str, Row]]:
    """Run the families in order; each row as soon as it is known, with the family's name."""
    for name in names:
        for row in importlib.import_module(f"campaigns.trials.{name}").trials(scale):
            sys.stderr.write(f"{name}: {row.line}: {row.result}\n")
            yield name, row


def main() -> int:
    """Print the table; exit status 1 when a row is not as expected."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", action="append", choices=families(), metavar="NAME", help="a family; may be repeated")
    parser.add_argument("--scale", type=float, default=1.0, help="share of the full number of trials")
    options = parser.parse_args()
    table = Table("family", "line", "trials", "result", "", title="Trials")
    failed = 0
    for name, row in rows_of(options.only or families(), options.scale):
        failed += not row.ok
        table.add_row(name, row.line, str(row.trials), row.result, "ok" if row.ok else "FAILED")
    Console(width=160).print(table)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
