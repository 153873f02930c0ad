"""Effect of the errors of a table on the attitudes of a unit, and on the results (equations 8.1).

Every error is a small rotation of the unit. Zero and harmonics of an axis rotate it about the present direction of the
axis; non-orthogonality of an axis to the one that carries it, in proportion to its rotation; the base as a whole is not
level, and not aligned to north. A rotation r changes a level vector v, as seen by a unit, by v × r.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from bench.metrology.acquisition import Acquisition, Array
from bench.metrology.bench_uncertainty import BenchRecord
from bench.metrology.orientation import cross_matrix, rotation, unit_axes
from bench.metrology.results.budget import BudgetLine, common
from bench.metrology.run_data import UnitUnderTest

EAST, NORTH, UP = np.eye(3)


class Kind(Enum):
    """Kind of an error of the table."""

    ZERO = "zero"
    HARMONICS = "harmonics"
    REPEATABILITY = "repeatability"
    ORTHOGONALITY = "orthogonality"
    LEVEL = "level"
    AZIMUTH = "azimuth"


class Cause(NamedTuple):
    """An error of an axis, or of the fixture."""

    of: str
    kind: Kind

    @property
    def source(self) -> BudgetLine:
        """Its line in a budget, for an effect of 1; findings share it unless it is independent for each attitude."""
        name = f"{self.of}: {self.kind.value}"
        return BudgetLine(name, "B", 1.0) if self.kind is Kind.REPEATABILITY else common(name, 1.0)


@dataclass(frozen=True, slots=True)
class ErrorSource:
    """One error of the table: `u_rad`, and the rotation of the unit in each window, for 1 rad (n, 3).

    Repeatability, which is independent for each window, also has a vector (n, 3).
    """

    cause: Cause
    u_rad: float
    turns: Array

    def seen(self, axes: Array, vector: Array) -> Array:
        """Change of a level vector along the rows of `axes` (n, 3, 3), for 1 rad: (n, 3)."""
        return np.asarray(np.einsum("nij,nj->ni", axes, self.turns @ cross_matrix(vector).T))


@dataclass(frozen=True, slots=True)
class TableErrors:
    """Axes of a unit in the level frame in each of some windows, (n, 3, 3), with every error of the table there."""

    axes: Array
    sources: tuple[ErrorSource, ...]

    def of(self, windows: Sequence[int]) -> TableErrors:
        """The same for some of the windows, by index."""
        chosen = list(windows)
        return TableErrors(self.axes[chosen], tuple(replace(each, turns=each.turns[chosen]) for each in self.sources))

    def without(self, kind: Kind) -> TableErrors:
        """The same but for the errors of one kind."""
        return TableErrors(self.axes, tuple(each for each in self.sources if each.cause.kind is not kind))

    def seen(self, vector: Array, axis: int) -> list[Array]:
        """Change of a level vector along one axis of the unit by each error, for 1 rad: (n,) each."""
        return [source.seen(self.axes, vector)[:, axis] for source in self.sources]

    def propagated(self, effects: Sequence[Array], weights: Array) -> dict[Cause, Array]:
        """Standard uncertainties, by cause, of a result with sensitivities `weights` (n,) to the windows.

        For m results the weights are (m, n), and the uncertainties (m,). `effects` (n,) are the changes of the window's
        reading by each source for 1 rad.
        """
        squares: dict[Cause, Array] = {}
        for source, effect in zip(self.sources, effects, strict=True):
            felt = weights * effect
            fresh = source.cause.kind is Kind.REPEATABILITY
            part = np.linalg.norm(felt, axis=-1) if fresh else np.abs(felt.sum(axis=-1))
            squares[source.cause] = squares.get(source.cause, 0.0) + (part * source.u_rad) ** 2
        return {cause: np.sqrt(square) for cause, square in squares.items()}

    def lines(self, effects: Sequence[Array], weights: Array) -> Iterator[BudgetLine]:
        """The same as lines of a budget, of one result with the weights (n,)."""
        for cause, u in self.propagated(effects, weights).items():
            yield cause.source.times(float(u))


def table_errors(acquisitions: Sequence[Acquisition], unit: UnitUnderTest, bench: BenchRecord) -> TableErrors:
    """Errors of the table over windows (n,)."""
    axes = np.array([unit_axes(acquisition, unit, bench) for acquisition in acquisitions]).reshape(-1, 3, 3)
    return TableErrors(axes, tuple(_sources(acquisitions, bench)))


def _sources(acquisitions: Sequence[Acquisition], bench: BenchRecord) -> list[ErrorSource]:
    """Errors of the table that have an uncertainty."""
    by_window = [list(_rotations(acquisition, bench)) for acquisition in acquisitions]
    return [
        ErrorSource(cause, u_rad, np.array([sources[number][2] for sources in by_window]))
        for number, (cause, u_rad, _) in enumerate(by_window[0] if by_window else ())
        if u_rad
    ]


def _rotations(acquisition: Acquisition, bench: BenchRecord) -> Iterator[tuple[Cause, float, Array]]:
    """Sources in one window: cause, u, rotation for 1 rad in the level frame."""
    carried = np.eye(3)
    for number, (role, axis) in enumerate(bench.axes.items()):
        angle_rad = np.radians(acquisition.angles_deg.get(role, 0.0))
        points = np.array(axis.points)
        now = carried @ points
        own = rotation(points, float(angle_rad))
        yield Cause(role, Kind.ZERO), np.radians(axis.zero_u_deg), now
        for order, u_deg in enumerate(axis.harmonics_u_deg, start=1):
            yield Cause(role, Kind.HARMONICS), np.radians(u_deg), now * np.cos(order * angle_rad)
            yield Cause(role, Kind.HARMONICS), np.radians(u_deg), now * np.sin(order * angle_rad)
        yield Cause(role, Kind.REPEATABILITY), np.radians(axis.repeatability_u_deg), now
        for across in _square_to(axis.points) if number else ():
            apart = carried @ (across - own @ across)
            yield Cause("fixture", Kind.ORTHOGONALITY), np.radians(bench.orthogonality_u_deg), apart
        carried = carried @ own
    for direction in (EAST, NORTH):
        yield Cause("fixture", Kind.LEVEL), np.radians(bench.level_u_deg), direction
    yield Cause("fixture", Kind.AZIMUTH), np.radians(bench.azimuth_u_deg), UP


@lru_cache(maxsize=16)  # for the few axes of a bench
def _square_to(axis: tuple[float, float, float]) -> tuple[Array, Array]:
    least = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(axis, least) / np.linalg.norm(np.cross(axis, least))
    return np.cross(first, axis), first
