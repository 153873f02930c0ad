"""Corrections of readings by certificates, in one place for each quantity.

Stored data remain uncorrected, and soaks, waits, interlocks and single measurements use uncorrected readings: only the
reduction of a run corrects. Tables are linear between their rows, and constant beyond them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bench.config.devices import Calibration
from bench.config.models import BenchFile
from bench.figures.languages import tr
from bench.metrology.acquisition import Array, Counts, Currents, Voltages
from bench.store.reader import Series
from drivers.certificates.corrections import (
    ARCSEC_PER_DEG,
    TURN_DEG,
    AxisCorrections,
    ClockCorrections,
    CurrentCorrections,
    VoltageCorrections,
)

if TYPE_CHECKING:  # a run starts without loading what only its results need
    from bench.metrology.run_data import RunData

MA_PER_A, NA_PER_MA = 1e3, 1e6


@dataclass(frozen=True)
class Table:
    """Correction table: values to `add` at readings `at`, both in one unit, (n,)."""

    at: Array
    add: Array

    def corrected(self, values: Array) -> Array:
        """Readings with the correction added."""
        return values + np.interp(values, self.at, self.add)

    def within_its_turn(self, angle_deg: Array) -> Array:
        """Angles shifted by whole turns into the turn that begins with the first row."""
        return np.asarray(self.at[0] + (angle_deg - self.at[0]) % TURN_DEG)


class Corrections(NamedTuple):
    """Corrections of a bench, by the names of thermometers' readings and the roles of devices; only non-zero ones."""

    thermometers: Mapping[str, Table]
    axes: Mapping[str, Table]
    clocks: Mapping[str, float]
    voltmeters: Mapping[str, VoltageCorrections]
    currents: Mapping[str, Table]

    def temperatures(self, series: Series) -> Series:
        """A named reading, corrected if it is that of a thermometer with a table."""
        table = self.thermometers.get(series.name)
        return series if table is None else series._replace(values=table.corrected(series.values))

    def angle_deg(self, role: str, read_deg: float) -> float:
        """Corrected angle of an axis."""
        table = self.axes.get(role)
        if table is None:
            return read_deg
        within = table.within_its_turn(np.array(read_deg))
        return read_deg + float(np.interp(within, table.at, table.add))

    def counts(self, role: str, counts: Counts) -> Counts:
        """Counts of a counter with the corrected period of its clock."""
        relative = self.clocks.get(role, 0.0)
        return replace(counts, tick_period_s=counts.tick_period_s * (1 + relative)) if relative else counts

    def voltages(self, role: str, read: Voltages) -> Voltages:
        """Corrected readings of a voltmeter."""
        known = self.voltmeters.get(role)
        if known is None:
            return read
        return read._replace(values_v=read.values_v * (1 + known.gain) + known.offset)

    def current_a(self, role: str, read_a: float) -> float:
        """Corrected current of a source with this read-back."""
        table = self.currents.get(role)
        return read_a if table is None else float(table.corrected(np.array(read_a)))

    def measured(self, role: str, read: Currents) -> Currents:
        """Corrected readings of an ammeter."""
        table = self.currents.get(role)
        return read if table is None else read._replace(values_a=table.corrected(read.values_a))


def corrections_of(bench: BenchFile) -> Corrections:
    """Corrections by the certificates of a bench file."""
    stated = {role: entry.calibration.corrections for role, entry in bench.devices.items() if entry.calibration}
    return Corrections(
        thermometers={
            name: _table([(row.at, row.add) for row in reading.calibration.corrections])
            for name, reading in bench.readings.items()
            if reading.calibration is not None and reading.calibration.corrections
        },
        axes={
            role: _table([(row.at, row.add / ARCSEC_PER_DEG) for row in found.angle])
            for role, found in stated.items()
            if isinstance(found, AxisCorrections) and found.angle
        },
        clocks={role: found.time_base for role, found in stated.items() if isinstance(found, ClockCorrections)},
        voltmeters={role: found for role, found in stated.items() if isinstance(found, VoltageCorrections)},
        currents={
            role: _table([(row.at, row.add) for row in found.current])
            for role, found in stated.items()
            if isinstance(found, CurrentCorrections) and found.current
        },
    )


def _table(rows: list[tuple[float, float]]) -> Table:
    at, add = np.array(rows).T
    return Table(at, add)


def correction_lines(bench: BenchFile, data: list[RunData]) -> Iterator[str]:
    """A line for each corrected instrument, with a warning if its table does not cover the readings in `data`."""
    known = corrections_of(bench)
    for name, table in known.thermometers.items():
        read = [each.temperatures_c[name] for part in data for each in part.acquisitions if name in each.temperatures_c]
        yield _line(name, bench.readings[name].calibration, _rows(table, 1.0, "°C", "°C"), _beyond(table, read, "°C"))
    for role, table in known.axes.items():
        angles = [each.angles_deg[role] for part in data for each in part.acquisitions if role in each.angles_deg]
        beyond = _beyond(table, [table.within_its_turn(np.array(angles))], "°")
        yield _line(role, bench.devices[role].calibration, _rows(table, ARCSEC_PER_DEG, "arcsec", "°"), beyond)
    for role, table in known.currents.items():
        read_a = [each.sources_set_a[role] for part in data for each in part.acquisitions if role in each.sources_set_a]
        read_a += [
            value
            for part in data
            for each in part.acquisitions
            if role in each.currents
            for value in each.currents[role].values_a.tolist()
        ]
        if read_a:
            table_ma = Table(table.at * MA_PER_A, table.add * MA_PER_A)
            beyond = _beyond(table_ma, [np.array(read_a) * MA_PER_A], "mA")
            yield _line(role, bench.devices[role].calibration, _rows(table_ma, NA_PER_MA, "nA", "mA"), beyond)
    for role, relative in known.clocks.items():
        if relative:
            yield _line(role, bench.devices[role].calibration, f"{relative * 1e6:+g} ppm")
    for role, found in known.voltmeters.items():
        if found.gain or found.offset:
            both = f"{found.gain * 1e6:+g} ppm, {found.offset * 1e6:+g} µV"
            yield _line(role, bench.devices[role].calibration, both)


def _rows(table: Table, factor: float, unit: str, at_unit: str) -> str:
    rows = [
        tr("{add} at {at}", add=f"{add * factor:+.6g} {unit}", at=f"{at:g}{'' if at_unit == '°' else ' '}{at_unit}")
        for at, add in zip(table.at, table.add, strict=True)
    ]
    return ", ".join(rows)


def _beyond(table: Table, read: list[Array], unit: str) -> str:
    """Warning about readings outside a table."""
    values = np.concatenate([np.zeros(0), *read])
    low, high = float(table.at[0]), float(table.at[-1])
    values = values[np.isfinite(values)]
    outside = (values + 1e-9 < low) | (values - 1e-9 > high)
    if not outside.any():
        return ""
    return tr(
        "The run has readings from {least} to {most} {unit}, outside the table: there its end values were used.",
        least=f"{values.min():.6g}", most=f"{values.max():.6g}", unit=unit,
    )  # fmt: skip


def _line(name: str, calibration: Calibration | None, what: str, beyond: str = "") -> str:
    number = calibration.certificate if calibration is not None else ""
    text = tr("{name}: corrected by {what} (certificate {number}).", name=name, what=what, number=number)
    return f"{text} {beyond}".strip()
