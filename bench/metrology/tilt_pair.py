"""Error of a tilt by two compensated accelerometers at right angles, over temperature (6.4).

The error of the tilt is that which both indicate less that of the head. A constant error of the head or of the level is
removed, as an object is set to zero once. Readings may be converted in several ways: by constants, by the curves of the
calibrations, by their dynamic models.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from bench.metrology.bench_uncertainty import TiltPairRecord
from bench.metrology.extremes import interval_of_largest, interval_of_span, largest_u, span_u
from bench.metrology.least_squares import Array
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import Finding, Subject, UnitResult
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.metrology.tilt import TiltAxis, tilt_of_two
from bench.metrology.tilt_findings import SCATTER, SELECTION

RIGHT_ANGLE_DEG, WITHIN_DEG = 90.0, 2.0
SKEW = "skew between the input axes"
Of = TypeVar("Of")
CONSTANT, STATIC, DYNAMIC = "constant", "static", "dynamic"
SPANS = {
    CONSTANT: ("tilt_of_two/uncompensated", "span over the temperatures of the tilt by both, with constants"),
    STATIC: ("tilt_of_two/verified", "the same with the calibrations of earlier runs"),
    DYNAMIC: ("tilt_of_two/verified_dynamic", "the same with the dynamic models of these calibrations"),
}
LARGEST = {
    STATIC: ("tilt_of_two/left_largest", "largest error of the tilt by both, set to zero where it is level"),
    DYNAMIC: ("tilt_of_two/left_largest_dynamic", "the same with the dynamic models of the calibrations"),
}


class PairReadings(NamedTuple):
    """Specific forces (n,) along both axes, by way of conversion, and by how much `along` is raised beside its angle.

    The last is in rad, (n,).
    """

    along_g: Mapping[str, Array]
    across_g: Mapping[str, Array]
    raised_rad: Array


@dataclass(frozen=True)
class TiltOfTwo:
    """Readings of two accelerometers at nominal angles of `along` above the horizontal, (n,).

    `changed` are readings with the error of a source of uncertainty added, several for one source with independent
    errors. `own_u_g` are the standard uncertainties (n,) of both forces by errors of their own, `turned_u_rad` that of
    each angle. `skew` is the finding that the skew of the pair is from, if the run determines it.
    """

    subject: Subject
    pair: TiltPairRecord
    steps: tuple[str, ...]
    angle_rad: Array
    readings: PairReadings
    changed: Sequence[tuple[BudgetLine, PairReadings]]
    own_u_g: tuple[Array, Array]
    turned_u_rad: Array
    skew: Finding | None = None

    def findings(self) -> Iterator[Finding]:
        """Spans at one position by each way of conversion, then the largest errors over all positions."""
        for way in self.readings.along_g:
            yield self._span(way)
        for way in (way for way in self.readings.along_g if way in LARGEST):
            yield self._largest(way)
        if self.skew is not None:
            yield self.skew

    def error_deg(self, way: str, readings: PairReadings, skew_rad: float) -> Array:
        """Indicated tilt less that of the head (n,)."""
        one = TiltAxis(1.0, 0.0, 0.0, 0.0, 0.0)
        found = tilt_of_two(one, one, readings.along_g[way], readings.across_g[way], skew_rad=skew_rad, u_skew_rad=0.0)
        away_deg = found.tilt_deg - np.degrees(self.angle_rad + readings.raised_rad)
        return np.asarray(np.mod(away_deg + 180.0, 360.0) - 180.0)

    @property
    def positions(self) -> NDArray[np.int_]:
        """Number of the position of each reading, (n,)."""
        turn_deg = np.round(np.degrees(self.angle_rad), 1) % 360.0
        return np.asarray(np.unique(turn_deg, return_inverse=True)[1])

    @property
    def _is_level(self) -> NDArray[np.bool_]:
        """Readings (n,) at the position at which `along` is nearest to level, the right way up."""
        away = np.abs(np.angle(np.exp(1j * self.angle_rad)))
        return np.asarray(self.positions == self.positions[int(np.argmin(away))])

    def sd_deg(self) -> Array:
        """Standard deviation (n,) of the error of each reading, independent of the others."""
        along, across = self.readings.along_g[STATIC], self.readings.across_g[STATIC]
        size = np.hypot(along, across)
        by_forces = np.hypot(across * self.own_u_g[0], along * self.own_u_g[1]) / size**2
        return np.asarray(np.degrees(np.hypot(by_forces, self.turned_u_rad)))

    def _span(self, way: str) -> Finding:
        error_deg = self.error_deg(way, self.readings, self.pair.skew_rad)
        worst = self._widest(error_deg)
        here, sd_deg = error_deg[worst], float(np.mean(self.sd_deg()[worst]))
        by_scatter, by_selection = span_u(here, sd_deg)
        lines = self._common(way, self._figure_of_span)
        quantity, name = SPANS[way]
        return self.subject.finding(
            quantity, name, float(np.ptp(here)), "°",
            [BudgetLine(SCATTER, "A", by_scatter), BudgetLine(SELECTION, "A", by_selection), *lines],
            self._at(int(np.flatnonzero(worst)[0])), self.steps,
            interval=interval_of_span(here, sd_deg).beside(math.hypot(*(line.u for line in lines))),
        )  # fmt: skip

    def _widest(self, error_deg: Array) -> NDArray[np.bool_]:
        """Readings (n,) at the position with the largest span."""
        positions = self.positions
        spans = [float(np.ptp(error_deg[positions == each])) for each in range(int(positions.max()) + 1)]
        return np.asarray(positions == int(np.argmax(spans)))

    def _figure_of_span(self, error_deg: Array) -> float:
        return float(np.ptp(error_deg[self._widest(error_deg)]))

    def _largest(self, way: str) -> Finding:
        left_deg = self._zeroed(self.error_deg(way, self.readings, self.pair.skew_rad))
        sd_deg, worst = self.sd_deg(), int(np.argmax(np.abs(left_deg)))
        by_scatter, by_selection = largest_u(left_deg, float(np.mean(sd_deg)))
        lines = self._common(way, lambda error_deg: float(np.max(np.abs(self._zeroed(error_deg)))))
        quantity, name = LARGEST[way]
        return self.subject.finding(
            quantity, name, float(abs(left_deg[worst])), "°",
            [BudgetLine(SCATTER, "A", by_scatter), BudgetLine(SELECTION, "A", by_selection), *lines],
            self._at(worst), self.steps,
            interval=interval_of_largest(left_deg, sd_deg).beside(math.hypot(*(line.u for line in lines))),
        )  # fmt: skip

    def _zeroed(self, error_deg: Array) -> Array:
        return np.asarray(error_deg - np.mean(error_deg[self._is_level]))

    def _at(self, index: int) -> dict[str, object]:
        return {"across": self.pair.across, "position_deg": float(round(math.degrees(self.angle_rad[index]), 4))}

    def _common(self, way: str, figure: Callable[[Array], float]) -> list[BudgetLine]:
        """Contributions of errors that readings have in common, and of the skew, to a figure of the errors (n,)."""
        skew_rad, found = self.pair.skew_rad, figure(self.error_deg(way, self.readings, self.pair.skew_rad))
        squares: dict[BudgetLine, float] = {}
        for line, readings in self.changed:
            apart = figure(self.error_deg(way, readings, skew_rad)) - found
            squares[line] = squares.get(line, 0.0) + apart**2
        skewed = (figure(self.error_deg(way, self.readings, skew_rad + s * self.pair.skew_u_rad)) for s in (1, -1))
        lines = [line._replace(u=math.sqrt(square)) for line, square in squares.items()]
        return [*lines, BudgetLine(SKEW, "B", max(abs(each - found) for each in skewed))]


def is_square(along_rad: float, across_rad: float) -> bool:
    """True if the second axis is up where the first is level, by their angles above the horizontal."""
    apart_deg = math.degrees(math.remainder(across_rad - along_rad, 2 * math.pi))
    return abs(apart_deg - RIGHT_ANGLE_DEG) < WITHIN_DEG


Together = Callable[[RunData, TiltPairRecord, tuple[UnitUnderTest, UnitUnderTest], tuple[Of, Of]], TiltOfTwo | None]
"""Function that brings together what is reduced of both units of a pair."""


def with_pairs(
    data: RunData, reduced: Sequence[tuple[UnitResult, Of | None]], tilt_of: Together[Of]
) -> list[UnitResult]:
    """Results of all units of a run; those of a pair that measures a tilt together are among those of its first unit.

    `reduced` is the result of each unit and what is reduced of it, None without a result.
    """
    places = {unit.place: (unit, of) for unit, (_, of) in zip(data.units, reduced, strict=True)}
    results = {unit.place: result for unit, (result, _) in zip(data.units, reduced, strict=True)}
    for pair in data.bench.tilt_pairs:
        if pair.along in results:
            results[pair.along] = _with_pair(results[pair.along], pair, places, partial(tilt_of, data, pair))
    return list(results.values())


def _with_pair(
    result: UnitResult, pair: TiltPairRecord, places: Mapping[str, tuple[UnitUnderTest, Of | None]],
    tilt_of: Callable[[tuple[UnitUnderTest, UnitUnderTest], tuple[Of, Of]], TiltOfTwo | None],
) -> UnitResult:  # fmt: skip
    """The result of the first unit of a pair with those of both, or with the reason for none."""
    if pair.across not in places:
        return result
    (first, own), (second, other) = places[pair.along], places[pair.across]
    tilt = None if own is None or other is None else tilt_of((first, second), (own, other))
    if tilt is None:
        return replace(result, flags=(*result.flags, Flag("tilt_of_two:not_determined")))
    return replace(result, findings=(*result.findings, *tilt.findings()))
