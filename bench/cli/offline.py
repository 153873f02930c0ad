"""reduce, compensate: recorded data of other benches by our methods, and data of units by their calibrations."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    app.command()(reduce)
    app.command()(compensate)


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


def compensate(
    calibration: Annotated[Path, typer.Argument(metavar="CAL.json", help="The calibration file of a unit.")],
    data: Annotated[
        Path, typer.Argument(metavar="DATA.csv", help="Columns T_C and output; channel, of several channels.")
    ],
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="Where it goes; else printed.")] = None,
    beyond: Annotated[
        str,
        typer.Option("--beyond", metavar="hold|reject", help="Beyond the known temperatures: hold or reject."),
    ] = "hold",
) -> None:
    """Turn the output of a calibrated unit into what it measures, at the temperature it then had."""
    from bench.errors import InputError
    from bench.report.calibration import compensated, read_calibration
    from bench.store.runs import write_whole

    if beyond not in ("hold", "reject"):
        raise InputError(f"--beyond {beyond}: is neither hold nor reject")
    known = read_calibration(calibration)
    for warning in known.warnings:
        sys.stderr.write(f"{calibration.name}: {warning}\n")
    text = compensated(known, data, "hold" if beyond == "hold" else "reject")
    if out is None:
        sys.stdout.write(text)
    else:
        write_whole(out, text.encode())
