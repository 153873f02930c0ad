"""reduce, compensate, certificate: what is done with files, without a bench.

Reduction of recorded data and stored runs, compensation of unit data by calibrations, content of certificates.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TextIO

from bench.cli import exits
from bench.cli.commands import Command, argument, flag, option, options, whole_number
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


def compensate(
    calibration: Path,
    data: Path,
    out: Path | None,
    beyond: str,
    to: str,
    unit: str,
    counter_bits: int | None,
    noise: str | None,
    at_start: tuple[str, ...],
    step: str | None,
    runs: Path,
) -> None:
    """Convert the output of a calibrated unit to the measured quantity, compensated for its temperature.

    With --to it converts the counts of a unit in motion, in a file or in an acquisition of a run, to specific force or
    velocity, with the standard uncertainty of each value.
    """
    from bench.offline.calibration_file import compensated, read_calibration

    known = read_calibration(calibration)
    remark(*(f"{calibration.name}: {warning}" for warning in known.warnings))
    if to == "value":
        _only_in_motion(unit != "g", counter_bits is not None, noise is not None, bool(at_start), step is not None)
        text = compensated(known, data, "hold" if beyond == "hold" else "reject")
        _write(out, lambda file: file.write(text))
        return
    from bench.offline.motion import axes_of, converted, in_motion, wanted

    options = wanted(to, unit, beyond, counter_bits, noise, at_start)
    if step is None and data.suffix == ".csv":
        found = in_motion(known, data, options)
    else:
        from bench.reduce.counted import counted_in_run
        from bench.reduce.stored_run import open_run
        from bench.store.runs import find_run

        with open_run(find_run(str(data), runs)) as stored:
            series = counted_in_run(stored, known.uut, list(axes_of(known)), step)
        found = converted(known, f"{data.name} {step}", series, options)
    remark(*found.remarks)
    _write(out, found.write)


def certificate(file: Path, signed_by: Path | None, *, as_json: bool) -> None:
    """Print the content of a Digital Calibration Certificate: its quantities with their names, and its signature.

    A signature is verified; with --signed-by there must be one, by the key of one of those certificates.
    """
    from bench.certificates.certificate import read_certificate
    from bench.certificates.shown import in_words, to_json
    from bench.certificates.signature import verified

    found = read_certificate(file)
    signature = verified(found.markup, signed_by)
    if as_json:
        say_json(to_json(found, signature))
    else:
        say(*in_words(found, signature))


def _write(out: Path | None, write: Callable[[TextIO], object]) -> None:
    """Write to a file, or to standard output."""
    from bench.files import atomic_file

    if out is None:
        write(sys.stdout)
    else:
        with atomic_file(out) as draft, draft.open("w", encoding="utf-8") as file:
            write(file)


def _only_in_motion(*given: bool) -> None:
    """Raise InputError if an option is given that needs --to."""
    from bench.errors import InputError

    names = ("--unit", "--counter-bits", "--noise", "--at-start", "--step")
    if wrong := [name for name, is_given in zip(names, given, strict=True) if is_given]:
        raise InputError(f"{wrong[0]}: is for counts, with --to acceleration or --to velocity")


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
            "DATA.csv|RUN",
            "CSV with columns T_C and output, and channel if there are several; or, with --to and --step, a run.",
            to="data", read=Path,
        ),
        option("--out FILE", "Output file; default: standard output.", read=Path),
        option(
            "--beyond hold|reject", "Outside the calibrated temperatures: hold the end values, or reject.",
            choices=("hold", "reject"), default="hold",
        ),
        option(
            "--to value|acceleration|velocity",
            "Result: the value of each row; or specific force or velocity from cumulative counts, in columns t_s, T_C, "
            "and CHANNEL, or CHANNEL_pos and CHANNEL_neg.",
            choices=("value", "acceleration", "velocity"), default="value",
        ),
        option("--unit g|m/s2", "Unit of --to acceleration.", choices=("g", "m/s2"), default="g"),
        option(
            "--counter-bits N", "Bits of counters of one sign that wrap; default: none wraps.", read=whole_number(1, 52)
        ),
        option("--noise DENSITY", 'White noise of the sensor, such as "2 µg/Hz^0.5"; default: none.'),
        options(
            "--at-start CHANNEL=G",
            "Specific force in the first second, at rest, such as x=1: another one is refused; repeatable.",
            to="at_start",
        ),
        option("--step STEP", "With a run: the acquisition whose counts are converted."),
        RUNS,
    )),
    Command("certificate", certificate, (
        argument("FILE.xml", "A Digital Calibration Certificate (DCC).", to="file", read=Path),
        option("--signed-by FILE.pem", "Certificates in PEM: one of them must have signed it.", read=Path),
        flag("--json", "Print it as JSON.", to="as_json"),
    )),
)  # fmt: skip
