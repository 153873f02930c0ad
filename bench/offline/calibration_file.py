"""Calibration files: results of a run on a unit, for programs that use the unit (such as `bench compensate`)."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Discriminator, Field, Tag, model_validator

from bench.config.models import BenchFile
from bench.errors import InputError, StoreError
from bench.files import content_hash
from bench.metrology.calibration.linearity import RELATIVE, Linearity
from bench.metrology.calibration.response import ResponseCompensation
from bench.metrology.calibration.second_order import NAMES
from bench.metrology.calibration.temperature import Beyond, Compensation
from bench.metrology.least_squares import Array
from bench.metrology.results.curves import Constant, KnotModel, TemperatureModel
from bench.metrology.results.finding import UnitResult
from bench.metrology.run_data import ReleasedCalibration
from bench.offline.case_file import Tolerant, read_json, validated
from bench.offline.csv_record import Table, read_table
from bench.store.runs import SEAL
from bench.store.seal import file_hash, read_seal
from drivers.schema.suggest import did_you_mean
from drivers.schema.wording import telling

SCHEMA, DIGEST = "itb-calibration/1", "digest"
LIMIT_BYTES = 2**24
SAME_CURVE = 1e-9  # of the sum of the magnitudes of its terms
CHANNEL, TEMPERATURE, OUTPUT, FREQUENCY, PHASE = "channel", "T_C", "output", "f_Hz", "phase_deg"
ADDED = ("value", "extrapolated")
ADDED_PHASE = "value_phase_deg"
Known = Compensation | ResponseCompensation


def calibration_files(
    units: Sequence[UnitResult], manifest: Mapping[str, Any], bench: BenchFile
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Name and content of a file for each unit with compensations.

    1 g in it is the local gravity of the bench, which it states.
    """
    gravity = bench.site.gravity
    for place in dict.fromkeys(unit.place for unit in units):
        found = [unit for unit in units if unit.place == place]
        channels = [each.to_json() for unit in found for each in unit.compensations]
        if channels:
            content = {
                "schema": SCHEMA,
                "uut": found[0].uut,
                "run": manifest["run"],
                "sequence": manifest["sequence"],
                "started": manifest["started"],
                "simulated": bool(manifest["simulated"]),
                "verdict": next((u.verdict for u in found if u.verdict != "PASS"), "PASS"),
                "gravity_mps2": gravity.value,
                "u_gravity_mps2": gravity.U / gravity.k,
                "channels": channels,
            }
            yield f"calibration_{place}.json", {**content, DIGEST: _digest_of(content)}


def _digest_of(content: Mapping[str, Any]) -> str:
    """Digest of all other content of a file, independent of indentation and order."""
    text = json.dumps({key: value for key, value in content.items() if key != DIGEST}, sort_keys=True)
    return content_hash(text.encode())


class _Polynomial(Tolerant):
    unit: str
    centre: float
    scale: float = Field(gt=0)
    coefficients: tuple[float, ...] = Field(min_length=1)
    valid_c: tuple[float, float]
    powers_of_t: tuple[float, ...] | None = Field(None, alias="powers_of_T")

    @model_validator(mode="after")
    def _is_one_curve(self) -> Self:
        """Check that both forms of a curve in the file agree; an edited one was not measured."""
        if not self.powers_of_t:
            return self
        at_c = np.linspace(self.centre - self.scale, self.centre + self.scale, 1 + len(self.coefficients))
        powers = np.polynomial.polynomial.polyval(at_c, self.powers_of_t)
        curve = np.polynomial.polynomial.polyval((at_c - self.centre) / self.scale, self.coefficients)
        size = np.abs(self.powers_of_t) @ np.max(np.abs(at_c)) ** np.arange(len(self.powers_of_t))
        if not np.allclose(powers, curve, rtol=0, atol=SAME_CURVE * size):
            raise telling("coefficients and powers_of_T are not the same curve: the file was edited")
        return self

    def curve(self) -> TemperatureModel:
        return TemperatureModel("", "", "", self.unit, self.centre, self.scale, self.coefficients, valid_c=self.valid_c)


class _Knots(Tolerant):
    unit: str
    knots_c: tuple[float, ...] = Field(min_length=1)
    values: tuple[float, ...] = Field(min_length=1)

    def curve(self) -> KnotModel:
        return KnotModel("", "", "", self.unit, self.knots_c, self.values, ())


class _Constant(Tolerant):
    unit: str
    value: float

    def curve(self) -> Constant:
        return Constant(self.value, self.unit)


def _kind(raw: Any) -> str:
    """Kind of a curve, by a key that only this kind has."""
    keys = {"coefficients": "polynomial", "knots_c": "knots"} if isinstance(raw, dict) else {}
    return next((kind for key, kind in keys.items() if key in raw), "constant")


_Curve = Annotated[
    Annotated[_Polynomial, Tag("polynomial")] | Annotated[_Knots, Tag("knots")] | Annotated[_Constant, Tag("constant")],
    Discriminator(_kind),
]


class _Linearity(Tolerant):
    full_scale: float = Field(gt=0)
    scale_error: _Constant | None = None
    asymmetry: _Constant | None = None
    quadratic: _Constant | None = None
    cubic: _Constant | None = None
    valid: tuple[float, float]

    def linearity(self) -> Linearity:
        given = {name: each.value for name in RELATIVE if (each := getattr(self, name)) is not None}
        return Linearity(given, {}, (), self.full_scale, self.valid)


class _Response(Tolerant):
    K: _Constant
    f0: _Constant
    damping: _Constant
    delay: _Constant
    valid_hz: tuple[float, float]


class _Channel(Tolerant):
    channel: str
    output: str
    value: str
    scale: _Curve
    offset: _Curve | None = None
    bias: _Curve | None = None
    linearity: _Linearity | None = None
    response: _Response | None = None

    def compensation(self) -> Known:
        scale = self.scale.curve()
        if self.response is not None and isinstance(scale, Constant):
            constants = {name: getattr(self.response, name).curve() for name in NAMES}
            valid_hz = self.response.valid_hz
            return ResponseCompensation(self.channel, self.output, self.value, scale, constants, valid_hz)
        offset, bias = (None if each is None else each.curve() for each in (self.offset, self.bias))
        linearity = None if self.linearity is None else self.linearity.linearity()
        return Compensation(self.channel, self.output, self.value, scale, offset, bias, linearity)


class CalibrationFile(Tolerant):
    """A calibration file as read, without its entries for people."""

    schema_: Literal["itb-calibration/1"] = Field(alias="schema")
    uut: str
    verdict: str = ""
    simulated: bool = False
    run: str = ""
    gravity_mps2: float = math.nan
    u_gravity_mps2: float = 0.0
    channels: Annotated[tuple[_Channel, ...], Field(min_length=1)]

    @property
    def warnings(self) -> list[str]:
        """Warnings for the user of the calibration."""
        found = ["it comes from a simulated run and describes no real unit"] if self.simulated else []
        return found if self.verdict in ("", "PASS") else [*found, f"the unit's verdict in that run is {self.verdict}"]

    @property
    def valid_c(self) -> tuple[float, float]:
        """Temperature range in which all its channels are known."""
        ends = [each.valid_c for each in self.over_temperature().values() if each.valid_c is not None]
        return max((low for low, _ in ends), default=-math.inf), min((high for _, high in ends), default=math.inf)

    def released(self) -> ReleasedCalibration:
        """Released calibration for a run that verifies the unit by it."""
        return ReleasedCalibration(self.over_temperature(), self.gravity_mps2, self.u_gravity_mps2)

    def over_temperature(self) -> dict[str, Compensation]:
        """Compensations over temperature, not over frequency."""
        return {name: known for name, known in self.compensations().items() if isinstance(known, Compensation)}

    def compensations(self) -> dict[str, Known]:
        """Compensation of each channel."""
        return {channel.channel: channel.compensation() for channel in self.channels}


def read_calibration(path: Path) -> CalibrationFile:
    """Read the calibration in a file; InputError names every problem with its place, also for an edited copy.

    StoreError if it belongs to a sealed run and has changed since.
    """
    if (path.parent / SEAL).exists():
        written = read_seal(path.parent).files.get(path.name)
        if written is not None and path.is_file() and file_hash(path) != written:
            raise StoreError(f"{path}: has changed since it was written; 'bench runs verify {path.parent}' has more")
    content = read_json(path, LIMIT_BYTES)
    if isinstance(content, dict) and DIGEST in content and content[DIGEST] != _digest_of(content):
        raise InputError(
            f"{path.name}: was edited after a run had written it: its digest is not that of its content. Copy it again "
            f"from the run {content.get('run', '')}".rstrip()
        )
    return validated(CalibrationFile, content, f"{path.name}: ")


def compensated(calibration: CalibrationFile, data: Path, beyond: Beyond) -> str:
    """Add two columns to a CSV file with the columns `T_C`, `output` and, for several channels, `channel`.

    `value` is blank for missing data, `extrapolated` is 1 beyond the range of the calibration. A response needs the
    column `f_Hz` in place of `T_C`; outputs are amplitudes then, and a column `phase_deg` gets another one,
    `value_phase_deg`. Rows and columns are otherwise unchanged. Raises InputError.
    """
    known = calibration.compensations()
    of_response = [each for each in known.values() if isinstance(each, ResponseCompensation)]
    warm = [each for each in known.values() if isinstance(each, Compensation) and each.valid_c is not None]
    needed = [*([TEMPERATURE] if warm else []), *([FREQUENCY] if of_response else []), OUTPUT]
    table = read_table(data, needed, optional=(CHANNEL, *([PHASE] if of_response else [])))
    rows = list(csv.reader(io.StringIO(table.text, newline="")))
    header, cells = rows[0], [row for row in rows[1:] if row]
    there = {name.strip() for name in header}
    added = (*ADDED, ADDED_PHASE) if of_response and PHASE in there else ADDED
    if clash := sorted(set(added) & there):
        raise InputError(f"{data.name}: has a column '{clash[0]}' already; rename it")
    value, phase_deg, outside = _values(known, table, beyond)
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*header, *added])
    for row, *found, is_outside in zip(cells, value.tolist(), phase_deg.tolist(), outside.tolist(), strict=True):
        each, phase = ("" if number != number else repr(number) for number in found)
        writer.writerow([*row, each, int(is_outside), phase][: len(row) + len(added)])
    return text.getvalue()


def _values(known: Mapping[str, Known], table: Table, beyond: Beyond) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Value and phase of each row, and whether it is extrapolated."""
    output = table.numbers(OUTPUT)
    temperature_c, frequency_hz, phase_deg = (
        table.numbers(name) if name in table.columns else np.full(len(output), np.nan)
        for name in (TEMPERATURE, FREQUENCY, PHASE)
    )
    alone = next(iter(known)) if len(known) == 1 else ""
    names = np.array([name.strip() or alone for name in table.columns[CHANNEL]], dtype=np.str_)
    value, phase = np.full(len(output), np.nan), np.full(len(output), np.nan)
    outside = np.zeros(len(output), dtype=np.bool_)
    for name in np.unique(names).tolist():
        if name not in known:
            what = f"there is no channel '{name}'{did_you_mean(name, known)}" if name else "a row has no channel"
            raise InputError(f"{table.file}: {what}; the calibration has {', '.join(known)}")
        of_channel, how = names == name, known[name]
        if isinstance(how, ResponseCompensation):
            value[of_channel], phase[of_channel], outside[of_channel] = how.apply(
                output[of_channel], phase_deg[of_channel], frequency_hz[of_channel], beyond
            )
        else:
            value[of_channel], outside[of_channel] = how.apply(output[of_channel], temperature_c[of_channel], beyond)
    return value, phase, outside
