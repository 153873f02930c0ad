"""Calibration files as read, for programs that use the unit (such as `bench compensate`)."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from bench.errors import InputError, StoreError
from bench.metrology.calibration.dynamic import SECONDS
from bench.metrology.calibration.response import ResponseCompensation
from bench.metrology.calibration.temperature import Beyond, Compensation
from bench.metrology.least_squares import Array
from bench.metrology.run_data import ReleasedCalibration
from bench.offline.calibration_content import DIGEST, digest_of
from bench.offline.calibration_form import ChannelForm, Known
from bench.offline.case_file import Tolerant, read_json, validated
from bench.offline.csv_record import Table, read_table
from bench.store.runs import SEAL
from bench.store.seal import file_hash, read_seal
from drivers.schema.suggest import did_you_mean

LIMIT_BYTES = 2**24
CHANNEL, TEMPERATURE, OUTPUT, FREQUENCY, PHASE = "channel", "T_C", "output", "f_Hz", "phase_deg"
RATE = "dT_dt_C_per_min"
ADDED = ("value", "extrapolated")
ADDED_PHASE = "value_phase_deg"


class CalibrationFile(Tolerant):
    """A calibration file as read, without its entries for people."""

    schema_: Literal["itb-calibration/1"] = Field(alias="schema")
    uut: str
    verdict: str = ""
    simulated: bool = False
    run: str = ""
    gravity_mps2: float = math.nan
    u_gravity_mps2: float = 0.0
    channels: Annotated[tuple[ChannelForm, ...], Field(min_length=1)]

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
    if isinstance(content, dict) and DIGEST in content and content[DIGEST] != digest_of(content):
        raise InputError(
            f"{path.name}: was edited after a run had written it: its digest is not that of its content. Copy it again "
            f"from the run {content.get('run', '')}".rstrip()
        )
    return validated(CalibrationFile, content, f"{path.name}: ")


def compensated(calibration: CalibrationFile, data: Path, beyond: Beyond) -> str:
    """Add two columns to a CSV file with the columns `T_C`, `output` and, for several channels, `channel`.

    `value` is blank for missing data, `extrapolated` is 1 beyond the range of the calibration. With a column
    `dT_dt_C_per_min` the dynamic model of a bias is used, if the calibration has one. A response needs the
    column `f_Hz` in place of `T_C`; outputs are amplitudes then, and a column `phase_deg` gets another one,
    `value_phase_deg`. Rows and columns are otherwise unchanged. Raises InputError.
    """
    known = calibration.compensations()
    of_response = [each for each in known.values() if isinstance(each, ResponseCompensation)]
    warm = [each for each in known.values() if isinstance(each, Compensation) and each.valid_c is not None]
    needed = [*([TEMPERATURE] if warm else []), *([FREQUENCY] if of_response else []), OUTPUT]
    by_rate = [RATE] if any(isinstance(each, Compensation) and each.dynamic for each in known.values()) else []
    table = read_table(data, needed, optional=(CHANNEL, *([PHASE] if of_response else []), *by_rate))
    value, phase_deg, outside = _values(known, table, beyond)
    added: dict[str, Array | NDArray[np.bool_]] = dict(zip(ADDED, (value, outside), strict=True))
    if of_response and PHASE in {name.strip() for name in next(csv.reader(io.StringIO(table.text)))}:
        added[ADDED_PHASE] = phase_deg
    return with_columns(table, added)


def with_columns(table: Table, added: Mapping[str, Array | NDArray[np.bool_]]) -> str:
    """The text of a CSV file with more columns (n,), NaN as a blank. Raises InputError if it has one already."""
    rows = list(csv.reader(io.StringIO(table.text, newline="")))
    header, cells = rows[0], [row for row in rows[1:] if row]
    if clash := sorted(set(added) & {name.strip() for name in header}):
        raise InputError(f"{table.file}: has a column '{clash[0]}' already; rename it")
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*header, *added])
    for row, *found in zip(cells, *(values.tolist() for values in added.values()), strict=True):
        writer.writerow([*row, *(_cell(each) for each in found)])
    return text.getvalue()


def _cell(value: float | bool) -> str:
    if isinstance(value, bool):
        return str(int(value))
    return "" if math.isnan(value) else repr(value)


def rows_by_channel(known: Mapping[str, Known], table: Table) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    """Channels of a file with masks of their rows (n,). Raises InputError for one that the calibration lacks."""
    # A channel of M0 has an entry in g beside its rates: a row without a channel is then of its only rate.
    referred = [name for name, each in known.items() if each.output_unit == each.value_unit] or [*known]
    alone = referred[0] if len(referred) == 1 else ""
    names = np.array([name.strip() or alone for name in table.columns[CHANNEL]], dtype=np.str_)
    for name in np.unique(names).tolist():
        if name not in known:
            what = f"there is no channel '{name}'{did_you_mean(name, known)}" if name else "a row has no channel"
            raise InputError(f"{table.file}: {what}; the calibration has {', '.join(known)}")
        yield name, names == name


def _values(known: Mapping[str, Known], table: Table, beyond: Beyond) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Value and phase of each row, and whether it is extrapolated."""
    output = table.numbers(OUTPUT)
    temperature_c, frequency_hz, phase_deg, c_per_min = (
        table.numbers(name) if name in table.columns else np.full(len(output), np.nan)
        for name in (TEMPERATURE, FREQUENCY, PHASE, RATE)
    )
    value, phase = np.full(len(output), np.nan), np.full(len(output), np.nan)
    outside = np.zeros(len(output), dtype=np.bool_)
    for name, of_channel in rows_by_channel(known, table):
        how = known[name]
        if isinstance(how, ResponseCompensation):
            value[of_channel], phase[of_channel], outside[of_channel] = how.apply(
                output[of_channel], phase_deg[of_channel], frequency_hz[of_channel], beyond
            )
        elif how.dynamic is not None and np.isfinite(c_per_min).any():
            value[of_channel], outside[of_channel] = how.apply_at_rate(
                output[of_channel], temperature_c[of_channel], c_per_min[of_channel] / SECONDS, beyond
            )
        else:
            value[of_channel], outside[of_channel] = how.apply(output[of_channel], temperature_c[of_channel], beyond)
    return value, phase, outside
