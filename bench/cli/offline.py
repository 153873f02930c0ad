"""reduce, compensate, certificate: what is done with files, without a bench.

Reduction of recorded data and stored runs, compensation of unit data by calibrations, content of certificates.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from bench.cli import exits
from bench.cli.commands import Command, argument, flag, option, options, whole_number
from bench.cli.running import ONLY_RESULTS
from bench.cli.stored import DAMAGED, RUNS
from bench.cli.streams import remark, say, say_json
from bench.errors import InputError

if TYPE_CHECKING:  # imported for types only: the command line starts without numpy
    from bench.metrology.calibration.temperature import Beyond, Compensation
    from bench.offline.calibration_file import CalibrationFile
    from bench.offline.motion_series import Series


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
    nominal: str | None,
    runs: Path,
) -> None:
    """Convert the output of a calibrated unit to the measured quantity, compensated for its temperature.

    With --to it converts the counts or samples of a unit in motion, in a file or in an acquisition of a run, to
    specific force or velocity, with the standard uncertainty of each value; or outputs to those at the nominal
    temperature of the unit.
    """
    from bench.offline.calibration_file import compensated, read_calibration

    known = read_calibration(calibration)
    remark(*(f"{calibration.name}: {warning}" for warning in known.warnings))
    if to == "nominal":
        _only_in_motion(unit != "g", False, noise is not None, bool(at_start), False)
        _regress(known, data, out, nominal, "hold" if beyond == "hold" else "reject", counter_bits, step, runs)
        return
    if nominal is not None:
        raise InputError("--nominal: is the temperature of --to nominal")
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
        series = _recorded(known, data, axes_of(known), step, runs)
        found = converted(known, f"{data.name} {step}", series, options)
    remark(*found.remarks)
    _write(out, found.write)


def _regress(
    known: CalibrationFile,
    data: Path,
    out: Path | None,
    nominal: str | None,
    beyond: Beyond,
    counter_bits: int | None,
    step: str | None,
    runs: Path,
) -> None:
    """Convert outputs or counts to outputs at the nominal temperature."""
    from bench.offline.count_series import read_counts
    from bench.offline.nominal import (
        counted_channels,
        has_outputs,
        nominal_temperatures,
        regressed_counts,
        regressed_outputs,
    )

    nominal_c = nominal_temperatures(known, nominal)
    if step is None and has_outputs(data):
        text = regressed_outputs(known, data, nominal_c, beyond)
        _write(out, lambda file: file.write(text))
        return
    channels = counted_channels(known, nominal_c)
    if step is None and data.suffix == ".csv":
        name, series = data.name, read_counts(data, list(channels), counter_bits, is_warm=True)
    else:
        name, series = f"{data.name} {step}", _recorded(known, data, channels, step, runs)
    found = regressed_counts(known, name, series, nominal_c, beyond)
    remark(*found.remarks)
    _write(out, found.write)


def _recorded(
    known: CalibrationFile, run: Path, channels: Mapping[str, Compensation], step: str | None, runs: Path
) -> Series:
    """Output of channels of the calibrated unit in an acquisition of a run; remarks on other thermometers."""
    from bench.reduce.output_in_run import other_thermometers, output_in_run
    from bench.reduce.stored_run import open_run
    from bench.store.runs import find_run

    with open_run(find_run(str(run), runs)) as stored:
        remark(*(f"{run.name}: {each}" for each in other_thermometers(stored, known.uut, channels)))
        return output_in_run(stored, known.uut, channels, step)


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
    names = ("--unit", "--counter-bits", "--noise", "--at-start", "--step")
    if wrong := [name for name, is_given in zip(names, given, strict=True) if is_given]:
        raise InputError(f"{wrong[0]}: needs --to acceleration or --to velocity")


def _reduce_case(case: Path, out: Path | None, *, as_json: bool) -> int:
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
            "--to value|nominal|acceleration|velocity",
            "Result: the value of each row, or the output that it would have at the nominal temperature; or specific "
            "force or velocity, from columns t_s, T_C, and for each channel CHANNEL with cumulative counts, or "
            "CHANNEL_pos and CHANNEL_neg, or with samples in volts or codes.",
            choices=("value", "nominal", "acceleration", "velocity"), default="value",
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
        option("--nominal T", 'Temperature of --to nominal, such as "25 °C"; default: that of the calibration.'),
        option("--step STEP", "With a run: the acquisition whose output is converted."),
        RUNS,
    )),
    Command("certificate", certificate, (
        argument("FILE.xml", "A Digital Calibration Certificate (DCC).", to="file", read=Path),
        option("--signed-by FILE.pem", "Certificates in PEM: one of them must have signed it.", read=Path),
        flag("--json", "Print it as JSON.", to="as_json"),
    )),
)  # fmt: skip
