"""Corrections from certificates that are added to readings, as stated in the bench file.

A table holds corrections at readings and is interpolated linearly; beyond its ends the end values apply.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, TypeVar

from pydantic import AfterValidator, Field

from drivers.schema.fields import Celsius, Degrees, InUnit, Ratio, StrictModel
from drivers.schema.wording import telling

TURN_DEG = 360.0
ARCSEC_PER_DEG = 3600.0


class AngleCorrection(StrictModel):
    """A row of the table of an axis."""

    at: Degrees = Field(description="indicated angle")
    add: Annotated[float, InUnit("arcsec")] = Field(description="correction to be added to it")


class TemperatureCorrection(StrictModel):
    """A row of the table of a thermometer."""

    at: Celsius = Field(description="indicated temperature")
    add: Annotated[float, InUnit("°C")] = Field(description="correction to be added to it")


class CurrentCorrection(StrictModel):
    """A row of the table of a current source, or of an ammeter."""

    at: Annotated[float, InUnit("A")] = Field(description="set or indicated current")
    add: Annotated[float, InUnit("A")] = Field(description="correction to be added to obtain the true current")


Row = TypeVar("Row", TemperatureCorrection, CurrentCorrection)


def _angles(rows: tuple[AngleCorrection, ...]) -> tuple[AngleCorrection, ...]:
    _rising([(row.at, row.at + row.add / ARCSEC_PER_DEG) for row in rows])
    if rows and rows[-1].at - rows[0].at > TURN_DEG:
        raise telling(f"the rows must lie within one turn, and go from {rows[0].at:g}° to {rows[-1].at:g}°")
    return rows


def _in_one_unit(rows: tuple[Row, ...]) -> tuple[Row, ...]:
    _rising([(row.at, row.at + row.add) for row in rows])
    return rows


def _rising(rows: list[tuple[float, float]]) -> None:
    """Check that readings and corrected readings rise from row to row."""
    for (before, low), (after, high) in pairwise(rows):
        if after <= before:
            raise telling(f"the rows rise, and {after:g} stands after {before:g}")
        if high <= low:
            raise telling(f"the reading {after:g} is corrected to no more than the reading {before:g}")


TemperatureTable = Annotated[tuple[TemperatureCorrection, ...], AfterValidator(_in_one_unit)]
CurrentTable = Annotated[tuple[CurrentCorrection, ...], AfterValidator(_in_one_unit)]
AngleTable = Annotated[tuple[AngleCorrection, ...], AfterValidator(_angles)]


class AxisCorrections(StrictModel):
    """Corrections of an axis, from its certificate."""

    angle: AngleTable = Field((), description="rows of one turn, by rising angle; the same for all turns")


class ClockCorrections(StrictModel):
    """Corrections of a counter's clock, from its certificate."""

    time_base: Annotated[Ratio, InUnit("")] = Field(0.0, description="relative correction of times, such as 0.4 ppm")


class VoltageCorrections(StrictModel):
    """Corrections of a voltmeter in its range, from its certificate."""

    gain: Annotated[Ratio, InUnit("")] = Field(0.0, description="correction relative to the reading, such as -3 ppm")
    offset: Annotated[float, InUnit("V")] = Field(0.0, description="constant correction")


class CurrentCorrections(StrictModel):
    """Corrections of a current source or an ammeter in its range, from its certificate."""

    current: CurrentTable = Field((), description="rows, by rising current")
