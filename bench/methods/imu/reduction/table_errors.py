"""What the errors of a table do to the attitudes of a unit, and so to what is worked out from them (equations 8.1).

Every error is a small rotation of the unit. The zero and the harmonics of an axis turn it about where the axis then
points; an axis that is not square to the one that carries it, in proportion to how far it has turned; the base as a
whole is not level, and not aligned to north. A rotation r changes a level vector v, as a unit sees it, by v × r.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from bench.metrology.acquisition import Acquisition, Array
from bench.metrology.bench_uncertainty import BenchRecord
from bench.metrology.orientation import unit_axes
from bench.metrology.results.budget import BudgetLine
from bench.metrology.run_data import UnitUnderTest

EAST, NORTH, UP = np.eye(3)


class Kind(Enum):
    """What an error of the table is."""

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
    def name(self) -> str:
        """Its name in a budget."""
        return f"{self.of}: {self.kind.value}"

    @property
    def shared(self) -> str | None:
        """What findings share by it; what is drawn anew for each attitude is common to nothing."""
        return None if self.kind is Kind.REPEATABILITY else f"{self.of}.{self.kind.value}"


@dataclass(frozen=True, slots=True)
class ErrorSource:
    """One error of the table: `u_rad`, and in each of the windows what it turns the unit by, for 1 rad (n, 3).

    Repeatability, which is drawn anew for each window, has a vector (n, 3) all the same.
    """

    cause: Cause
    u_rad: float
    turns: Array

    def seen(self, axes: Array, vector: Array) -> Array:
        """What a level vector changes by along the rows of `axes` (n, 3, 3), for 1 rad: (n, 3)."""
        return np.asarray(np.einsum("nij,nj->ni", axes, self.turns @ _crossing(vector).T))


@dataclass(frozen=True, slots=True)
class TableErrors:
    """The axes of a unit in the level frame in each of some windows, (n, 3, 3), and every error of the table there."""

    axes: Array
    sources: tuple[ErrorSource, ...]

    def of(self, windows: Sequence[int]) -> TableErrors:
        """The same of some of the windows, by their numbers."""
        chosen = list(windows)
        return TableErrors(self.axes[chosen], tuple(replace(each, turns=each.turns[chosen]) for each in self.sources))

    def without(self, kind: Kind) -> TableErrors:
        """The same but for the errors of one kind."""
        return TableErrors(self.axes, tuple(each for each in self.sources if each.cause.kind is not kind))

    def seen(self, vector: Array, axis: int) -> list[Array]:
        """What each error changes a level vector by along one axis of the unit, for 1 rad: (n,) each."""
        return [source.seen(self.axes, vector)[:, axis] for source in self.sources]

    def propagated(self, effects: Sequence[Array], weights: Array) -> dict[Cause, Array]:
        """The standard uncertainties by cause, of what depends on the windows by `weights` (n,).

        Of several such things the weights are (m, n), and so many are the uncertainties. `effects` (n,) are what each
        source changes the window's reading by for 1 rad.
        """
        squares: dict[Cause, Array] = {}
        for source, effect in zip(self.sources, effects, strict=True):
            felt = weights * effect
            fresh = source.cause.kind is Kind.REPEATABILITY
            part = np.linalg.norm(felt, axis=-1) if fresh else np.abs(felt.sum(axis=-1))
            squares[source.cause] = squares.get(source.cause, 0.0) + (part * source.u_rad) ** 2
        return {cause: np.sqrt(square) for cause, square in squares.items()}

    def lines(self, effects: Sequence[Array], weights: Array) -> Iterator[BudgetLine]:
        """The same as lines of a budget, of one thing with the weights (n,)."""
        for cause, u in self.propagated(effects, weights).items():
            yield BudgetLine(cause.name, "B", float(u), None, cause.shared)


def table_errors(acquisitions: Sequence[Acquisition], unit: UnitUnderTest, bench: BenchRecord) -> TableErrors:
    """The errors of the table over windows (n,)."""
    axes = np.array([unit_axes(acquisition, unit, bench) for acquisition in acquisitions]).reshape(-1, 3, 3)
    return TableErrors(axes, tuple(_sources(acquisitions, bench)))


def _sources(acquisitions: Sequence[Acquisition], bench: BenchRecord) -> list[ErrorSource]:
    """Every error of the table that has an uncertainty."""
    by_window = [list(_rotations(acquisition, bench)) for acquisition in acquisitions]
    return [
        ErrorSource(cause, u_rad, np.array([sources[number][2] for sources in by_window]))
        for number, (cause, u_rad, _) in enumerate(by_window[0] if by_window else ())
        if u_rad
    ]


def _rotations(acquisition: Acquisition, bench: BenchRecord) -> Iterator[tuple[Cause, float, Array]]:
    """The sources in one window: cause, u, rotation for 1 rad in the level frame."""
    carried = np.eye(3)
    for number, (role, axis) in enumerate(bench.axes.items()):
        angle_rad = np.radians(acquisition.angles_deg.get(role, 0.0))
        points = np.array(axis.points)
        now = carried @ points
        own = _turn(points, float(angle_rad))
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


@lru_cache(maxsize=16)  # of the few axes of a bench
def _square_to(axis: tuple[float, float, float]) -> tuple[Array, Array]:
    least = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(axis, least) / np.linalg.norm(np.cross(axis, least))
    return np.cross(first, axis), first


def _turn(axis: Array, angle_rad: float) -> Array:
    """What turns a vector about a unit vector, after Rodrigues, (3, 3)."""
    cross = _crossing(axis)
    return np.asarray(np.eye(3) + math.sin(angle_rad) * cross + (1 - math.cos(angle_rad)) * (cross @ cross))


def _crossing(vector: Array) -> Array:
    """What makes the product vector × r of any r, (3, 3)."""
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
