"""reduce, compensate: reduction of recorded data and stored runs, and compensation of unit data by calibrations."""

from __future__ import annotations

import sys
from pathlib import Path

from bench.cli import exits
from bench.cli.commands import Command, argument, option
from bench.cli.running import ONLY_RESULTS
from bench.cli.stored import DAMAGED, RUNS
from bench.cli.streams import remark, say, say_json


def reduce(case_or_run: str, out: Path | None, runs: Path, *, as_json: bool, damaged: bool) -> int:
    """Reduce a recorded case of the methods M0 to M4; or reduce a run again, and list the findings that changed.

    The exit code of a case is 0 if it is reduced or passes, 1 if it fails, and that of an incomplete run if a requested
    result could not be determined or its data are doubtful.
    """
    if case_or_run.endswith(".json"):
        return _reduce_case(Path(case_or_run), out, as_json=as_json)
    _reduce_run(case_or_run, runs, out, as_json=as_json, damaged=damaged)
    return exits.PASS


def compensate(calibration: Path, data: Path, out: Path | None, beyond: str) -> None:
    """Convert the output of a calibrated unit to the measured quantity, compensated for its temperature."""
    from bench.files import atomic_file
    from bench.offline.calibration_file import compensated, read_calibration

    known = read_calibration(calibration)
    remark(*(f"{calibration.name}: {warning}" for warning in known.warnings))
    text = compensated(known, data, "hold" if beyond == "hold" else "reject")
    if out is None:
        sys.stdout.write(text)
    else:
        with atomic_file(out) as draft:
            draft.write_text(text, encoding="utf-8")


def _reduce_case(case: Path, out: Path | None, *, as_json: bool) -> int:
    from bench.errors import InputError
    from bench.files import atomic_file
    from bench.offline.case import reduced_case
    from bench.store.runs import json_text

    if out is None and not as_json:
        raise InputError(f"{case}: give --out DIR to write result.json, or --json to print it")
    found = reduced_case(case)
    if as_json:
        say_json(found.content)
    if out is not None:
        with atomic_file(out / "result.json") as draft:
            draft.write_text(json_text(found.content), encoding="utf-8")
        if not as_json:
            say(out / "result.json")
    if found.outcome == "INCOMPLETE":
        why = ", ".join(found.lacking) or "a result with a limit could not be determined; see its notes"
        remark(f"{case.name}: INCOMPLETE: {why}")
    return exits.PASS if found.outcome == "REDUCED" else exits.OF_VERDICT[found.outcome]


def _reduce_run(name: str, runs: Path, out: Path | None, *, as_json: bool, damaged: bool) -> None:
    from bench.errors import InputError
    from bench.reduce.reduced_again import reduced_again
    from bench.reduce.stored_run import open_run
    from bench.store.runs import find_run

    if Path(name).is_file():
        raise InputError(
            f"{name}: is neither a case nor a run; a case is a CASE.json that names its CSV records, a run is a "
            "directory"
        )
    if out is not None:
        raise InputError(f"--out {out}: is for a case; 'bench report {name} --format json' writes the results of a run")
    with open_run(find_run(name, runs), damaged=damaged) as stored:
        found = reduced_again(stored)
    if as_json:
        say_json(found.to_json())
        return
    say(*found.in_words())


COMMANDS = (
    Command("reduce", reduce, (
        argument("CASE.json|RUN", "A case file with its CSV records beside it, or a run.", to="case_or_run"),
        option("--out DIR", "Directory for the result.json of a case.", read=Path),
        ONLY_RESULTS,
        DAMAGED,
        RUNS,
    )),
    Command("compensate", compensate, (
        argument("CAL.json", "The calibration file of a unit.", to="calibration", read=Path),
        argument(
            "DATA.csv", "CSV with columns T_C and output, and channel if there are several.", to="data", read=Path
        ),
        option("--out FILE", "Output file; default: standard output.", read=Path),
        option(
            "--beyond hold|reject", "Outside the calibrated temperatures: hold the end values, or reject.",
            choices=("hold", "reject"), default="hold",
        ),
    )),
)  # fmt: skip
