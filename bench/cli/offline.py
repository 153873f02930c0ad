"""reduce: recorded data of other benches, reduced by our methods."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    app.command()(reduce)


def reduce(
    case: Annotated[Path, typer.Argument(metavar="CASE.json", help="A case file; its CSV records lie beside it.")],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where result.json goes.")],
) -> None:
    """Reduce a recorded case of the methods M0 to M4 and write result.json."""
    from bench.errors import InputError
    from bench.report.case import reduce_case
    from bench.store.runs import json_text, write_whole

    result = reduce_case(case)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise InputError(f"{out}: cannot be made ({problem})") from None
    write_whole(out / "result.json", json_text(result).encode())
    sys.stdout.write(f"{out / 'result.json'}\n")
